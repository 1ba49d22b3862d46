"""The rule worker on a real log: both edges, exactly once, in the order of the log."""

from __future__ import annotations

import json
from threading import Event as Signal
from uuid import UUID

import pytest
import shapely
from rule_work import await_event_of, await_events, await_events_of, lose_slot, running_worker
from world import SECOND_US, World

from semap.errors import Conflict, ServerUnavailable, SlotLost
from semap.replication.pgoutput import parse_lsn
from semap.store.database.connection import connect
from semap.store.operate.rule_slot import ensure_slot
from semap.timeline.stamp import to_datetime
from semap.worker.progress import Made, Progress, commit_progress
from semap.worker.resync import resync
from semap.worker.rule_worker import work

ROOM = shapely.box(0, 0, 4, 4)


def visit(world: World, name: str, start_s: int) -> int:
    """In at start_s, out two seconds later."""
    track = world.add_track(name)
    world.add_states(
        [(track, (start_s + i) * SECOND_US, x, 2, None) for i, x in enumerate([-1.0, 2.0, 3.0, 9.0])]
    )
    return track


def test_one_declaration_gives_entered_and_left_with_their_evidence(world: World) -> None:
    world.add_room("kitchen", ROOM)
    with running_worker(world.dsn):
        visit(world, "ann", 10)
        log = await_events(world.dsn, 2)
    entered, left = log
    assert entered[0] == 1
    assert entered[2:] == ("entered", "moved", "ann", "kitchen", *[to_datetime(11 * SECOND_US)] * 2, 1)
    assert left[0] == 2
    assert left[2:] == (
        "left", "moved", "ann", "kitchen", to_datetime(13 * SECOND_US), to_datetime(11 * SECOND_US), 1,
    )  # fmt: skip
    assert world.rows(
        "select v.event_id::text, c.kind::text from semap.event_evidence v"
        " join semap.relation_change c on c.uid = v.uid order by c.change_id"
    ) == [(entered[1], "began"), (left[1], "ended")]


def test_what_happened_while_no_worker_ran_is_caught_up(world: World) -> None:
    world.add_room("kitchen", ROOM)
    visit(world, "ann", 10)
    with running_worker(world.dsn):
        first = await_events(world.dsn, 2)
    visit(world, "bob", 20)
    with running_worker(world.dsn):
        log = await_events(world.dsn, 4)
    assert log[:2] == first
    assert [row[0] for row in log] == [1, 2, 3, 4]
    assert [row[4] for row in log] == ["ann", "ann", "bob", "bob"]


def test_a_rule_is_in_force_from_where_it_was_changed_in_the_log(world: World) -> None:
    """Everything below happens before a worker runs, so only the log can tell the order."""
    world.add_room("kitchen", ROOM)
    visit(world, "one", 10)
    world.run("update semap.rule set enabled = false")
    visit(world, "two", 20)
    emit = json.dumps({"input": "track_in_room", "emit": {"ended": "went"}})
    world.run("update semap.rule set enabled = true, version = 2, declaration = %s", emit)
    visit(world, "three", 30)
    world.run("delete from semap.rule")
    visit(world, "four", 40)
    with running_worker(world.dsn):
        log = await_events(world.dsn, 3)
    assert [(row[4], row[2], row[8]) for row in log] == [
        ("one", "entered", 1),
        ("one", "left", 1),
        ("three", "went", 2),
    ]


def test_a_second_worker_waits_and_takes_over(world: World) -> None:
    world.add_room("kitchen", ROOM)
    with running_worker(world.dsn):
        visit(world, "ann", 10)
        await_events(world.dsn, 2)
        with running_worker(world.dsn) as second:
            visit(world, "bob", 20)
            await_events(world.dsn, 4)
            assert second.is_alive()
    with running_worker(world.dsn):
        visit(world, "eve", 30)
        log = await_events(world.dsn, 6)
    assert len({row[1] for row in log}) == 6


def test_only_one_of_two_workers_moves_on(world: World) -> None:
    """A worker that lost its slot without noticing may not commit what another has committed."""
    with connect(world.dsn) as connection:
        (lsn,) = connection.execute("select lsn::text from semap.progress").fetchone()
        commit_progress(connection, parse_lsn(lsn), Progress(parse_lsn(lsn) + 10, 0), Made())
        with pytest.raises(ServerUnavailable, match="moved the progress"):
            commit_progress(connection, parse_lsn(lsn), Progress(parse_lsn(lsn) + 20, 0), Made())


def test_watermarks_are_kept_with_the_progress(world: World) -> None:
    world.add_room("kitchen", ROOM)
    with running_worker(world.dsn):
        world.run("update semap.source set watermark = %s", to_datetime(50 * SECOND_US))
        visit(world, "ann", 10)
        await_events(world.dsn, 2)
    assert world.one("select watermarks -> 'maps' from semap.progress") == {
        str(world.map_id): {
            "released_us": 50 * SECOND_US,
            "sources": {str(world.source_id): {"complete_us": 50 * SECOND_US, "awaited": True}},
        }
    }


