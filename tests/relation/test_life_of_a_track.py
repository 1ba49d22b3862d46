"""Tracks end, come back, come late, and go; each where a plain reading of the rows would have it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import psycopg
import pytest
import shapely
from patience import PATIENCE_S, until
from world import SECOND_US, World

from semap.store.database.connection import connect

ROOM = shapely.box(0, 0, 4, 4)


def ended(world: World) -> list[tuple[bool, bool]]:
    return world.rows(
        "select t.ended_at is not null, n.live from semap.track t join semap.track_now n using (track_id)"
    )


def test_a_late_state_does_not_bring_an_ended_track_back(world: World) -> None:
    track = world.add_track("t")
    world.add_states([(track, SECOND_US, 2, 2, None)])
    world.add_states([(track, 5 * SECOND_US, 2, 2, None, True)])
    world.add_states([(track, 3 * SECOND_US, 2, 2, None)])
    assert ended(world) == [(True, False)]
    assert world.one("select late_states from semap.source") == 1
    world.add_states([(track, 7 * SECOND_US, 2, 2, None)])
    assert ended(world) == [(False, True)]


def test_a_track_that_left_was_put_back_by_an_edit_and_ended_at_one_stamp(world: World) -> None:
    world.add_room("room", ROOM)
    track = world.add_track("t")
    world.add_states([(track, SECOND_US, 2, 2, None), (track, 2 * SECOND_US, 9, 2, None)])
    world.edit_room("room", shapely.box(0, 0, 12, 4))
    world.end_track(track, 2 * SECOND_US)
    assert [change[2:4] for change in world.changes()] == [
        ("began", "appeared"), ("ended", "moved"), ("began", "map"), ("ended", "disappeared"),
    ]  # fmt: skip


def test_a_deleted_track_may_come_again(world: World) -> None:
    world.add_room("room", ROOM)
    for _ in range(2):
        world.add_states([(world.add_track("t"), SECOND_US, 2, 2, None)])
        assert world.relations() == {("t", "room", SECOND_US)}
        world.run("delete from semap.track")
        assert world.relations() == set()
        assert world.changes() == []
        assert world.one("select count(*) from semap.stored_state") == 0


@pytest.mark.parametrize("stamp", ["infinity", "-infinity", "12000-01-01Z", "1700-01-01Z"])
def test_a_stamp_beyond_all_use_is_refused(world: World, stamp: str) -> None:
    track = world.add_track("t")
    with pytest.raises(psycopg.errors.CheckViolation):
        world.run("insert into semap.track_state values (%s, %s, 0, 0)", track, stamp)


@pytest.mark.parametrize("place", ["'NaN', 0", "0, 'infinity'", "1e8, 0"])
def test_a_place_beyond_all_use_is_refused(world: World, place: str) -> None:
    track = world.add_track("t")
    with pytest.raises(psycopg.errors.CheckViolation):
        world.run(f"insert into semap.track_state values (%s, now(), {place})", track)


def test_days_get_partitions_of_their_own(world: World) -> None:
    track = world.add_track("t")
    world.run("insert into semap.track_state values (%s, '2026-01-02 12:00Z', 0, 0)", track)
    world.run("select semap.ensure_partitions(array[date '2026-01-01', '2026-01-02', '2026-01-03'])")
    world.run("select semap.ensure_partitions(array[date '2026-01-01', '2026-01-03', '2026-01-04'])")
    world.add_room("room", ROOM)
    for day in range(3, 6):
        world.run(
            "insert into semap.track_state values (%s, make_timestamptz(2026, 1, %s, 12, 0, 0), 2, 2)",
            track,
            day,
        )
    assert world.rows("select tableoid::regclass::text, sum(states)::int from semap.state_chunk group by 1 order by 1") == [
        ("semap.state_chunk_20260103", 1), ("semap.state_chunk_20260104", 1), ("semap.state_chunk_default", 2),
    ]  # fmt: skip
    assert {pair[:2] for pair in world.relations()} == {("t", "room")}
    days = [f"{year}-{month:02d}-01" for year in range(1900, 1950) for month in range(1, 13)]
    world.run("select semap.ensure_partitions(%s::date[])", days)
    assert world.one("select count(*) from pg_inherits where inhparent = 'semap.state_chunk'::regclass") == 4


WAITS = "select from pg_locks where not granted"
INSERT = "insert into semap.track_state values (%s, '2026-01-03 12:00Z', 1, 1)"


def test_a_state_of_a_day_whose_partition_comes_meanwhile_is_taken(world: World) -> None:
    """It is in the partition, though its writer began before that was there."""
    track = world.add_track("t")
    with connect(world.dsn) as maker, connect(world.dsn) as writer, ThreadPoolExecutor() as pool:
        maker.execute("begin")
        maker.execute("select semap.ensure_partitions(array[date '2026-01-03'])")
        writing = pool.submit(writer.execute, INSERT, [track])
        until(lambda: world.rows(WAITS))
        maker.execute("commit")
        writing.result(PATIENCE_S)
    assert world.rows("select tableoid::regclass::text from semap.state_chunk") == [
        ("semap.state_chunk_20260103",)
    ]


def test_no_partition_is_made_beside_a_writer_who_does_not_end(world: World) -> None:
    """Nothing is left of it, and others write meanwhile."""
    days = "select semap.ensure_partitions(array[date '2026-01-03', '2026-01-04'])"
    ours, other = world.add_track("ours"), world.add_track("other", source_id=world.add_source("other"))
    with connect(world.dsn) as writer:
        writer.execute("begin")
        writer.execute(INSERT, [ours])
        assert world.one(days) is False
        world.run(INSERT.replace("03", "04"), other)
        writer.execute("commit")
    assert world.rows("select from pg_class where relname ~ 'chunk_2026'") == []
    assert world.one(days) is True
    assert world.one("select sum(states)::int from semap.state_chunk_default") == 2
