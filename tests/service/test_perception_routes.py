"""What perception tells, over HTTP: doors as they stand, the room that a track takes, what its tracker had mistaken."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

import psycopg
import pytest
import shapely
from patience import PATIENCE_S
from running import Service
from world import World

LINE = (
    "insert into semap.line_observation"
    " (source_id, stamp, x1_m, y1_m, x2_m, y2_m, angle_std_rad, offset_std_m, points)"
    " values (%s, %s, -0.43, 0, %s, %s, 0.01, 0.005, 20)"
)
AMEND = (
    "insert into semap.track_amendment (source_id, track_id, other_track_id, kind, since, found)"
    " values (%s, %s, %s, %s, '2026-01-31T12:00:01Z', '2026-01-31T12:00:02.5Z') on conflict do nothing"
)


@pytest.fixture
def office(database: str) -> Iterator[World]:
    made = World(database, "office")
    yield made
    made.close()


def add_door(office: World, name: str, attributes: dict) -> int:
    return office.one(
        "insert into semap.instance (map_id, name, concept_id, frame_id, attributes)"
        " select %s, %s, concept_id, %s, %s from semap.concept where name = 'Door' returning instance_id",
        office.map_id, name, office.frame_id, json.dumps(attributes),
    )  # fmt: skip


def test_doors_are_listed_as_they_stand(service: Service, office: World) -> None:
    gate = add_door(office, "gate", {"width_m": 0.9, "leaf": {"hinge": "left", "max_deg": 95}})
    add_door(office, "opening", {"width_m": 0.9})
    for room in ("hall", "cellar"):
        room_id = office.add_room(room, shapely.box(0, 0, 1, 1))
        office.run("insert into semap.door_room values (%s, %s)", gate, room_id)
    unseen = {
        "id": gate, "map": "office", "name": "gate", "state": None, "since": None, "stamp": None, "angle_deg": None,
        "angle_std_deg": None, "width_m": 0.9, "max_deg": 95.0, "rooms": ["cellar", "hall"],
    }  # fmt: skip
    assert service.get("/doors") == {"doors": [unseen], "next": None}
    for second in (1, 2):
        angle = math.radians(88)
        office.run(LINE, office.source_id, f"2026-01-31T12:00:0{second}Z",
                   -0.45 + 0.9 * math.cos(angle), 0.9 * math.sin(angle))  # fmt: skip
    (seen,) = service.get("/doors", map="office", name="gate", state="open")["doors"]
    assert seen == {
        **unseen, "state": "open", "since": "2026-01-31T12:00:01.000000Z", "stamp": "2026-01-31T12:00:02.000000Z",
        "angle_deg": pytest.approx(88, abs=2), "angle_std_deg": pytest.approx(math.degrees(0.01)),
    }  # fmt: skip
    for none in ({"state": "closed"}, {"name": "opening"}, {"after": gate}):
        assert service.get("/doors", **none) == {"doors": [], "next": None}
    assert service.get("/doors", limit=1)["next"] == gate
    assert service.client.get("/doors?map=nowhere").status_code == 404
    assert service.client.get("/doors?state=ajar").status_code == 422


def test_amendments_of_tracks_are_listed_in_the_order_of_their_arrival(
    service: Service, office: World
) -> None:
    a, b, c = (office.add_track(name) for name in "abc")
    for track, other, kind in ((a, b, "merged"), (b, c, "switched"), (a, b, "merged")):
        office.run(AMEND, office.source_id, track, other, kind)
    first, second = service.get("/track-amendments")["track_amendments"]
    assert first == {
        "id": first["id"], "map": "office", "source": "tracker", "kind": "merged", "track_id": a, "track": "a",
        "other_track_id": b, "other_track": "b", "since": "2026-01-31T12:00:01.000000Z",
        "found": "2026-01-31T12:00:02.500000Z",
    }  # fmt: skip
    assert second["id"] > first["id"]
    assert (second["kind"], second["track"], second["other_track"]) == ("switched", "b", "c")
    assert service.get("/track-amendments", track="b")["track_amendments"] == [first, second]
    assert service.get("/track-amendments", track="c", map="office")["track_amendments"] == [second]
    page = service.get("/track-amendments", limit=1)
    assert page == {"track_amendments": [first], "next": first["id"]}
    assert service.get("/track-amendments", after=page["next"]) == {
        "track_amendments": [second], "next": None,
    }  # fmt: skip
    assert service.client.get("/track-amendments?map=nowhere").status_code == 404


def test_a_track_is_told_with_the_ground_that_it_covers(service: Service, office: World) -> None:
    add = (
        "insert into semap.track_state (track_id, stamp, x_m, y_m, heading_rad, speed_mps, length_m, width_m)"
        " values (%s, '2026-01-31T12:00:00Z', 3, 2, %s, 1.25, %s, %s)"
    )
    office.run(add, office.add_track("walker"), math.pi / 2, 0.5, 0.25)
    office.run(add, office.add_track("point"), None, None, None)
    walker, point = (each["state"] for each in service.get("/tracks")["tracks"])
    shape = shapely.Polygon(walker["footprint"]["coordinates"][0])
    assert shape.bounds == pytest.approx((3 - 0.125, 2 - 0.25, 3 + 0.125, 2 + 0.25))
    assert {name: walker[name] for name in ("heading_rad", "speed_mps", "length_m", "width_m")} == {
        "heading_rad": pytest.approx(math.pi / 2), "speed_mps": 1.25, "length_m": 0.5, "width_m": 0.25,
    }  # fmt: skip
    assert (point["footprint"], point["heading_rad"], point["speed_mps"]) == (None, None, 1.25)


def test_the_log_carries_amendments_and_wakes_who_listens(office: World, database: str) -> None:
    with psycopg.connect(database, autocommit=True) as listener:
        listener.execute("listen semap_amendment")
        a, b = office.add_track("a"), office.add_track("b")
        for _ in range(2):
            office.run(AMEND, office.source_id, a, b, "merged")
        listener.execute("notify semap_amendment, 'end'")
        (number,) = office.rows("select track_amendment_id from semap.track_amendment")[0]
        told = [each.payload for each in listener.notifies(timeout=PATIENCE_S, stop_after=2)]
    assert told == [str(number), "end"]
    assert office.rows(
        "select pubname, schemaname, tablename from pg_publication_tables where tablename = 'track_amendment'"
    ) == [("semap_amendment", "semap", "track_amendment")]
