"""Relations of any two sides over HTTP: queries of them, what holds by them, and what held at a time."""

from __future__ import annotations

from datetime import timedelta

import psycopg
import pytest
import shapely
from running import START, Service

ANY = {"kind": None, "concept": None, "uids": None, "where": None}
NEAREST = {
    "map": "office", "name": "nearest_others", "predicate": "nearest", "count": 2, "distance_m": 5.0,
    "subject": {"kind": "track", "where": "source = 'camera'"}, "object": {"kind": "track"},
}  # fmt: skip
CAMERA = {"op": "=", "args": [{"property": "source"}, "camera"]}


def test_a_query_of_two_tracks_is_made_read_and_replaced(service: Service) -> None:
    service.make_map()
    made = service.client.post("/queries", json=NEAREST)
    assert made.status_code == 201, made.text
    expected = {
        "subject": {**ANY, "kind": "track", "where": CAMERA}, "object": {**ANY, "kind": "track"}, "predicate": "nearest",
        "count": 2, "distance_m": 5.0, "angle_rad": None, "speed_mps": None, "direction": None, "concept": None,
    }  # fmt: skip
    where = made.headers["location"]
    assert expected.items() <= service.get(where).items()
    other = {
        "name": "faced", "predicate": "facing", "angle_rad": 0.25, "concept": "Door", "subject": {"kind": "instance"},
    }  # fmt: skip
    replaced = service.client.put(where, json=other).json()
    assert (replaced["subject"], replaced["concept"]) == ({**ANY, "kind": "instance"}, "Door")
    assert (replaced["angle_rad"], replaced["count"]) == (0.25, None)
    rests = service.client.patch(where, json={"enabled": False}).json()
    assert rests == {**replaced, "enabled": False}
    crossed = {
        "map": "office",
        "name": "in",
        "predicate": "crosses",
        "concept": "Door",
        "direction": "left_to_right",
    }
    assert service.client.post("/queries", json=crossed).json()["direction"] == "left_to_right"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": None}, "needs a count"),
        ({"count": 0}, "count"),
        ({"angle_rad": 1.0}, "takes no angle"),
        ({"subject": {"kind": "thing"}}, "subject"),
        ({"sql": "select * from track t, room r", "count": 2}, "sql says what"),
        ({"direction": "up"}, "direction"),
    ],
)
def test_what_a_query_cannot_ask(service: Service, change: dict, message: str) -> None:
    service.make_map()
    refused = service.client.post("/queries", json=NEAREST | change)
    assert refused.status_code == 422
    assert message in refused.text


def second(n: float) -> str:
    return (START + timedelta(seconds=n)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def test_what_holds_and_what_held(service: Service, plain: psycopg.Connection) -> None:
    """A track was in two rooms; a pair of it and another, by hand, is over, and one of rooms holds."""
    service.make_map()
    rooms = [service.make_room(f"Room{n}", shapely.box(4 * n, 0, 4 * n + 4, 3)) for n in range(2)]
    track_id = service.walk([(1, 1), (5, 1), (6, 1)])
    made = service.client.post("/queries", json=NEAREST).json()
    service.client.patch(f"/queries/{made['id']}", json={"enabled": False})
    (map_id,) = plain.execute("select map_id from semap.map").fetchone()
    plain.execute(
        "insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, object_track_id,"
        " object_track_name, since, until) values (%s, %s, 'nearest_others', %s, 'person', 999, 'other', %s, %s)",
        [map_id, made["id"], track_id, second(0), second(2.5)],
    )
    rests = {**NEAREST, "name": "rooms", "subject": {"kind": "instance"}, "object": {"concept": "Room"}}
    of_rooms = service.client.post("/queries", json=rests).json()
    service.client.patch(f"/queries/{of_rooms['id']}", json={"enabled": False})
    plain.execute(
        "insert into semap.relation (in_pairs, map_id, query_id, subject_instance_id, instance_id, confirmed, since,"
        " pending, raw) values (true, %s, %s, %s, %s, true, %s, true, true)",
        [map_id, of_rooms["id"], rooms[0]["id"], rooms[1]["id"], second(2)],
    )

    def row(query: str, since_s: float, until_s: float | None, **sides: object) -> dict:
        names = ("track_id", "track", "subject_instance_id", "subject_instance", "instance_id", "instance",
                 "object_track_id", "object_track")  # fmt: skip
        return {
            "map": "office", "query": query, **dict.fromkeys(names), **sides, "since": second(since_s),
            "until": None if until_s is None else second(until_s),
            "duration_s": None if until_s is None else until_s - since_s, "probability": None,
        }  # fmt: skip

    who = {"track_id": track_id, "track": "person"}
    first, then = (
        row("track_in_room", since_s, until_s, **who, instance_id=room["id"], instance=room["name"])
        for room, since_s, until_s in zip(rooms, (0, 1), (1, None), strict=True)
    )
    met = row("nearest_others", 0, 2.5, **who, object_track_id=999, object_track="other")
    beside = row("rooms", 2, None, subject_instance_id=rooms[0]["id"], subject_instance="Room0",
                 instance_id=rooms[1]["id"], instance="Room1")  # fmt: skip
    for as_of, expected in (
        (None, [then, beside]),
        (0.5, [first, met]),
        (1, [then, met]),
        (2.25, [then, beside, met]),
    ):
        asked = {} if as_of is None else {"as_of": second(as_of)}
        assert service.get("/relations", **asked)["relations"] == expected
        paged, after = [], "0-0-0-0"
        while after is not None:
            page = service.get("/relations", limit=1, after=after, **asked)
            paged += page["relations"]
            after = page["next"]
        assert paged == expected
    assert service.get("/relations", as_of=second(2.25), track="other")["relations"] == [met]
    assert service.get("/relations", room="Room0")["relations"] == [beside]
    assert service.get(f"/tracks/{track_id}/rooms")["relations"] == [then]

    result = service.get(f"/queries/{of_rooms['id']}/result")
    (only,) = result["rows"]
    assert (only["subject"], only["object"], result["next"]) == ("Room0", "Room1", None)
    in_rooms = service.get("/queries", map="office")["queries"][0]["id"]
    page = service.get(f"/queries/{in_rooms}/result", limit=1)
    assert [(each["track"], each["instance"]) for each in page["rows"]] == [("person", "Room1")]
    assert service.get(f"/queries/{in_rooms}/result", limit=1, after=page["next"])["rows"] == []
    assert service.client.get("/queries/9999/result").status_code == 404


def test_the_result_of_a_query_in_sql_has_its_columns(service: Service) -> None:
    service.make_map()
    service.make_room("Room0", shapely.box(0, 0, 4, 3))
    service.walk([(1, 1)])
    sql = "select r.name as room, t.position, t.x_m from track t, room r where ST_Contains(r.footprint, t.position)"
    made = service.client.post("/queries", json={"map": "office", "name": "where", "sql": sql}).json()
    (row,) = service.get(f"/queries/{made['id']}/result")["rows"]
    assert row.keys() == {"room", "position", "x_m", "since"}
    assert (row["room"], row["x_m"]) == ("Room0", 1.0)
    assert row["position"]["type"] == "Point"
    assert row["position"]["coordinates"][:2] == [1, 1]
