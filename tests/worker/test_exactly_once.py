"""Complex rules through crashes: the states of rules, their timers and the rows that wait live in the database."""

from __future__ import annotations

import random
from collections.abc import Mapping

import pytest
import shapely
from door_scene import PAPER, DoorScene
from rule_work import await_progress, lose_slot, running_worker
from test_backfill import RULES, should_be
from world import World

from semap.store.database.connection import connect
from semap.store.operate.rule_slot import ensure_slot
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


OPEN_AND_EMPTY: Mapping[str, object] = {
    "input": ["track_in_room", {"object_state": "door"}], "partition_by": "room", "when": "S",
    "formula": "always[0 s, 4 s] (O and not P)",
    "define": {
        "S": "(input = 'door' and type = 'open') or (input = 'track_in_room' and type = 'ended')",
        "O": "input = 'door' and type = 'open'",
        "P": "input = 'track_in_room' and type = 'began'",
    },
    "emit": {"holds": "open_and_empty"},
}  # fmt: skip


@pytest.mark.parametrize("seed", range(2))
def test_sources_out_of_step_and_states_out_of_order_give_the_same_events(world: World, seed: int) -> None:
    """Three sources, each as far as it likes, states of doors in any order within their lateness, cuts anywhere.

    In the end only watermarks come, by which absences are known.
    """
    dice = random.Random(seed)
    scene = DoorScene(world)
    rules = {**RULES, "open_and_empty": OPEN_AND_EMPTY}
    world.run("delete from semap.rule")
    for name, document in rules.items():
        scene.add_rule(name, document)
    other_id = world.add_source("other camera")
    scene.tracks["bob"] = world.add_track("bob", other_id)
    lateness_s = 6.0
    world.run("update semap.source set lateness = '6 s' where source_id = %s", scene.door_source_id)
    steps = {
        world.source_id: [(100.0 + i, "ann", dice.uniform(1, 7)) for i in range(60)],
        other_id: [(100.3 + i, "bob", dice.uniform(1, 7)) for i in range(60)],
        scene.door_source_id: sorted(
            ((100.5 + i, None, ("open", "closed")[dice.randrange(2)]) for i in range(60)),
            key=lambda step: step[0] + dice.uniform(0, lateness_s - 0.1),
        ),
    }
    newest_s = dict.fromkeys(steps, 0.0)
    with running_worker(world.dsn):
        while any(steps.values()):
            source_id = dice.choice([each for each, left in steps.items() if left])
            for _ in range(dice.randrange(1, 9)):
                if not steps[source_id]:
                    break
                at_s, name, what = steps[source_id].pop(0)
                if name is None:
                    scene.door(what, at_s)
                else:
                    scene.walk(name, [(at_s, what, 2)])
                newest_s[source_id] = max(newest_s[source_id], at_s)
            scene.watermark(newest_s[source_id], source_id)
            if dice.random() < 0.1:
                cut(world)
        for name in ("ann", "bob"):
            scene.walk(name, [(160.5, 1, 2)])
        scene.door("open", 161)
        scene.watermark(161, *steps)
        await_progress(world.dsn)
    with running_worker(world.dsn):
        for at_s in (165, 171, 200):
            scene.watermark(at_s, *steps)
        await_progress(world.dsn)
    for name, document in rules.items():
        found = world.rows(
            "select event_id::text, type from semap.event where rule_name = %s order by 1", name
        )
        assert found == should_be(world, name, document, None), name
        assert found, name
    assert world.one("select count(*) from semap.late_row") == 0
    assert world.one("select count(*) from semap.pending_row") == 0
