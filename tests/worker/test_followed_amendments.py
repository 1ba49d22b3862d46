"""Rules over a query that follows amendments: a replay retracts events of the mistaken reading and adds those of the right one."""

from __future__ import annotations

from datetime import timedelta

import pytest
import shapely
from psycopg.errors import CheckViolation
from rule_work import await_progress, running_worker
from world import SECOND_US, World

from semap.batch.recompute import Plan, recompute
from semap.store.operate.doctor.verification import verify
from semap.timeline.stamp import to_datetime
from semap.worker.late_replay import Replay, replay_late

VALID = """
    select e.type, e.track_name, e.instance_name, extract(epoch from e.stamp)::float8
    from semap.event e left join semap.event_amendment a using (event_id)
    where coalesce(a.verdict, '') not in ('retracted', 'amended') order by e.stamp, 1, 2
"""
SPANS = """
    select t.name, coalesce(i.name, 'gone'), extract(epoch from since)::float8, extract(epoch from until)::float8
    from semap.relation_span s join semap.track t using (track_id)
    join semap.continuous_query q using (query_id) left join semap.instance i using (instance_id)
    where q.name = 'track_in_room' order by 3, 1, 2
"""
AMEND = (
    "insert into semap.track_amendment (track_id, other_track_id, kind, since, found)"
    " values (%s, %s, %s, to_timestamp(%s), to_timestamp(%s))"
)
WEST, EAST = 2.0, 8.0


@pytest.fixture
def halls(world: World) -> World:
    """Two halls, and the rule that tells who enters and leaves them, over a query that follows amendments."""
    world.add_room("west", shapely.box(0, 0, 4, 4))
    world.add_room("east", shapely.box(6, 0, 10, 4))
    world.run("update semap.continuous_query set follows_amendments = true")
    world.run("update semap.source set jump_m = null")
    return world


def walk(world: World, at_s: float, **places: float) -> None:
    world.add_states([(IDS[name], round(at_s * SECOND_US), x_m, 2.0, None) for name, x_m in places.items()])


IDS: dict[str, int] = {}


def known(world: World) -> list[tuple]:
    return world.rows(SPANS)


def differing(world: World) -> list:
    verification = verify(world.dsn, lambda said: None)
    with verification.connection:
        return [(each.name, each.examples) for each in verification.look(None) if each.differ]


def test_who_was_lost_and_found_again_never_left(halls: World) -> None:
    """What was found after it goes on live, and counts as the first one's."""
    IDS.update({name: halls.add_track(name) for name in ("a", "b")})
    with running_worker(halls.dsn):
        walk(halls, 1, a=WEST)
        halls.end_track(IDS["a"], 2 * SECOND_US)
        walk(halls, 4, b=WEST)
        walk(halls, 6, b=EAST)
        await_progress(halls.dsn)
        assert known(halls) == [("a", "west", 1, 2), ("b", "west", 4, 6), ("b", "east", 6, None)]
        halls.run(AMEND, IDS["b"], IDS["a"], "merged", 4, 7)
        halls.correct()
        assert known(halls) == [("a", "west", 1, 6), ("a", "east", 6, None)]
        walk(halls, 8, b=WEST)
        await_progress(halls.dsn)
        assert known(halls) == [("a", "west", 1, 6), ("a", "east", 6, 8), ("a", "west", 8, None)]
        assert replay_late(halls.dsn).rows > 0
        assert replay_late(halls.dsn) == Replay(0, 0)
        right = [
            ("entered", "a", "west", 1), ("entered", "a", "east", 6), ("left", "a", "west", 6),
            ("entered", "a", "west", 8), ("left", "a", "east", 8),
        ]  # fmt: skip
        assert sorted(halls.rows(VALID)) == sorted(right)
        halls.complete(halls.source_id)
        await_progress(halls.dsn)
    assert differing(halls) == []
    recompute(halls.dsn, Plan("world", to_datetime(0), to_datetime(7 * SECOND_US)))
    told = [(kind, track, room) for kind, track, room, at_s in halls.rows(VALID) if at_s <= 6]
    assert sorted(told) == sorted((kind, track, room) for kind, track, room, at_s in right if at_s <= 6)


def test_who_was_switched_goes_on_as_the_other(halls: World) -> None:
    IDS.update({name: halls.add_track(name) for name in ("a", "b")})
    with running_worker(halls.dsn):
        walk(halls, 1, a=WEST, b=EAST)
        walk(halls, 3, a=EAST, b=WEST)
        await_progress(halls.dsn)
        halls.run(AMEND, IDS["a"], IDS["b"], "switched", 3, 5)
        halls.correct()
        assert known(halls) == [("a", "west", 1, None), ("b", "east", 1, None)]
        walk(halls, 6, a=5.0, b=WEST)
        await_progress(halls.dsn)
        assert known(halls) == [("a", "west", 1, None), ("b", "east", 1, 6)]
        replay_late(halls.dsn)
    assert sorted(halls.rows(VALID)) == [
        ("entered", "a", "west", 1), ("entered", "b", "east", 1), ("left", "b", "east", 6),
    ]  # fmt: skip
    assert differing(halls) == []


