"""Rows behind the watermark: kept, counted, and given to the rules after all."""

from __future__ import annotations

import pytest
from door_scene import PAPER, DoorScene, stamp
from rule_work import await_progress, running_worker
from test_backfill import RULES, should_be
from world import World

from semap.worker.late_replay import Replay, replay_late

LATE = (
    "select input, extract(epoch from stamp)::int, replayed_at is not null from semap.late_row order by stamp"
)


def test_what_came_late_is_kept_and_its_events_are_added_once(world: World) -> None:
    """The doors come after the tracks have gone on; without them nobody has opened anything."""
    scene = DoorScene(world)
    scene.add_rule("opened_then_entered", PAPER["opened_then_entered"])
    scene.walk("bob", [(92 + i, 7.0, 3.5) for i in range(20)])
    scene.walk("ann", [(92, 1, 2), (101, 3, 2), (102, 3.5, 2), (103, 4.5, 2), (104, 4.7, 2), (109, 6, 2)])
    world.run("update semap.source set ended = true where source_id = %s", scene.door_source_id)
    scene.watermark(200, world.source_id)
    with running_worker(world.dsn):
        await_progress(world.dsn)
        scene.door("open", 102)
        scene.watermark(200, scene.door_source_id)
        await_progress(world.dsn)
        assert scene.events("opened_then_entered") == []
        assert world.rows(LATE) == [("door", 102, False)]
        assert replay_late(world.dsn, "world") == Replay(1, 1)
        assert replay_late(world.dsn) == Replay(0, 0)
        world.run("update semap.late_row set replayed_at = null")
        assert replay_late(world.dsn) == Replay(1, 0)
        scene.walk("eve", [(300, 1, 1)])
        await_progress(world.dsn)
    assert scene.events("opened_then_entered") == [("opened_then_entered", "ann", "east", 103.0)]
    assert world.rows(LATE) == [("door", 102, True)]
    assert [seq for (seq,) in world.rows("select seq from semap.event order by seq")] == list(
        range(1, world.one("select event_seq from semap.progress") + 1)
    )


def test_a_late_row_within_the_lateness_of_its_source_is_not_late(world: World) -> None:
    scene = DoorScene(world)
    world.run("update semap.source set lateness = '10 s'")
    scene.add_rule("opened_then_entered", PAPER["opened_then_entered"])
    with running_worker(world.dsn):
        scene.walk("ann", [(92, 1, 2), (101, 3, 2), (102, 3.5, 2), (103, 4.5, 2)])
        scene.watermark(110)
        await_progress(world.dsn)
        scene.door("open", 102)
        scene.watermark(120)
        await_progress(world.dsn)
    assert scene.events("opened_then_entered") == [("opened_then_entered", "ann", "east", 103.0)]
    assert world.rows(LATE) == []


@pytest.mark.parametrize("name", ["visits", "stayed", "opened_then_entered"])
def test_replayed_the_log_is_what_it_would_have_been(world: World, name: str) -> None:
    """Tracks of a second source come when the first one has long gone on."""
    scene = DoorScene(world)
    world.run("delete from semap.rule")
    scene.add_rule(name, RULES[name])
    late_id = world.add_source("late")
    scene.tracks["bob"] = world.add_track("bob", late_id)
    with running_worker(world.dsn):
        scene.passage(100, "ann", "eve")
        scene.watermark(200)
        await_progress(world.dsn)
        scene.passage(130, "bob", "ann")
        scene.watermark(200, late_id)
        await_progress(world.dsn)
        replay_late(world.dsn)
    made = world.rows("select event_id::text, type from semap.event order by 1")
    assert made == should_be(world, name, RULES[name], stamp(0))
    assert len(made) > 1
