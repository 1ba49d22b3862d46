"""Brings results into the database, whatever happens to the server meanwhile.

Results are counted: perception gives the same ones in the same order each time, so that the first so many,
which were committed by this process or by one before it, are passed over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from threading import Event as Signal

import psycopg

from semap.errors import Conflict, ServerUnavailable
from semap.store.database import connect
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.writing import ROLE, Registered, Writer, register

FIRST_RETRY_S = 0.05
LAST_RETRY_S = 2.0
LOCK = 7366
"""First key of the advisory lock that keeps a second process from the same recording."""


@dataclass(frozen=True)
class Target:
    """Where results go: a map, a source on it, the recording that they are of, and the height of the
    floor."""

    dsn: str
    map_name: str
    source: str
    path: str
    fingerprint: str
    floor_z_m: float


class Delivery:
    """Mutable: results that wait for their commit, and how many were committed."""

    def __init__(self, target: Target, stop: Signal, committed: Callable[[Found], None]) -> None:
        self._target = target
        self._stop = stop
        self._committed = committed
        self._waiting: list[Found] = []
        self._taken = 0
        self._connection, self._registered, self._writer = self._open()
        self.resumed_at = self._registered.done
        self.was_finished = self._registered.finished

    def add(self, found: Found) -> None:
        """Keep what follows from one record for the next commit."""
        if found.persons or found.lines:
            self._taken += 1
        if self._taken > self.resumed_at:
            self._waiting.append(found)

    def commit(self, *, is_over: bool = False) -> None:
        """Write what waits, in one transaction; a server that is away is awaited.

        is_over  nothing more is to come of this recording
        raises   ServerUnavailable, where it is away and `stop` is set
        """
        if not self._waiting and not is_over:
            return
        wait_s = FIRST_RETRY_S
        while True:
            try:
                if self._connection.closed:
                    self._connection, self._registered, self._writer = self._open()
                    # the commit whose answer was lost may have been made
                    if self._registered.done >= self._taken and self._registered.finished >= is_over:
                        break
                self._writer.commit(self._waiting, self._taken, is_over=is_over)
                break
            except ServerUnavailable:
                self._connection.close()
                if self._stop.wait(wait_s):
                    raise
                wait_s = min(wait_s * 2, LAST_RETRY_S)
        for found in self._waiting:
            self._committed(found)
        self._waiting.clear()

    def close(self) -> None:
        """Leave the recording to others."""
        self._connection.close()

    def _open(self) -> tuple[psycopg.Connection, Registered, Writer]:
        target = self._target
        connection = connect(target.dsn, ROLE, application="semap ingest", autocommit=False)
        try:
            registered = register(connection, target.map_name, target.source, target.path, target.fingerprint)
            with connection.transaction():
                row = connection.execute(
                    "select pg_try_advisory_lock(%s, %s)", [LOCK, registered.recording_id]
                ).fetchone()
            if not (row and row[0]):
                raise Conflict(
                    f"Another process is bringing in {target.path}.", "Wait until it is done, or end it."
                )
        except BaseException:
            connection.close()
            raise
        return connection, registered, Writer(connection, registered, target.source, target.floor_z_m)
