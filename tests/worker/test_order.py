"""One play, brought in in many ways: the log has the same events in the same order."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter

import pytest
from door_scene import PAPER, DoorScene, stamp, us
from rule_work import await_progress, running_worker
from server import database_with_slot
from test_backfill import RULES
from test_exactly_once import cut
from world import World

from semap.cluster import Cluster

SECONDS = 24
TRACKERS = {"near": ("ann", "bob"), "far": ("eve", "joe")}
TWICE = {
    "input": {"rule": "visits"},
    "partition_by": "room",
    "pattern": "A B",
    "within": "4 s",
    "emit": "twice",
}


@dataclass(frozen=True)
class Way:
    """How a play is brought in.

    batch     states of a statement, wherever that cuts a stamp; None: each stamp is a frame
    says      whether trackers say watermarks; otherwise all up to their newest stamps has come
    how_often the worker's sessions are ended
    """

    seed: int
    batch: int | None
    says: bool = True
    how_often: float = 0.0


WAYS = (
    Way(0, 1000),
    Way(1, 1),
    Way(2, 2, says=False, how_often=0.1),
    Way(3, 3, how_often=0.1),
    Way(4, 3, says=False),
    Way(5, None),
    Way(6, None, says=False, how_often=0.1),
)


class Play:
    """Two trackers and a door; what they bring is the same whichever way it is brought."""

    def __init__(self, dsn: str) -> None:
        self.world = World(dsn)
        self.scene = DoorScene(self.world)
        for name, document in {**RULES, **PAPER, "twice": TWICE}.items():
            self.scene.add_rule(name, document)
        self.source_ids = [self.world.source_id, self.world.add_source("far")]
        self.door_source_id = self.scene.door_source_id
        self.world.run("update semap.source set watermark = '-infinity'")
        dice = random.Random(7)
        self.states = []
        for source_id, names in zip(self.source_ids, TRACKERS.values(), strict=True):
            track_ids = [self.world.add_track(name, source_id) for name in names]
            # both at the same stamps, so that rows of either source come at one moment
            self.states.append([
                (track_id, us(100 + 0.5 * number), dice.uniform(-1, 9), 2.0, None)
                for number in range(2 * SECONDS) for track_id in track_ids
            ])  # fmt: skip

    def bring(self, way: Way) -> None:
        dice = random.Random(way.seed)
        if not way.says:
            self.world.run(
                "update semap.source set watermark = null where source_id = any (%s)", self.source_ids
            )
        left = [
            (source_id, self._batches(states, way.batch))
            for source_id, states in zip(self.source_ids, self.states, strict=True)
        ]
        doors = [(100.25 + number, ("open", "closed")[number % 2]) for number in range(SECONDS)]
        while any(batches for _, batches in left) or doors:
            source_id, batches = dice.choice([*left, (0, doors)])
            if not batches:
                continue
            with self.world.connection.transaction():
                if source_id:
                    self._write(source_id, batches.pop(0), way, batches)
                else:
                    at_s, value = doors.pop(0)
                    self.scene.door(value, at_s)
                    self.world.say(self.door_source_id, us(at_s))
            if dice.random() < way.how_often:
                cut(self.world)
        self.scene.watermark(1000, *self.source_ids, self.door_source_id)

    @staticmethod
    def _batches(states: Sequence[tuple], batch: int | None) -> list[list[tuple]]:
        if batch is None:
            return [list(of_stamp) for _, of_stamp in groupby(states, key=itemgetter(1))]
        return [list(states[first : first + batch]) for first in range(0, len(states), batch)]

    def _write(self, source_id: int, states: list[tuple], way: Way, later: list[list[tuple]]) -> None:
        newest_us = states[-1][1]
        if way.batch is None:
            self.world.send_batch(states, source_id)
        else:
            self.world.copy_states(states)
        if way.says:
            is_half = bool(later) and later[0][0][1] == newest_us
            self.world.say(source_id, newest_us - is_half)

    def log(self) -> list[tuple]:
        return self.world.rows(
            "select event_id, type, track_name, instance_name, stamp, key, measures from semap.event order by seq"
        )


@pytest.fixture(scope="module")
def log_of_all_at_once(cluster: Cluster, template: str) -> list[tuple]:
    return played(cluster, template, WAYS[0])


def played(cluster: Cluster, template: str, way: Way) -> list[tuple]:
    with database_with_slot(cluster, template) as dsn:
        play = Play(dsn)
        with running_worker(dsn):
            play.bring(way)
            await_progress(dsn)
        assert play.world.rows("select count(*) from semap.late_row union all select count(*) from semap.pending_row") == [
            (0,), (0,),
        ]  # fmt: skip
        log = play.log()
        play.world.close()
    return log


@pytest.mark.parametrize("way", WAYS[1:], ids=str)
def test_the_log_is_in_the_same_order_however_a_play_is_cut(
    cluster: Cluster, template: str, way: Way, log_of_all_at_once: list[tuple]
) -> None:
    assert played(cluster, template, way) == log_of_all_at_once


def test_the_play_has_events_of_all_rules(log_of_all_at_once: list[tuple]) -> None:
    types = {row[1] for row in log_of_all_at_once}
    assert types >= {"entered", "left", "stayed", "crowded", "opened_then_entered", "twice"}
    assert stamp(100) in {row[4] for row in log_of_all_at_once}
