"""What came as frames becomes rows of `track_state` within seconds (sql/146).

It is done in a thread of the rule worker's process and over a connection of its own, a few thousand states in
a transaction. Where no worker runs, whoever writes frames does it once they are a minute old.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event as Signal
from threading import Thread

import psycopg

from semap.errors import SemapError, ServerUnavailable
from semap.store.database import connect, translated

log = logging.getLogger(__name__)

ROLE = "semap_worker"
EACH_S = 1.0
RETRY_S = 5.0
PATIENCE_S = 5.0


@contextmanager
def unfolding(dsn: str) -> Iterator[None]:
    """Frames become rows as long as this lasts."""
    stop = Signal()
    thread = Thread(target=_keep, args=(dsn, stop), name="unfolding", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        # a step under way is undone by the server when the process ends
        thread.join(PATIENCE_S)


def _keep(dsn: str, stop: Signal) -> None:
    said = ""
    while not stop.is_set():
        try:
            _follow(dsn, stop)
        except SemapError as error:
            if str(error) != said:
                said = str(error)
                log.warning("Frames of states become rows later: %s", error)
        except Exception:
            log.exception("Frames of states become rows later.")
        stop.wait(RETRY_S)


def _follow(dsn: str, stop: Signal) -> None:
    said: dict[int, str] = {}
    with connect(dsn, ROLE, application="semap work: frames") as connection:
        while not stop.wait(EACH_S):
            with translated():
                connection.execute("select semap.settle_silent_sources()")
                sources = connection.execute(
                    "select distinct source_id from semap.track_state_frame"
                ).fetchall()
            for (source_id,) in sources:
                try:
                    _unfold(connection, source_id, stop)
                except ServerUnavailable:
                    raise
                except SemapError as error:
                    # the others go on; a deadlock with who sends a state again is over the next time
                    if said.get(source_id) != str(error):
                        said[source_id] = str(error)
                        log.warning("Frames of the source %d do not become rows: %s", source_id, error)


def _unfold(connection: psycopg.Connection, source_id: int, stop: Signal) -> None:
    with translated():
        while not stop.is_set():
            (frames,) = connection.execute("select semap.unfold_frames(%s)", [source_id]).fetchone() or (0,)
            if not frames:
                return
