"""Runs semap's processes side by side and starts one again that dies."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from threading import Event as Signal
from threading import Thread
from types import FrameType

log = logging.getLogger(__name__)

FIRST_RETRY_S = 0.2
LAST_RETRY_S = 10.0
STEADY_S = 10.0
STOP_S = 10.0
WATCH_S = 0.5
PARENT_VARIABLE = "SEMAP_PARENT"
FINAL = (0, 2)
"""Done; called wrongly. Neither is mended by another start."""


@dataclass
class Process:
    """One supervised process: `semap` with these arguments.

    dsn      of its database
    may_end  one that ends by itself, or was called wrongly, is not started again
    """

    arguments: Sequence[str]
    dsn: str
    popen: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    retry_s: float = FIRST_RETRY_S
    due_s: float = 0.0
    may_end: bool = False


@dataclass
class Supervisor:
    """Starts processes with `dsn`, restarts those that end, and stops all at the end."""

    dsn: str
    processes: list[Process] = field(default_factory=list)

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, *arguments: str, dsn: str | None = None, may_end: bool = False) -> None:
        """dsn is that of another database than the others'."""
        process = Process(arguments, dsn or self.dsn, may_end=may_end)
        self.processes.append(process)
        self._spawn(process)

    def check(self) -> None:
        """Start again what has died and is due."""
        now_s = time.monotonic()
        for process in self.processes:
            if process.popen is None:
                if now_s >= process.due_s:
                    self._spawn(process)
            elif process.popen.poll() in FINAL and process.may_end:
                continue
            elif process.popen.poll() is not None:
                if now_s - process.started_s > STEADY_S:
                    process.retry_s = FIRST_RETRY_S
                log.warning(
                    "`semap %s` ended with status %s; it is started again.",
                    " ".join(process.arguments),
                    process.popen.returncode,
                )
                process.popen = None
                process.due_s = now_s + process.retry_s
                process.retry_s = min(process.retry_s * 2, LAST_RETRY_S)

    def ended(self) -> int | None:
        """The worst status of all, where none runs and none is to be started again; else None."""
        statuses = [None if each.popen is None else each.popen.poll() for each in self.processes]
        if any(status not in FINAL for status in statuses):
            return None
        return max(status for status in statuses if status is not None)

    def stop(self) -> None:
        """End all: asked first, killed after a while."""
        running = [process.popen for process in self.processes if process.popen is not None]
        for popen in running:
            popen.terminate()
        deadline_s = time.monotonic() + STOP_S
        for popen in running:
            try:
                popen.wait(max(deadline_s - time.monotonic(), 0.1))
            except subprocess.TimeoutExpired:
                popen.kill()
                popen.wait()
        self.processes.clear()

    def _spawn(self, process: Process) -> None:
        process.started_s = time.monotonic()
        process.popen = subprocess.Popen(
            [sys.executable, "-m", "semap_service", *process.arguments],
            env={**os.environ, "SEMAP_DSN": process.dsn, PARENT_VARIABLE: str(os.getpid())},
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )


def stop_signal() -> Signal:
    """Set when this process is asked to end, or when the supervisor that started it is gone."""
    stop = Signal()
    _when_told_to_end(lambda *_: stop.set())
    return stop


def leave_when_told() -> None:
    """Let this process leave, through all that it has opened, where `stop_signal` would be set."""
    _when_told_to_end(_leave)


def _when_told_to_end(act: Callable[[int, FrameType | None], None]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, act)
    parent = os.environ.get(PARENT_VARIABLE)
    if parent is not None:
        Thread(target=_watch_parent, args=(int(parent),), daemon=True).start()


def _leave(*_: object) -> None:
    # Told again, what is being closed is still closed; Ctrl-C ends that.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    raise SystemExit(0)


def _watch_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCH_S)
    os.kill(os.getpid(), signal.SIGTERM)