def test_what_was_made_durable_is_acknowledged(world: World) -> None:
    world.add_room("kitchen", ROOM)
    with running_worker(world.dsn):
        visit(world, "ann", 10)
        await_events(world.dsn, 2)
    confirmed, lsn = world.rows(
        "select s.confirmed_flush_lsn::text, p.lsn::text from semap.progress p, pg_replication_slots s"
        " where s.slot_name = semap.rule_slot()"
    )[0]
    assert parse_lsn(confirmed) >= parse_lsn(lsn)


def test_an_edit_of_the_map_makes_events_with_its_cause(world: World) -> None:
    world.add_room("kitchen", ROOM)
    track = world.add_track("ann")
    world.add_states([(track, SECOND_US, 2, 2, None)])
    with running_worker(world.dsn):
        world.edit_room("kitchen", shapely.box(10, 10, 12, 12))
        world.edit_room("kitchen", ROOM)
        world.delete_room("kitchen")
        log = await_events(world.dsn, 4)
    assert [row[2:6] for row in log] == [
        ("entered", "appeared", "ann", "kitchen"),
        ("left", "map", "ann", "kitchen"),
        ("entered", "map", "ann", "kitchen"),
        ("left", "map", "ann", "kitchen"),
    ]


def test_a_lost_slot_is_told_and_made_again_without_loss(world: World) -> None:
    world.add_room("kitchen", ROOM)
    with running_worker(world.dsn):
        visit(world, "ann", 10)
        before = await_events(world.dsn, 2)
    lose_slot(world.dsn)
    visit(world, "bob", 20)
    with connect(world.dsn) as connection:
        ensure_slot(connection)

    with pytest.raises(SlotLost) as lost:
        work(world.dsn, Signal())
    assert "semap db resync" in lost.value.remedy
    assert resync(world.dsn) == 2
    visit(world, "eve", 30)
    with running_worker(world.dsn):
        log = await_events(world.dsn, 6)
        with pytest.raises(Conflict):
            resync(world.dsn)
    assert log[:2] == before
    assert [row[4] for row in log] == ["ann", "ann", "bob", "bob", "eve", "eve"]
    assert [row[0] for row in log] == [1, 2, 3, 4, 5, 6]


def test_a_map_made_again_under_its_name_starts_anew_with_the_same_ids(world: World) -> None:
    world.add_room("kitchen", ROOM)
    visit(world, "ann", 10)
    with running_worker(world.dsn):
        first = await_events(world.dsn, 2)
        world.run("delete from semap.map")
        again = World(world.dsn, "world")
        again.add_room("decoy", shapely.box(50, 50, 60, 60))
        again.add_room("kitchen", ROOM)
        again.add_track("decoy")
        visit(again, "ann", 10)
        visit(again, "bob", 20)
        second = await_event_of(world.dsn, "bob", "left")
    assert [row[1] for row in second[:2]] == [row[1] for row in first]
    assert [row[4] for row in second] == ["ann", "ann", "bob", "bob"]
    assert all(UUID(row[1]).version == 5 for row in first)
    again.close()


def test_a_map_deleted_and_made_again_while_no_worker_ran(world: World) -> None:
    world.add_room("kitchen", ROOM)
    visit(world, "ann", 10)
    world.run("delete from semap.map")
    again = World(world.dsn, "world")
    again.add_room("kitchen", ROOM)
    visit(again, "ann", 10)
    with running_worker(world.dsn):
        log = await_events_of(world.dsn, again.map_id, 2)
    assert [row[5] for row in log] == ["ann", "ann"]
    assert world.rows("select distinct map_id from semap.event") == [(again.map_id,)]
    again.close()


def test_a_rule_that_cannot_be_read_stops_no_other(world: World) -> None:
    world.add_room("kitchen", ROOM)
    world.run("insert into semap.rule (map_id, name, declaration) values (%s, 'broken', '{}')", world.map_id)
    visit(world, "ann", 10)
    world.run("delete from semap.rule where name = 'broken'")
    visit(world, "bob", 20)
    with running_worker(world.dsn):
        log = await_events(world.dsn, 4)
    assert [row[4] for row in log] == ["ann", "ann", "bob", "bob"]


def test_a_long_rule_whose_text_is_stored_out_of_line_is_disabled(world: World) -> None:
    """An update that leaves the declaration as it is does not carry it in the new row."""
    world.add_room("kitchen", ROOM)
    world.run("alter table semap.rule alter declaration set storage external")
    world.run(
        "update semap.rule set declaration = declaration || jsonb_build_object('note', repeat('x', 9000))"
    )
    world.run("update semap.rule set declaration = declaration - 'note'")
    visit(world, "ann", 10)
    world.run("update semap.rule set enabled = false")
    visit(world, "bob", 20)
    world.run("update semap.rule set enabled = true")
    visit(world, "eve", 30)
    with running_worker(world.dsn):
        log = await_events(world.dsn, 4)
    assert [row[4] for row in log] == ["ann", "ann", "eve", "eve"]


def test_a_resync_that_was_killed_lets_no_worker_begin(world: World) -> None:
    world.add_room("kitchen", ROOM)
    visit(world, "ann", 10)
    world.run("update semap.progress set lsn = '0/0'")
    world.run("select semap.replace_rule_slot()")
    with pytest.raises(SlotLost, match="did not end"):
        work(world.dsn, Signal())
    assert resync(world.dsn) == 2
