"""What the rule worker's process does beside its work: each in a thread and over connections of its own."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Event as Signal
from threading import Thread

from semap.errors import SemapError, ServerUnavailable
from semap.store.database.backoff import Reminder

PATIENCE_S = 5.0


@contextmanager
def beside(name: str, work: Callable[[Signal], None]) -> Iterator[None]:
    """The work goes on in a thread as long as this lasts; it ends when its signal is set."""
    stop = Signal()
    thread = Thread(target=work, args=(stop,), name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        # a step under way is undone by the server when the process ends
        thread.join(PATIENCE_S)


def again_and_again(
    follow: Callable[[Signal], None], stop: Signal, log: logging.Logger, waits: str, retry_s: float
) -> None:
    """Begin anew whatever goes wrong, a while after it; `waits` says what is not done meanwhile."""
    reminder = Reminder(log, waits)
    while not stop.is_set():
        try:
            follow(stop)
        except SemapError as error:
            reminder.say(error)
        except Exception:
            log.exception("%s.", waits)
        stop.wait(retry_s)


class OneByOne:
    """Work on one thing after another, of which one that fails does not stop the others.

    failed  what is told of it, once for each error in a row: with the thing's id and the error
    """

    def __init__(self, log: logging.Logger, failed: str) -> None:
        self._log, self._failed = log, failed
        self._told: dict[int, str] = {}

    def each(self, ids: Iterable[int], work: Callable[[int], int]) -> int:
        """How much was done in all; raises ServerUnavailable."""
        done = 0
        for each in ids:
            try:
                done += work(each)
                self._told.pop(each, None)
            except ServerUnavailable:
                raise
            except SemapError as error:
                if self._told.get(each) != str(error):
                    self._told[each] = str(error)
                    self._log.warning(self._failed, each, error)
        return done
