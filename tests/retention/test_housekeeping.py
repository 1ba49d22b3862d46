"""The rule worker's process does what is due by itself, and goes on whatever happens to it."""

from __future__ import annotations

import time
from collections.abc import Callable
from unittest.mock import patch

import pytest
from past_days import make_partitions, midnight, retain, write
from patience import moment
from rule_work import await_event_of, running_worker
from shapely import box
from world import SECOND_US, World

from semap.store.operate.maintenance import Maintained
from semap.timeline.stamp import to_us
from semap.worker import housekeeping

PATIENCE_S = 20.0


def await_true(ask: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not ask():
        assert time.monotonic() < deadline_s
        moment()


def test_old_states_are_dropped_while_events_are_made(world: World) -> None:
    make_partitions(world.connection, 4)
    rows = [
        (9, midnight(4).replace(hour=hour), 1.0, 2.0, None, None, False, *[None] * 4) for hour in range(24)
    ]
    write(world.connection, rows)
    retain(world.connection, "states", drop="1 d")
    world.add_room("den", box(0, 0, 4, 4))
    track = world.add_track("t")
    with running_worker(world.dsn), housekeeping.housekeeping(world.dsn, first_s=0, each_s=0.2):
        world.add_states([(track, to_us(midnight(0)) + SECOND_US, 1, 1, None)])
        world.run("update semap.source set watermark = %s, ended = true", midnight(0).replace(minute=1))
        await_event_of(world.dsn, "t", "entered")
        await_true(lambda: world.one("select count(*) from semap.stored_state") == 1)
        write(world.connection, rows[:1])
        await_true(lambda: world.one("select count(*) from semap.stored_state") == 1)


def test_a_failure_is_told_and_tried_again(world: World, caplog: pytest.LogCaptureFixture) -> None:
    calls = []

    def failing(*_: object, **__: object) -> Maintained:
        calls.append(1)
        if len(calls) == 1:
            raise OSError("the disk is full")
        return Maintained(put_off=["states of tracks of 2026-01-31"])

    with (
        patch.object(housekeeping, "maintain", failing),
        housekeeping.housekeeping("", first_s=0, each_s=0.01),
    ):
        await_true(lambda: len(calls) > 2)
    assert "the disk is full" in caplog.text


def test_a_server_that_is_away_is_told_in_a_line(caplog: pytest.LogCaptureFixture) -> None:
    with housekeeping.housekeeping("host=/nowhere port=1", first_s=0, each_s=60):
        await_true(lambda: "left for the next time" in caplog.text)
    assert "Traceback" not in caplog.text
