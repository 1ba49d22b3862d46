"""Short questions about a map: where things are, what holds between them, which way leads where, and what was when."""

from __future__ import annotations

from datetime import timedelta

import pytest
import shapely
from running import START, Service


def at(seconds: float) -> str:
    return (START + timedelta(seconds=seconds)).isoformat().replace("+00:00", "Z")


def test_where_something_is_and_what_holds_there(service: Service):
    service.make_map()
    hall = service.make_room("hall", shapely.box(0, 0, 20, 20), elevation_m=0, height_m=3)
    niche = service.make_room("niche", shapely.box(0, 0, 5, 5), elevation_m=0, height_m=3)
    table = service.make_thing(
        "table", footprint={"type": "Polygon", "coordinates": [[[1, 1], [3, 1], [3, 2], [1, 2], [1, 1]]]}, elevation_m=0, height_m=0.7,
        pose={"x_m": 1, "y_m": 1},
    )  # fmt: skip
    cup = service.make_thing(
        "cup",
        footprint={
            "type": "Polygon",
            "coordinates": [[[1.4, 1.4], [1.6, 1.4], [1.6, 1.6], [1.4, 1.6], [1.4, 1.4]]],
        },
        elevation_m=0.7,
        height_m=0.1,
        frame="table",
    )
    far = service.make_thing(
        "shelf", footprint={"type": "Polygon", "coordinates": [[[3.5, 1], [4, 1], [4, 2], [3.5, 2], [3.5, 1]]]}, elevation_m=0, height_m=2,
    )  # fmt: skip
    here = service.get(f"/instances/{cup['id']}/where")
    assert here["instance"] == {"id": cup["id"], "name": "cup"}
    assert [each["name"] for each in here["rooms"]] == ["niche", "hall"]
    assert [each["name"] for each in here["frames"]] == ["cup", "table", "map"]
    assert here["at"] is None

    frames = {each["name"]: each["id"] for each in here["frames"]}
    moved = {"x_m": 11.0, "y_m": 11.0, "z_m": 0.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
    service.plain.execute(
        "select semap.set_transform(%s, row(11, 11, 0, 0, 0, 0, 1)::semap.pose, %s)",
        [frames["table"], at(10)],
    )
    before = service.get(f"/instances/{cup['id']}/where", at=at(9))
    assert [each["name"] for each in before["rooms"]] in (["niche", "hall"], ["hall"])
    after = service.get(f"/instances/{table['id']}/where", at=at(10))
    assert after["pose"] == moved
    assert [each["name"] for each in after["rooms"]] == ["hall"]
    assert [each["name"] for each in service.get(f"/instances/{cup['id']}/where", at=at(60))["rooms"]] == [
        "hall"
    ]
    service.plain.execute("delete from semap.frame_pose where stamp > '-infinity'")

    held = service.get(f"/instances/{cup['id']}/relations", near_m=3)
    assert {(each["relation"], each["instance"]["name"]) for each in held["relations"]} == {
        ("in", "niche"), ("in", "hall"), ("on", "table"), ("near", "shelf")
    }  # fmt: skip
    (near,) = [each for each in held["relations"] if each["relation"] == "near"]
    assert near["distance_m"] == pytest.approx(1.9)
    assert near["instance"]["id"] == far["id"]
    of_table = service.get(f"/instances/{table['id']}/relations", near_m=0)
    assert ("carries", "cup") in {
        (each["relation"], each["instance"]["name"]) for each in of_table["relations"]
    }

    track = service.walk([(2, 2)])
    of_niche = service.get(f"/instances/{niche['id']}/relations")
    assert [(each["track_id"], each["query"]) for each in of_niche["tracks"]] == [(track, "track_in_room")]
    assert {each["relation"] for each in of_niche["relations"]} == {"in", "contains"}
    assert service.get(f"/instances/{niche['id']}/relations", limit=1)["more"]
    assert service.get(f"/rooms/{hall['id']}/occupants")["occupants"][0]["track_id"] == track
    assert service.client.get("/instances/999/where").status_code == 404
    assert service.client.get("/instances/999/relations").status_code == 404


def test_the_way_between_things_and_tracks(service: Service):
    service.make_map()
    rooms = [service.make_room(f"room {n}", shapely.box(4 * n, 0, 4 * n + 4, 4)) for n in range(4)]
    doors = []
    for n in range(2):
        area = shapely.box(4 * n + 3.9, 1, 4 * n + 4.1, 3)
        made = service.make_thing(
            f"door {n}",
            concept="Door",
            footprint=shapely.geometry.mapping(area),
            joins=[f"room {n}", f"room {n + 1}"],
        )
        doors.append(made)
    desk = service.make_thing("desk", footprint=shapely.geometry.mapping(shapely.box(9, 1, 10, 2)))
    track = service.walk([(1, 1)])
    way = service.get("/route", **{"from": f"track:{track}", "to": desk["id"]})
    assert [(each["room"], each["door"]) for each in way["steps"]] == [
        ("room 0", None),
        ("room 1", "door 0"),
        ("room 2", "door 1"),
    ]
    assert [each["length_m"] for each in way["steps"]] == pytest.approx([0, 2, 6])
    assert way["length_m"] == pytest.approx(8)
    assert way["line"] == [pytest.approx(point) for point in ([2, 2], [4, 2], [8, 2], [10, 2])]
    assert service.get("/route", **{"from": rooms[0]["id"], "to": rooms[3]["id"]}) == {
        "length_m": None,
        "steps": [],
        "line": [],
        "gap": {
            "reason": "No door, opening, stair or lift of the map leads from room 0, room 1, room 2 to room 3."
            " Let one join a room of each.",
            "start": {"rooms": 3, "names": ["room 0", "room 1", "room 2"], "storeys": []},
            "end": {"rooms": 1, "names": ["room 3"], "storeys": []},
        },
    }
    assert way["gap"] is None
    assert service.get("/route", **{"from": doors[0]["id"], "to": rooms[0]["id"]})["length_m"] == 0
    for wrong, status in (("track:99", 404), ("99", 404), ("x", 422), ("9999999999999999999", 422)):
        assert service.client.get("/route", params={"from": wrong, "to": desk["id"]}).status_code == status
    alone = service.make_thing("alone", footprint=shapely.geometry.mapping(shapely.box(90, 1, 91, 2)))
    assert service.client.get("/route", params={"from": alone["id"], "to": desk["id"]}).status_code == 422


def test_a_way_ends_where_it_was_not_seen(service: Service):
    service.make_map()
    track = service.walk([(1, 1)] * 3)
    service.plain.execute(
        "insert into semap.track_state (track_id, stamp, x_m, y_m) select %s, stamp, 5, 5"
        " from unnest(%s::timestamptz[]) stamp",
        [track, [at(100), at(101)]],
    )
    way = service.get(f"/tracks/{track}/path", **{"from": at(0), "to": at(200)})
    assert way["parts"] == [[[1, 1, 0], [1, 1, 2]], [[5, 5, 100], [5, 5, 101]]]
    one = service.get(f"/tracks/{track}/path", **{"from": at(2), "to": at(99)})
    assert [point[:2] for part in one["parts"] for point in part] in ([[1, 1]], [[1, 1], [1, 1]])


def test_what_was_when(service: Service):
    service.make_map()
    west = service.make_room("west", shapely.box(0, 0, 4, 4))
    east = service.make_room("east", shapely.box(4, 0, 8, 4))
    assert service.get("/maps/office/extent") == {"first": None, "last": None}
    track = service.walk([(1, 1), (2, 2), (5, 2), (20, 2), (6, 2)])
    service.happen(1, 2)

    then = service.get("/maps/office/moment", at=at(1.5), trail_s=5)
    (person,) = then["tracks"]
    assert (person["x_m"], person["y_m"], person["rooms"], person["ended"]) == (2, 2, [west["id"]], False)
    assert person["trail"] == [[1, 1, -1.5], [2, 2, -0.5]]
    assert (then["type"], then["stamp"], then["rooms"]) == (
        "snapshot",
        at(1.5).replace("500000", "500000"),
        {str(west["id"]): 1},
    )
    assert then["event_cursor"] == 2
    assert then["change_set"] > 0
    assert service.get("/maps/office/moment", at=at(-1))["tracks"] == []
    assert service.get("/maps/office/moment", at=at(500))["rooms"] == {str(east["id"]): 1}

    told = service.get("/maps/office/timeline", **{"from": at(0.5), "to": at(3.5)})
    assert [
        (each["name"], [(stay["from"][17:26], stay["to"] and stay["to"][17:26]) for stay in each["stays"]])
        for each in told["rooms"]
    ] == [
        ("west", [("00.000000", "02.000000")]),
        ("east", [("02.000000", "03.000000")]),
    ]
    assert told["events"] == []
    assert told["more"] is False
    everything = service.get("/maps/office/timeline", **{"from": at(0), "to": at(10), "limit": 2})
    assert (
        sum(len(each["stays"]) for each in everything["rooms"]),
        len(everything["events"]),
        everything["more"],
    ) == (2, 2, True)
    assert service.client.get("/maps/office/timeline", params={"from": at(1), "to": at(0)}).status_code == 422
    extent = service.get("/maps/office/extent")
    assert [extent["first"][:26], extent["last"][:26]] == [at(0)[:19] + ".000000", at(4)[:19] + ".000000"]

    stays = service.get(f"/tracks/{track}/stays", **{"from": at(2.5), "to": at(3.5)})["stays"]
    assert [each["name"] for each in stays] == ["east"], "from 2 to 3; what ended or began outside is none"
    way = service.get(f"/tracks/{track}/path", **{"from": at(0), "to": at(3)})
    assert way["parts"] == [[[1, 1, 0], [2, 2, 1], [20, 2, 3]]], (
        "where it went straight on, no point is needed"
    )
    too_long = service.client.get(f"/tracks/{track}/path", params={"from": at(0), "to": at(7 * 86_400 + 1)})
    assert too_long.status_code == 422
    history = service.get(f"/tracks/{track}/history", **{"from": at(1), "to": at(3)})
    assert [(each["x_m"], each["stamp"][17:19]) for each in history["states"]] == [
        (2, "01"),
        (5, "02"),
        (20, "03"),
    ]
    page = service.get(f"/tracks/{track}/history", limit=2)
    found = page["states"]
    while page["next"] is not None:
        page = service.get(f"/tracks/{track}/history", limit=2, after=page["next"])
        found += page["states"]
    assert [each["x_m"] for each in found] == [1, 2, 5, 20, 6]
    for path in (
        "/maps/nope/moment?at=2026-01-31T12:00:00Z",
        "/maps/nope/extent",
        "/tracks/99/history",
        "/maps/nope/timeline?from=2026-01-31T12:00:00Z&to=2026-01-31T12:00:00Z",
    ):
        assert service.client.get(path).status_code == 404, path
