"""Brings results into the database, whatever happens to the server meanwhile.

Results are counted: perception gives the same ones in the same order each time, so that the first so many,
which were committed by this process or by another, are passed over.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from threading import Event as Signal

import psycopg

from semap.errors import ServerUnavailable
from semap.store.database.backoff import Patience
from semap.store.database.connection import connect
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.registration import Found as Known
from semap_ingest.pipeline.registration import look_up, register
from semap_ingest.pipeline.writing import Writer

ROLE = "semap_ingest"

log = logging.getLogger(__name__)


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


@dataclass(frozen=True, eq=False)
class _Numbered:
    """number  of the last result up to here, counted from 1"""

    number: int
    found: Found

    @property
    def is_result(self) -> bool:
        return bool(self.found.persons or self.found.lines)


class Delivery:
    """Mutable: results that wait for their commit, and how many were committed.

    resumed_at    results that were there before
    was_finished  so were all
    """

    def __init__(self, target: Target, stop: Signal, committed: Callable[[Found], None]) -> None:
        self._target = target
        self._stop = stop
        self._committed = committed
        self._waiting: list[_Numbered] = []
        self._taken = 0
        self._writer: Writer | None = None
        self._connection, self._known = self._open()
        self._done = self._known.done
        self.resumed_at, self.was_finished = self._known.done, self._known.finished

    @property
    def is_catching_up(self) -> bool:
        """Whether what comes next was there before."""
        return self._taken < self._done

    def add(self, found: Found) -> None:
        """Keep what follows from one record for the next commit."""
        self._taken += bool(found.persons or found.lines)
        numbered = _Numbered(self._taken, found)
        if self._is_new(numbered):
            self._waiting.append(numbered)

    def commit(self, *, is_over: bool = False) -> None:
        """Write what waits, in one transaction; a server that is away is awaited.

        is_over  nothing more is to come of this recording
        raises   ServerUnavailable, where it is away and `stop` is set; Conflict, where another process has
                 taken over; NotFound, where the source was deleted
        """
        if self._writer is None and not is_over and not any(each.is_result for each in self._waiting):
            # a source is made with its first result; until then the newest watermark will do
            del self._waiting[:-1]
            return
        patience = Patience(log, f"{len(self._waiting)} results wait")
        while self._waiting or is_over:
            try:
                self._write(is_over)
                patience.restored()
                break
            except ServerUnavailable as error:
                self._connection.close()
                if patience.wait(error, self._stop):
                    raise
        for each in self._waiting:
            self._committed(each.found)
        self._waiting.clear()

    def give_up(self) -> None:
        """Write what waits, and let rules not wait for what the recording does not give any more."""
        self.commit()
        if self._writer is not None and not self._connection.closed:
            self._writer.end_sources()

    def close(self) -> None:
        """Leave the recording to others."""
        self._connection.close()

    def _write(self, is_over: bool) -> None:
        if self._connection.closed:
            self._writer = None
            self._connection, self._known = self._open()
            self._done = self._known.done
        # a commit whose answer was lost may have been made
        batch = [each.found for each in self._waiting if self._is_new(each)]
        if batch or (is_over and not self._known.finished):
            done = max(self._done, self._taken)
            self._writer = self._writer or self._new_writer()
            self._writer.commit(batch, done, is_over=is_over)
            self._done = done

    def _is_new(self, each: _Numbered) -> bool:
        return each.number > self._done or (each.number == self._done and not each.is_result)

    def _new_writer(self) -> Writer:
        target = self._target
        registered = register(self._connection, self._known, target.source, target.path, target.fingerprint)
        return Writer(self._connection, registered, target.source, target.floor_z_m)

    def _open(self) -> tuple[psycopg.Connection, Known]:
        target = self._target
        connection = connect(target.dsn, ROLE, application="semap ingest", autocommit=False)
        try:
            known = look_up(connection, target.map_name, target.source, target.fingerprint, self._stop)
        except BaseException:
            connection.close()
            raise
        return connection, known
