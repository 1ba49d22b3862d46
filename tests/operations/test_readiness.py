"""Whether the service is ready is judged by what the worker does, not by the slot that it holds."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

from patience import until
from world import World

from semap.store.database.connection import one_transaction
from semap.store.operate.readiness import SILENT_S, lacks, read_state

BACK = "update semap.progress set alive_at = clock_timestamp() - make_interval(secs => %s)"


def lacking(world: World) -> dict[str, str]:
    with one_transaction(world.dsn, "semap_read") as connection:
        return dict(lacks(connection, feed_connected=True))


def test_a_worker_that_is_stopped_is_not_ready(world: World) -> None:
    """It holds its slot all the while; a minute of the database's clock goes by at once."""
    worker = subprocess.Popen(
        [sys.executable, "-m", "semap_service", "work"],
        env={**os.environ, "SEMAP_DSN": world.dsn},
        stderr=subprocess.DEVNULL,
    )
    try:
        until(lambda: not lacking(world))
        worker.send_signal(signal.SIGSTOP)
        world.run(BACK, SILENT_S + 1)
        said = lacking(world)
        assert said.keys() == {"worker"}
        assert said["worker"].startswith("runs and makes no progress, and was last at work 31 s ago")
        worker.send_signal(signal.SIGCONT)
        until(lambda: not lacking(world))
    finally:
        worker.kill()
        worker.wait()
    until(lambda: "does not run" in lacking(world).get("worker", ""))


def test_a_worker_that_is_late_by_less_is_at_work(world: World) -> None:
    world.run(BACK, SILENT_S / 2)
    with one_transaction(world.dsn, "semap_read") as connection:
        state = read_state(connection)
    assert state.silent_s is not None
    assert SILENT_S / 2 <= state.silent_s < SILENT_S
    assert not state.is_at_work  # nobody reads the slot
