"""Queries about pairs, by example."""

from __future__ import annotations

import random
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import timedelta
from math import pi

import pytest
import shapely
from pair_oracle import Change, PairOracle, Question
from pair_town import Town
from world import SECOND_US

from semap.store.database.connection import connect
from semap.timeline.stamp import to_datetime


def seen(town: Town, name: str, second: float, x: float, y: float, **more: float | None) -> None:
    town.see((replace(town.last[name], stamp_us=round(second * SECOND_US), x_m=x, y_m=y, **more), False))


def told(town: Town) -> list[tuple[str, str, str, str, float]]:
    return [(e.kind, e.cause, e.subject, e.object, e.stamp_us / SECOND_US) for e in town.log()]


@pytest.fixture
def town_of(database: str):
    made = []

    def make(asked: Question) -> Town:
        made.append(Town(database, asked, f"town {len(made)}"))
        return made[-1]

    yield make
    for each in made:
        each.check()
        each.close()


def test_two_persons_meet_and_part(town_of) -> None:
    """Each of the two is near the other, at the moment at which the second one is seen there."""
    town = town_of(Question("within_distance", distance_m=2.0))
    town.track("Ann", source=0)
    town.track("Bob", source=1)
    seen(town, "Ann", 1, 0, 0)
    seen(town, "Bob", 1.5, 5, 0)
    seen(town, "Ann", 2, 3, 0)
    assert town.held() == {("Ann", "Bob", 2 * SECOND_US), ("Bob", "Ann", 2 * SECOND_US)}
    seen(town, "Bob", 3, 6, 0)
    town.end("Bob", 4 * SECOND_US)
    assert told(town) == [
        ("began", "moved", "Ann", "Bob", 2), ("began", "moved", "Bob", "Ann", 2),
        ("ended", "moved", "Ann", "Bob", 3), ("ended", "moved", "Bob", "Ann", 3),
    ]  # fmt: skip
    past = "select track_name, object_track_name, until - since from semap.relation_past where query_id = %s"
    assert town.world.rows(past, town.query_id) == [
        ("Ann", "Bob", timedelta(seconds=1)), ("Bob", "Ann", timedelta(seconds=1)),
    ]  # fmt: skip


def test_a_cup_is_put_on_the_table_and_taken_away(town_of) -> None:
    town = town_of(Question("on", "instance", "instance"))
    town.put("table", shapely.box(0, 0, 2, 1), (0.0, 0.75))
    town.put("cup", shapely.box(4, 4, 4.1, 4.1), (0.75, 0.85))
    assert town.log() == []
    town.put("cup", shapely.box(1, 0.5, 1.1, 0.6), (0.75, 0.85))
    assert [(e.kind, e.cause, e.subject, e.object) for e in town.log()] == [("began", "map", "cup", "table")]
    town.remove("cup")
    assert [e.kind for e in town.log()] == ["began", "ended"]
    assert town.held() == set()


def test_a_robot_stands_in_front_of_a_dock_and_its_ground_in_a_zone(town_of) -> None:
    """An instance in front of a track, a track's ground in an area: what regions cannot ask."""
    town = town_of(Question("in_front_of", "instance", "track", 1.0))
    zone = town_of(Question("intersects", "track", "instance"))
    for each in (town, zone):
        each.track("robot")
    town.put("dock", shapely.box(2, -0.5, 3, 0.5))
    zone.put("dock", shapely.box(2, -0.5, 3, 0.5))
    for each in (town, zone):
        seen(each, "robot", 1, 0, 0, yaw_rad=0.0, length_m=1.0, width_m=1.0)
        seen(each, "robot", 2, 1, 0, yaw_rad=3.0)
        seen(each, "robot", 3, 1, 0, yaw_rad=0.0)
        seen(each, "robot", 4, 1.5, 0)
        seen(each, "robot", 5, 4, 0)
    assert told(town) == [("began", "moved", "dock", "robot", 3), ("ended", "moved", "dock", "robot", 5)]
    assert told(zone) == [("began", "moved", "robot", "dock", 4), ("ended", "moved", "robot", "dock", 5)]


