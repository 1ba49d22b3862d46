"""States in any order leave the history that the same states leave in the order of their stamps."""

from __future__ import annotations

import random
from concurrent.futures import ThreadPoolExecutor
from uuid import uuid4

import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from stateful_oracle import Asked, Follower, Sample
from test_132_stateful import asked, walk
from test_oracle import BANDS, SHAPES
from world import SECOND_US, World

from semap.store.database.connection import connect

QUICK = settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
STANDING = """
    select query_name, track_name, instance_name, kind::text, cause::text, stamp, transition_at, since, x_m, y_m
    from semap.relation_change c
    where map_id = %s and amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change d where d.retracts = c.uid)
    order by query_name, track_name, instance_name, stamp, transition_at, cause = 'disappeared', kind desc
"""
PAST = """
    select query_name, track_name, instance_name, since, until from semap.relation_past where map_id = %s
    order by 1, 2, 3, 4, 5
"""
HELD = """
    select r.query_name, t.name, r.instance_name, n.since, r.region_id = any (w.region_ids || w.stateful_ids)
    from semap.relation n join semap.region r using (query_id, instance_id) join semap.track t using (track_id)
    join semap.track_now w using (track_id)
    where n.map_id = %s and n.confirmed order by 1, 2, 3
"""
WAITING = """
    select r.query_name, t.name, r.instance_name, v.confirmed, v.pending, v.raw,
           case when v.pending <> v.confirmed then v.pending_at end,
           case when v.pending <> v.confirmed and v.raw <> v.confirmed then v.raw_at end
    from semap.relation v join semap.region r using (query_id, instance_id) join semap.track t using (track_id)
    where v.map_id = %s and (v.raw <> v.pending or v.pending <> v.confirmed) order by 1, 2, 3
"""
PRESENT = """
    select t.name, p.live, p.stamp, p.x_m, p.y_m, n.safe_until::text, cardinality(n.region_ids), cardinality(n.stateful_ids)
    from semap.track_now n join semap.track_place p using (track_id) join semap.track t using (track_id)
    where n.map_id = %s order by 1
"""
NEW = """
    select change_id, uid, amendment, retracts, query_name, track_name, instance_name, kind::text, cause::text, stamp,
           transition_at, since, x_m, y_m
    from semap.relation_change where map_id = %s and change_id > %s order by change_id
"""
NAMED = """
    select count(*) from semap.relation_change c join semap.track t using (track_id) join semap.instance i using (instance_id)
    where c.map_id = %s and amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change d where d.retracts = c.uid)
      and c.uid <> semap.change_uid(c.query_name, t.uid, i.uid, c.kind::text, c.cause::text, c.transition_at)
"""


class Client:
    """Somebody who follows the log: what was added stands until it is taken back.

    What was taken back and stands again between two looks was never away: what it was called meanwhile is nobody's.
    """

    def __init__(self, world: World) -> None:
        self.world, self.last, self.standing = world, 0, {}

    def read(self) -> None:
        for change_id, uid, amendment, retracts, *said in self.world.rows(NEW, self.world.map_id, self.last):
            self.last = change_id
            if amendment == "retracted":
                self.standing.pop(retracts, None)
            else:
                self.standing[uid] = said


def scene(database: str, question: Asked, rooms: list, jump_m: float | None) -> World:
    """A map with a stateless and a stateful query."""
    world = World(database, f"map {uuid4()}")
    world.run(
        "insert into semap.continuous_query (map_id, name, object_concept_id)"
        " select %s, 'plain', concept_id from semap.concept where name = 'Room'", world.map_id,
    )  # fmt: skip
    world.ask(question)
    for number, (shape, band) in enumerate(rooms):
        world.add_room(f"r{number}", shape, band)
    world.run("update semap.source set jump_m = %s where source_id = %s", jump_m, world.source_id)
    return world


def shuffled(dice: random.Random, seen: list[Sample]) -> list[list[Sample]]:
    """The same states in statements, in an order that is random within some reach or altogether."""
    reach = dice.choice([0, 3, 10, len(seen)])
    order = sorted(range(len(seen)), key=lambda place: place + dice.uniform(0, reach))
    parts, start = [], 0
    while start < len(seen):
        end = start + dice.choice([1, 1, 1, 2, 5, 20])
        parts.append([seen[place] for place in order[start:end]])
        start = end
    return parts


