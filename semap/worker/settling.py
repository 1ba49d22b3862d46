"""What came in is settled: silent sources have given all, and states are compacted.

It is done in a thread of the rule worker's process and over a connection of its own. A source that says no
watermark has given all states of its newest stamp once it has been silent for a second (sql/125). States of
many tracks are compacted to chunks of one track each, of some minutes in a transaction (sql/145).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from threading import Event as Signal

import psycopg

from semap.store.database.connection import connect, translated
from semap.worker.beside import OneByOne, again_and_again, beside

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
        waits="Silent sources and states are settled later",
        retry_s=RETRY_S,
    )
    with beside("settling", work):
        yield


def _follow(dsn: str, stop: Signal) -> None:
    # a deadlock with who sends a state again is over the next time
    compacted = OneByOne(log, "States of the source %d are not compacted: %s")
    with connect(dsn, ROLE, application="semap work: settling") as connection:
        while not stop.wait(EACH_S):
            with translated():
                connection.execute("select semap.complete_silent_sources()")
                connection.execute("select semap.flush_silent_sources()")
                sources = connection.execute(
                    "select distinct source_id from semap.state_chunk where track_id is null"
                ).fetchall()
            compacted.each((source_id for (source_id,) in sources), partial(_compact, connection, stop))


def _compact(connection: psycopg.Connection, stop: Signal, source_id: int) -> int:
    """Of how many states."""
    done = 0
    with translated():
        while not stop.is_set():
            (states,) = connection.execute("select semap.compact_states(%s)", [source_id]).fetchone() or (0,)
            if not states:
                break
            done += states
    return done
