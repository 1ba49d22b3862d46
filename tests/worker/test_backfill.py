"""A rule that begins in the middle: with the past nothing is lost or doubled at the seam, however it is disturbed."""

from __future__ import annotations

import random
from collections.abc import Mapping
from datetime import datetime
from threading import Event as Signal
from threading import Thread

import pytest
from door_scene import PAPER, DoorScene
from patience import any_moment
from rule_work import await_progress, running_worker
from world import World

from semap.rules.language.reading import parse_declaration
from semap.store.database.connection import connect
from semap.worker.past import dry_run

VISITS = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
CROWDED = {"input": "track_in_room", "where": "occupants > 1", "emit": {"began": "crowded"}}
STAYED = {
    "input": "track_in_room", "partition_by": ["track", "room"], "pattern": "B not followed by L",
    "define": {"B": "type = 'began'", "L": "type = 'ended'"}, "within": "3 s", "emit": "stayed",
}  # fmt: skip
WHILE_OPEN = {
    "input": ["track_in_room", {"object_state": "door"}], "partition_by": "room",
    "pattern": "P during|overlaps|overlappedBy|contains D",
    "define": {"P": "input = 'track_in_room'", "D": "input = 'door' and type = 'open'"}, "emit": "while_open",
}  # fmt: skip
CLOSES_SOON = {
    "input": {"object_state": "door"}, "partition_by": "instance", "when": "O",
    "formula": "eventually[0 s, 2 s] C", "define": {"O": "type = 'open'", "C": "type = 'closed'"},
    "emit": {"holds": "closed_soon", "fails": "left_open"},
}  # fmt: skip
RULES: Mapping[str, Mapping[str, object]] = {
    "visits": VISITS,
    "crowded": CROWDED,
    "stayed": STAYED,
    "while_open": WHILE_OPEN,
    "closes_soon": CLOSES_SOON,
    "opened_then_entered": PAPER["opened_then_entered"],
}


class Writer(Thread):
    """Writes batches of states of both sources, each with its watermark, until it is stopped."""

    def __init__(self, dsn: str, scene: DoorScene, seed: int) -> None:
        super().__init__(daemon=True)
        self._dice = random.Random(seed)
        self._scene = DoorScene.__new__(DoorScene)
        self._scene.__dict__ |= {**scene.__dict__, "world": _another(scene.world)}
        self.at_s = 100.0
        self.enough = Signal()
        self.batches = 0

    def run(self) -> None:
        while not self.enough.is_set() or self.batches < 40:
            self.batch()

    def batch(self) -> None:
        scene, dice, at_s = self._scene, self._dice, self.at_s
        with scene.world.connection.transaction():
            for name in ("ann", "bob", "eve"):
                scene.walk(name, [(at_s + i / 2, dice.uniform(2.5, 5.5), 2) for i in range(4)])
            scene.watermark(at_s + 1.9, scene.world.source_id)
        with scene.world.connection.transaction():
            scene.door(dice.choice(("open", "closed")), at_s + dice.uniform(0, 1.8))
            scene.watermark(at_s + 1.9, scene.door_source_id)
        self.at_s += 2
        self.batches += 1

    def close(self) -> None:
        self.enough.set()
        self.join()
        self._scene.world.close()


def _another(world: World) -> World:
    """The same map through a connection of its own."""
    again = World.__new__(World)
    again.__dict__ |= {**world.__dict__, "connection": connect(world.dsn)}
    return again


def made_by(world: World, rule: str) -> list[tuple[str, str]]:
    return world.rows(
        "select e.event_id::text, e.type from semap.event e where rule_name = %s order by 1", rule
    )


def should_be(world: World, rule: str, document: Mapping[str, object], start: datetime | None) -> list:
    with connect(world.dsn) as connection:
        events = dry_run(connection, world.name, parse_declaration(document, rule), start)
    return sorted((str(event.event_id), event.type) for event in events)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_lost_or_doubled_at_the_seam_while_states_come(world: World, seed: int) -> None:
    """The worker's sessions are cut meanwhile, so that it begins again at its last commit."""
    scene = DoorScene(world)
    world.run("delete from semap.rule")
    writer = Writer(world.dsn, scene, seed)
    dice = random.Random(seed)
    for _ in range(8):
        writer.batch()
    with running_worker(world.dsn):
        writer.start()
        for name, document in RULES.items():
            any_moment(dice, 0, 0.1)
            scene.add_rule(name, document, backfill_from_s=0)
            if dice.random() < 0.5:
                world.run(
                    "select pg_terminate_backend(pid) from pg_stat_activity where datname = current_database()"
                    " and application_name in ('semap work', 'semap replication')"
                )
        writer.close()
        await_progress(world.dsn)
    for name, document in RULES.items():
        made = made_by(world, name)
        assert made == should_be(world, name, document, None), name
        assert len(made) > 3, name


def test_a_rule_runs_from_its_stamp_on_and_begins_with_what_holds_there(world: World) -> None:
    scene = DoorScene(world)
    scene.walk("ann", [(100, 1, 1), (130, 1, 1)])
    scene.walk("bob", [(101, 6, 1), (110, 1, 2), (130, 1, 2)])
    scene.watermark(130)
    with running_worker(world.dsn):
        await_progress(world.dsn)
        scene.add_rule("crowded", CROWDED, backfill_from_s=105)
        await_progress(world.dsn)
    assert scene.events("crowded") == [("crowded", "bob", None, 110.0)]


def test_a_rule_without_a_past_begins_with_what_holds(world: World) -> None:
    """Ann is there, and the door is open, before the rules are made; neither is an event of theirs."""
    scene = DoorScene(world)
    scene.walk("ann", [(99, 1, 1), (101, 1, 1)])
    scene.walk("eve", [(100, 1, 1.5), (101, 6, 1.5)])
    scene.door("open", 100)
    scene.watermark(105)
    with running_worker(world.dsn):
        await_progress(world.dsn)
        scene.add_rule("crowded", CROWDED)
        scene.add_rule("while_open", WHILE_OPEN)
        scene.walk("bob", [(110, 1, 2), (111, 1, 2)])
        scene.door("closed", 115)
        scene.watermark(120)
        await_progress(world.dsn)
    assert scene.events("crowded") == [("crowded", "bob", None, 110.0)]
    assert sorted(scene.events("while_open")) == [
        ("while_open", "ann", "west", 115.0),
        ("while_open", "bob", "west", 115.0),
        ("while_open", "eve", "east", 115.0),
    ]


def test_a_rule_that_reads_another_gets_its_stored_events(world: World) -> None:
    scene = DoorScene(world)
    twice = {
        "input": {"rule": "room_visits"}, "partition_by": "track", "pattern": "A followed by B",
        "define": {"A": "type = 'entered'", "B": "type = 'entered'"}, "within": "1 min", "emit": "twice",
    }  # fmt: skip
    scene.walk("ann", [(100, 1, 1), (110, 6, 1), (120, 1, 1)])
    scene.watermark(130)
    with running_worker(world.dsn):
        await_progress(world.dsn)
        scene.add_rule("twice", twice, backfill_from_s=0)
        scene.walk("ann", [(140, 6, 1)])
        scene.watermark(150)
        await_progress(world.dsn)
    assert [(type_, at_s) for type_, _, _, at_s in scene.events("twice")] == [
        ("twice", 110.0),
        ("twice", 140.0),
    ]