def told(world: World) -> list:
    return [world.rows(statement, world.map_id) for statement in (STANDING, PAST, HELD, WAITING, PRESENT)]


@QUICK
@given(
    question=asked,
    rooms=st.lists(st.tuples(st.sampled_from(SHAPES), st.sampled_from(BANDS)), min_size=1, max_size=3),
    jump_m=st.sampled_from([None, 1000.0]),
    seed=st.integers(0, 2**32),
)
def test_states_in_any_order_leave_the_same_history(
    database: str, question: Asked, rooms: list, jump_m: float | None, seed: int
) -> None:
    dice = random.Random(seed)
    one, other = (scene(database, question, rooms, jump_m) for _ in range(2))
    try:
        client = Client(other)
        for name in ("a", "b"):
            seen = walk(dice, 30)
            one_id, other_id = one.add_track(name), other.add_track(name)
            for sample in seen:
                one.add_samples(one_id, [sample])
            for part in shuffled(dice, seen):
                other.add_samples(other_id, part)
                client.read()
            if dice.random() < 0.3:
                end_us = seen[-1].stamp_us + dice.choice([0, 500_000])
                one.end_track(one_id, end_us)
                other.end_track(other_id, end_us)
                client.read()
            for number, (shape, band) in enumerate(rooms):
                oracle = Follower(shape, band, question)
                for sample in seen:
                    oracle.take(sample)
                found = one.rows(
                    "select kind::text, cause::text, (extract(epoch from stamp) * 1000000)::bigint"
                    " from semap.relation_change where query_id = %s and track_name = %s and instance_name = %s"
                    " order by change_id limit %s",
                    one.query_id, name, f"r{number}", len(oracle.found),
                )  # fmt: skip
                assert found == [(f.kind, f.cause, f.stamp_us) for f in oracle.found]
        for ours, theirs in zip(told(other), told(one), strict=True):
            assert ours == theirs
        assert sorted(map(repr, client.standing.values())) == sorted(repr(list(r)) for r in told(one)[0])
        assert other.one(NAMED, other.map_id) == 0
    finally:
        one.close()
        other.close()


ROOM = shapely.box(0, 0, 4, 4)
KINDS = "select kind::text, cause::text, extract(epoch from stamp)::float8, amendment from semap.relation_change order by change_id"


def states(track: int, *seen: tuple[float, float]) -> list[tuple]:
    return [(track, round(at_s * SECOND_US), x, 2.0, None) for at_s, x in seen]


def test_a_change_that_moved_is_taken_back_and_added_anew(world: World) -> None:
    world.add_room("room", ROOM)
    track = world.add_track("t")
    world.add_states(states(track, (1, 9), (5, 2), (9, 9)))
    world.add_states(states(track, (3, 2)))
    assert world.rows(KINDS) == [
        ("began", "moved", 5.0, None), ("ended", "moved", 9.0, None),
        ("began", "moved", 5.0, "retracted"), ("ended", "moved", 9.0, "retracted"),
        ("began", "moved", 3.0, "added"), ("ended", "moved", 9.0, "added"),
    ]  # fmt: skip
    assert world.rows(
        "select extract(epoch from since)::int, extract(epoch from until)::int from semap.relation_past"
    ) == [(3, 9)]


def test_a_region_counts_from_when_it_got_its_form(world: World) -> None:
    """Tracks that came to be known after that are corrected from their beginning on."""
    old = world.add_track("old")
    world.add_states(states(old, (1, 9), (10, 9)))
    world.add_room("room", ROOM)
    new = world.add_track("new")
    world.add_states([*states(old, (20, 9)), *states(new, (1, 9), (10, 9))])
    world.add_states([*states(old, (5, 2)), *states(new, (5, 2))])
    assert {change[0] for change in world.changes()} == {"new"}
    world.add_states(states(old, (15, 2)))
    assert [change[4] / SECOND_US for change in world.changes() if change[0] == "old"] == [15, 20]