def test_an_edit_of_the_map_begins_and_ends_relations_of_the_right_track(halls: World) -> None:
    IDS.update({name: halls.add_track(name) for name in ("a", "b")})
    walk(halls, 1, a=WEST, b=EAST)
    walk(halls, 3, a=EAST, b=WEST)
    halls.run(AMEND, IDS["a"], IDS["b"], "switched", 3, 5)
    halls.correct()
    halls.delete_room("west")
    assert known(halls) == [("a", "gone", 1, 3), ("b", "east", 1, None)]
    halls.add_room("new west", shapely.box(1, 1, 3, 3))
    assert known(halls) == [("a", "gone", 1, 3), ("b", "east", 1, None), ("a", "new west", 3, None)]
    walk(halls, 6, a=EAST, b=5.0)
    assert known(halls) == [("a", "gone", 1, 3), ("b", "east", 1, None), ("a", "new west", 3, 6)]
    assert differing(halls) == []


def test_states_that_were_dropped_leave_what_was_told_of_them(halls: World) -> None:
    IDS.update({name: halls.add_track(name) for name in ("a", "b")})
    walk(halls, 1, a=WEST, b=EAST)
    walk(halls, 3, a=EAST, b=WEST)
    walk(halls, 5, a=WEST, b=EAST)
    halls.run("delete from semap.state_chunk where to_stamp < to_timestamp(4)")
    halls.run("update semap.retention set gone_before = to_timestamp(4) where kind = 'states'")
    before = [span for span in known(halls) if span[3] is not None]
    halls.run(AMEND, IDS["a"], IDS["b"], "switched", 2, 5)
    halls.correct()
    assert [span for span in known(halls) if span[3] is not None and span[3] < 4] == [
        span for span in before if span[3] < 4
    ]


def test_a_query_that_follows_amendments_later_reads_all_that_were_found(halls: World) -> None:
    """It does not stop to."""
    halls.run("delete from semap.rule")
    name = (
        "insert into semap.continuous_query (map_id, name, object_concept_id) select %s, 'late', concept_id"
    )
    halls.run(f"{name} from semap.concept where name = 'Room'", halls.map_id)
    IDS.update({track: halls.add_track(track) for track in ("a", "b")})
    walk(halls, 1, a=WEST, b=EAST)
    walk(halls, 3, a=EAST, b=WEST)
    halls.run(AMEND, IDS["a"], IDS["b"], "switched", 3, 5)
    halls.correct()
    held = (
        "select t.name, i.name from semap.relation n join semap.continuous_query q using (query_id)"
        " join semap.track t using (track_id) join semap.instance i using (instance_id)"
        " where q.name = 'late' and n.confirmed order by 1"
    )
    assert halls.rows(held) == [("a", "east"), ("b", "west")]
    halls.run("update semap.continuous_query set follows_amendments = true where name = 'late'")
    halls.correct()
    assert halls.rows(held) == [("a", "west"), ("b", "east")]
    with pytest.raises(CheckViolation, match="has followed amendments already"):
        halls.run("update semap.continuous_query set follows_amendments = false where name = 'late'")
    with pytest.raises(CheckViolation, match="does not follow amendments"):
        halls.run(
            "insert into semap.continuous_query (map_id, name, predicate, object_kind, distance_m, follows_amendments)"
            " values (%s, 'near', 'within_distance', 'track', 1, true)", halls.map_id,
        )  # fmt: skip


def test_rules_wait_for_the_reading_of_amended_tracks(halls: World) -> None:
    """What is told of an amended track within the lateness is never taken back."""
    IDS.update({name: halls.add_track(name) for name in ("a", "b")})
    halls.run("update semap.source set lateness = %s", timedelta(seconds=0))
    walk(halls, 1, a=WEST, b=EAST)
    halls.run(AMEND, IDS["a"], IDS["b"], "switched", 2, 2)
    halls.correct()
    halls.send_batch([(IDS["a"], 3 * SECOND_US, EAST, 2.0, None), (IDS["b"], 3 * SECOND_US, WEST, 2.0, None)])
    complete = "select extract(epoch from semap.complete_through(s))::float8 from semap.source s"
    halls.run("update semap.source set watermark = to_timestamp(3)")
    assert halls.one(complete) == pytest.approx(2.999999)
    halls.correct()
    assert halls.one(complete) == 3
    assert known(halls) == [("a", "west", 1, None), ("b", "east", 1, None)]
    assert halls.one("select count(*) from semap.relation_change where amendment is not null") == 0
