"""Complex rules through crashes: the states of rules, their timers and the rows that wait live in the database."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
import shapely
from door_scene import PAPER, DoorScene
from rule_work import await_progress, lose_slot, running_worker
from test_backfill import RULES, should_be
from world import World

from semap.store.database import connect
from semap.store.schema import ensure_slot
from semap.worker.resync import resync

MAP_EDITS: Mapping[str, object] = {
    "input": {"map": True},
    "emit": {"added": "built", "changed": "rebuilt", "removed": "torn_down"},
}


def cut(world: World) -> None:
    """End the worker's sessions as a crash of it or of the server would."""
    world.run(
        "select pg_terminate_backend(pid) from pg_stat_activity where datname = current_database()"
        " and application_name in ('semap work', 'semap replication')"
    )


def made(world: World) -> dict[str, list[tuple[str, str]]]:
    rows = world.rows("select rule_name, event_id::text, type from semap.event order by 1, 2")
    return {name: [row[1:] for row in rows if row[0] == name] for name in RULES}


def test_cut_anywhere_the_same_events_are_made(world: World) -> None:
    """Every change in a transaction of its own, and the worker's sessions cut after each third."""
    scene = DoorScene(world)
    world.run("delete from semap.rule")
    for name, document in RULES.items():
        scene.add_rule(name, document)
    at_s = 100
    with running_worker(world.dsn):
        for number in range(5):
            scene.passage(at_s, *(("ann", "bob") if number % 2 else ("bob", "ann")))
            cut(world)
            scene.watermark(at_s + 3)
            scene.watermark(at_s + 7, world.source_id)
            cut(world)
            at_s += 20
        scene.watermark(at_s)
        await_progress(world.dsn)
    for name, document in RULES.items():
        assert made(world)[name] == should_be(world, name, document, None), name
    assert all(made(world).values())
    assert world.one("select count(*) from semap.late_row") == 0
    assert world.one("select count(*) from semap.pending_row") == 0


def test_a_timer_that_was_set_by_one_worker_fires_in_the_next(world: World) -> None:
    scene = DoorScene(world)
    scene.add_rule("stayed", RULES["stayed"])
    with running_worker(world.dsn):
        scene.walk("ann", [(100, 1, 1), (102, 1, 1)])
        scene.watermark(102)
        await_progress(world.dsn)
        assert scene.events("stayed") == []
    scene.watermark(103.5)
    with running_worker(world.dsn):
        await_progress(world.dsn)
    assert scene.events("stayed") == [("stayed", "ann", "west", 103.0)]


def test_rows_that_wait_are_kept_and_taken_once_the_watermark_comes(world: World) -> None:
    scene = DoorScene(world)
    scene.add_rule("opened_then_entered", PAPER["opened_then_entered"])
    scene.watermark(90)
    with running_worker(world.dsn):
        scene.passage(100)
        await_progress(world.dsn)
    assert world.one("select count(*) from semap.pending_row") > 4
    scene.watermark(120)
    with running_worker(world.dsn):
        await_progress(world.dsn)
    assert world.one("select count(*) from semap.pending_row") == 0
    assert scene.events("opened_then_entered") == [("opened_then_entered", "ann", "east", 103.0)]


@pytest.mark.parametrize("name", ["opened_then_entered", "stayed", "while_open", "crowded"])
def test_a_lost_slot_costs_no_complex_event_and_makes_none_twice(world: World, name: str) -> None:
    """In the middle of a passage: the door is open, nobody has come in yet."""
    scene = DoorScene(world)
    world.run("delete from semap.rule")
    scene.add_rule(name, RULES[name])
    with running_worker(world.dsn):
        scene.passage(60, "bob", "ann")
        scene.walk("ann", [(92, 1, 2), (101, 3, 2), (102, 3.5, 2)])
        scene.door("open", 102)
        scene.watermark(102)
        await_progress(world.dsn)
    lose_slot(world.dsn)
    scene.walk("ann", [(103, 4.5, 2)])
    scene.door("closed", 105)
    scene.watermark(106)
    with connect(world.dsn) as connection:
        ensure_slot(connection)
    resync(world.dsn)
    scene.walk("bob", [(107, 6, 2)])
    scene.watermark(120)
    with running_worker(world.dsn):
        await_progress(world.dsn)
    assert made(world)[name] == should_be(world, name, RULES[name], None)
    assert made(world)[name]
    assert world.one("select count(*) from semap.late_row") == 0


def test_changes_of_the_map_are_rows_each_once_for_a_transaction(world: World) -> None:
    scene = DoorScene(world)
    scene.add_rule("works", MAP_EDITS)
    with running_worker(world.dsn):
        with world.connection.transaction():
            room_id = world.add_room("annex", shapely.box(20, 0, 24, 4))
            world.run("update semap.instance set alias = 'new' where instance_id = %s", room_id)
        world.run("update semap.instance set attributes = '{\"a\": 1}' where instance_id = %s", room_id)
        with world.connection.transaction():
            world.add_room("tent", shapely.box(30, 0, 34, 4))
            world.delete_room("tent")
        world.delete_room("annex")
        await_progress(world.dsn)
    found = world.rows(
        "select type, instance_name, instance_id from semap.event where rule_name = 'works' order by seq"
    )
    assert found == [
        ("built", "annex", room_id),
        ("rebuilt", "annex", room_id),
        ("torn_down", "annex", room_id),
    ]