@pytest.mark.parametrize("states_before", [0, 40])
def test_an_outlier_that_comes_late_corrects_nothing(world: World, states_before: int) -> None:
    """One that the next state confirms does: the track did jump. What is looked at again need not begin with the track."""
    world.add_room("room", ROOM)
    track = world.add_track("t")
    world.run("update semap.source set jump_m = 3, jump_mps = 0.1")
    world.add_states(states(track, *((at_s, 9) for at_s in range(-states_before, 10))))
    world.add_states(states(track, (4.5, 2)))
    assert world.changes() == []
    world.add_states(states(track, (4.6, 2.5)))
    assert [change[2:] for change in world.changes()] == [
        ("began", "moved", 4_600_000), ("ended", "moved", 6 * SECOND_US),
    ]  # fmt: skip


def test_who_was_near_one_that_ended_has_not_ended(world: World) -> None:
    world.add_room("room", ROOM)
    world.run(
        "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, distance_m)"
        " values (%s, 'near', 'within_distance', 'track', 'track', 5)", world.map_id,
    )  # fmt: skip
    one, other = world.add_track("one"), world.add_track("other")
    for at_s in (1, 2, 4):
        world.add_states([*states(one, (at_s, 2)), (other, at_s * SECOND_US, 1.0, 2.0, None, at_s == 4)])
    world.add_states(states(one, (6, 2), (7, 2)))
    world.add_states(states(one, (3, 3)))
    assert world.rows("select count(*) from semap.relation_change where amendment is not null") == [(0,)]
    assert world.relations() == {("one", "room", SECOND_US)}


def test_compacted_states_count_as_others_do(world: World) -> None:
    world.add_room("room", ROOM)
    track = world.add_track("t")
    world.add_states(states(track, (1, 9), (5, 2), (9, 9), (4000, 9), (4001, 9)))
    world.run("select semap.compact_all(array(select source_id from semap.source))")
    world.add_states(states(track, (3, 2)))
    assert world.rows(
        "select extract(epoch from since)::int, extract(epoch from until)::int from semap.relation_past"
    ) == [(3, 9)]


def test_writers_of_two_sources_correct_at_once(world: World) -> None:
    """Each the tracks of its own source."""
    world.add_room("room", ROOM)
    ids = [world.add_track("one"), world.add_track("two", world.add_source("other"))]

    def write(track: int) -> None:
        with connect(world.dsn) as connection:
            for at_s in range(40, 0, -1):
                connection.execute(
                    "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, to_timestamp(%s), %s, 2)",
                    [track, at_s, 2 if at_s % 4 < 2 else 9],
                )
                if at_s % 3 == 0:
                    connection.execute("select semap.correct_some()")

    with ThreadPoolExecutor() as pool:
        list(pool.map(write, ids))
    world.correct()
    spans = [(at_s, at_s + 2) for at_s in range(4, 40, 4)]
    for name in ("one", "two"):
        found = world.rows(
            "select extract(epoch from since)::int, extract(epoch from until)::int from semap.relation_past"
            " where track_name = %s order by 1", name,
        )  # fmt: skip
        assert found == [(1, 2), *spans]
    assert {relation[::2] for relation in world.relations()} == {
        ("one", 40 * SECOND_US),
        ("two", 40 * SECOND_US),
    }


def test_what_was_crossed_before_an_edit_and_known_after_it_stays(world: World) -> None:
    """One track is not heard of while the map goes on, and the room is edited: its way out led through the wall before."""
    world.ask(Asked(longest_gap=60.0, fastest_mps=30.0))
    world.add_room("room", ROOM)
    track, other = world.add_track("t"), world.add_track("other")
    world.add_states(states(track, (1, 2), (2, 2), (3, 2)))
    world.add_states(states(other, (30, 50)))
    world.edit_room("room", ROOM.buffer(0.01, join_style="mitre"))
    world.add_states(states(track, (37, 300), (38, 9), (39, 2), (40, 2)))
    told = world.rows(STANDING, world.map_id)
    assert [(row[3], row[5].timestamp()) for row in told] == [("began", 1), ("ended", 37), ("began", 39)]
    assert told[1][6].timestamp() < 30
    world.add_states(states(track, (35, 200)))
    assert world.rows("select * from semap.log_differences(%s)", world.map_id) == []
    assert world.rows(STANDING, world.map_id)[1] == told[1]