def test_a_line_is_crossed_at_a_point_and_a_time(town_of) -> None:
    """The line leads east; who walks south crosses it from its left, the north, to its right."""
    town = town_of(Question("crosses", "track", "instance", abstraction="Line"))
    town.put("line", shapely.LineString([(0, 2), (4, 2)]))
    town.track("Ann")
    seen(town, "Ann", 1, 1, 3)
    seen(town, "Ann", 2, 2, 2)  # on the line: still north of it
    seen(town, "Ann", 3, 2, 3)
    assert told(town) == []
    seen(town, "Ann", 5, 3, 1)
    seen(town, "Ann", 6, 5, 3)  # around its end
    seen(town, "Ann", 7, 4, 2)
    seen(town, "Ann", 8, 3, 1)  # through its very end
    assert [(e.kind, e.direction, e.stamp_us, e.edge_us, e.x_m, e.y_m) for e in town.log()] == [
        ("crossed", "left_to_right", 5 * SECOND_US, 4 * SECOND_US, 2.5, 2.0)
    ]
    assert town.held() == set()


def test_a_camera_that_is_turned_faces_somebody_else(town_of: Callable[[Question], Town]) -> None:
    """It looks the same from above, so that only its frame tells."""
    town = town_of(Question("facing", "instance", "track", angle_rad=0.5))
    town.put("camera", shapely.box(-0.5, -0.5, 0.5, 0.5))
    for name, x in {"Ann": 3.0, "Bob": -3.0}.items():
        town.track(name)
        seen(town, name, 1, x, 0.0)
    town.settle()
    town.world.run("update semap.frame_pose p set qz = 1, qw = 0 from semap.frame f"
                   " where f.frame_id = p.frame_id and f.name = 'camera'")  # fmt: skip
    town.oracle.edit("camera", replace(town.oracle.things["camera"], yaw_rad=pi))
    assert told(town) == [
        ("began", "appeared", "camera", "Ann", 1),
        ("ended", "map", "camera", "Ann", 1), ("began", "map", "camera", "Bob", 1),
    ]  # fmt: skip


def test_who_approaches_is_told_from_who_is_near(town_of) -> None:
    town = town_of(Question("approaching", "track", "instance", 5.0, speed_mps=1.0))
    town.put("door", shapely.box(10, 0, 11, 1))
    town.track("Ann")
    for second, x in enumerate([3, 4, 6, 7, 8.5, 8.5, 9.25, 6], 1):
        seen(town, "Ann", second, x, 0.5)
    assert told(town) == [
        ("began", "moved", "Ann", "door", 4), ("ended", "moved", "Ann", "door", 6),
    ]  # fmt: skip


def test_the_nearest_changes_though_neither_side_moved(town_of) -> None:
    town = town_of(Question("nearest", count=1))
    for name in ("Ann", "Bob", "Cid"):
        town.track(name)
    seen(town, "Ann", 1, 0, 0)
    seen(town, "Bob", 2, 3, 0)
    seen(town, "Cid", 3, 1, 0)
    town.end("Cid", 9 * SECOND_US)
    assert [each for each in told(town) if each[2] == "Ann"] == [
        ("began", "appeared", "Ann", "Bob", 2), ("ended", "moved", "Ann", "Bob", 3),
        ("began", "appeared", "Ann", "Cid", 3), ("ended", "disappeared", "Ann", "Cid", 9),
        ("began", "moved", "Ann", "Bob", 9),
    ]  # fmt: skip


