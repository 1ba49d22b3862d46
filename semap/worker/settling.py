"""What came in is settled within seconds: silent sources have given all, and frames become rows of states.

It is done in a thread of the rule worker's process and over a connection of its own, of frames a few thousand
states in a transaction. A source that says no watermark has given all states of its newest stamp once it has
been silent for a second (sql/125). Where no worker runs, whoever writes frames makes rows of those that are a
minute old (sql/146).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from threading import Event as Signal

import psycopg

from semap.errors import SemapError, ServerUnavailable
from semap.store.database.connection import connect, translated
from semap.worker.beside import again_and_again, beside

log = logging.getLogger(__name__)

ROLE = "semap_worker"
EACH_S = 1.0
RETRY_S = 5.0


@contextmanager
def settling(dsn: str) -> Iterator[None]:
    """What came in is settled as long as this lasts."""
    follow = partial(_follow, dsn)
    work = partial(
        again_and_again,
        follow,
        log=log,
        waits="Silent sources and frames of states are settled later",
        retry_s=RETRY_S,
    )
    with beside("settling", work):
        yield


def _follow(dsn: str, stop: Signal) -> None:
    said: dict[int, str] = {}
    with connect(dsn, ROLE, application="semap work: settling") as connection:
        while not stop.wait(EACH_S):
            with translated():
                connection.execute("select semap.complete_silent_sources()")
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
