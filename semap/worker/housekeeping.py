"""The rule worker's process keeps the database in shape once an hour, beside its work.

It does so in a thread and over a connection of its own, and waits for the server nearly all of the time, so
that no event is later for it. Whatever goes wrong is logged, and tried again the next time.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from threading import Event as Signal

from semap.errors import SemapError
from semap.store.operate.maintenance import Maintained, maintain
from semap.worker.beside import beside

log = logging.getLogger(__name__)

FIRST_S = 60.0
EACH_S = 3600.0


@contextmanager
def housekeeping(dsn: str, first_s: float = FIRST_S, each_s: float = EACH_S) -> Iterator[None]:
    """Maintenance as long as this lasts: a minute after its beginning, and then each hour."""
    with beside("housekeeping", partial(_keep, dsn, first_s=first_s, each_s=each_s)):
        yield


def _keep(dsn: str, stop: Signal, first_s: float, each_s: float) -> None:
    wait_s = first_s
    while not stop.wait(wait_s):
        wait_s = each_s
        try:
            _say(maintain(dsn, stop=stop))
        except SemapError as error:
            log.warning("Maintenance is left for the next time: %s", error)
        except Exception:
            log.exception("Maintenance failed.")


def _say(done: Maintained) -> None:
    if done.dropped_days or done.dropped_rows:
        log.info(
            "Maintenance dropped %d partitions and %d rows.",
            sum(len(days) for days in done.dropped_days.values()),
            sum(done.dropped_rows.values()),
        )
    if done.put_off:
        log.info("Left for the next time, since it was in use: %s.", ", ".join(done.put_off[:5]))