def test_a_query_begins_with_what_holds(town_of) -> None:
    """And one that asks something else goes on with what still holds."""
    town = town_of(Question("within_distance", distance_m=2.0, enabled=False))
    for name, x in {"Ann": 0.0, "Bob": 1.0, "Cid": 2.5}.items():
        town.track(name)
        seen(town, name, 1, x, 0)
    assert told(town) == []
    town.ask(replace(town.oracle.asked, enabled=True))
    assert {each[:4] for each in told(town)} == {
        ("began", "map", *pair) for pair in [("Ann", "Bob"), ("Bob", "Ann"), ("Bob", "Cid"), ("Cid", "Bob")]
    }
    before = len(told(town))
    town.world.run("update semap.continuous_query set name = 'close' where query_id = %s", town.query_id)
    assert len(told(town)) == before
    town.ask(replace(town.oracle.asked, distance_m=1.0))
    assert {each[:4] for each in told(town)[before:]} == {
        ("ended", "map", "Bob", "Cid"), ("ended", "map", "Cid", "Bob")
    }  # fmt: skip
    town.world.run("delete from semap.continuous_query where query_id = %s", town.query_id)
    assert town.held() == set()
    for table in ("relation", "pair_query", "pair_instance"):
        assert town.world.rows(f"select from semap.{table} where query_id = %s", town.query_id) == []
    for each in ("Ann", "Bob"):
        other = "Bob" if each == "Ann" else "Ann"
        town.oracle.log.append(Change("ended", "map", each, other, SECOND_US, SECOND_US, SECOND_US))
    town.oracle.pairs.clear()


def test_an_outlier_moves_nobody(town_of) -> None:
    town = town_of(Question("within_distance", distance_m=2.0))
    town.world.run("update semap.source set jump_m = 15, jump_mps = 30 where map_id = %s", town.world.map_id)
    for name in ("Ann", "Bob"):
        town.track(name)
    seen(town, "Bob", 1, 0, 0)
    seen(town, "Ann", 1, 1, 0)
    before = told(town)
    town.world.copy_states([(town.tracks["Ann"], 2 * SECOND_US, 300.0, 0.0, None)])
    assert told(town) == before
    seen(town, "Ann", 3, 1, 0.5)
    assert told(town) == before


def test_a_map_that_goes_takes_its_pairs_along(town_of) -> None:
    town = town_of(Question("within_distance", distance_m=2.0))
    for name in ("Ann", "Bob"):
        town.track(name)
        seen(town, name, 1, 0, 0)
    assert len(town.held()) == 2
    town.world.run("delete from semap.map where map_id = %s", town.world.map_id)
    for table in ("relation", "pair_instance", "followed_state", "relation_change", "relation_past"):
        assert town.world.rows(f"select from semap.{table} where map_id = %s", town.world.map_id) == []
    town.oracle = PairOracle(town.oracle.asked)


def test_two_sources_that_write_at_once_leave_what_holds(town_of: Callable[[Question], Town]) -> None:
    """Whoever comes second sees where the other's track is: the two are near for both, or for neither."""
    town = town_of(Question("within_distance", distance_m=2.0))
    town.track("Ann", source=0)
    town.track("Bob", source=1)

    def walk(name: str, seed: int) -> float:
        dice, x = random.Random(seed), 0.0
        with connect(town.world.dsn) as connection:
            for second in range(1, 41):
                x = dice.randint(0, 6) / 1.0
                connection.execute(
                    "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, %s, %s, 0)",
                    [town.tracks[name], to_datetime(second * SECOND_US), x],
                )
        return x

    with ThreadPoolExecutor(2) as pool:
        ann, bob = pool.map(walk, ("Ann", "Bob"), (1, 2))
    town.newest_us = [40 * SECOND_US] * 2
    held = {each[:2] for each in town.held()}
    assert held == ({("Ann", "Bob"), ("Bob", "Ann")} if abs(ann - bob) <= 2 else set())
    balance = dict.fromkeys([("Ann", "Bob"), ("Bob", "Ann")], 0)
    for each in town.log():
        balance[each.subject, each.object] += 1 if each.kind == "began" else -1
        assert balance[each.subject, each.object] in (0, 1)
    assert {pair for pair, is_held in balance.items() if is_held} == held
    # the order in which the two came is nobody's to know
    town.oracle.log, town.oracle.pairs = [], {}
    town.world.run("delete from semap.map where map_id = %s", town.world.map_id)
