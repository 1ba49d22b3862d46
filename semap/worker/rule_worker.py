"""The rule worker: reads changes off the log, lets the rules make events, commits them.

Everything that the worker makes of a stretch of the log is committed in one transaction with the end of
that stretch: events, the states of rules, rows that wait or came too late, watermarks. Only then is it
acknowledged to the server. Killed at any moment the worker begins again where it had committed, and makes the
same events with the same ids.

A stretch that made no event is committed at the latest after a second. One worker reads at a time: the slot
belongs to it, and the place in the log is compared when it is moved. Another one waits and takes over.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from threading import Event as Signal

import psycopg

from semap.errors import ServerUnavailable, ServiceUnreachable, SlotLost
from semap.intake.map_facts import PUBLICATION as MAP_PUBLICATION
from semap.intake.stretch import Stretch
from semap.replication.pgoutput import format_lsn
from semap.replication.stream import ReplicationStream, SlotInUse, open_stream
from semap.store.database.backoff import Patience
from semap.store.database.connection import connect, translated
from semap.worker.making import Making
from semap.worker.progress import ROLE, load_progress, note_idle, say_alive
from semap.worker.publishing import Publishing

log = logging.getLogger(__name__)

PUBLICATIONS = ("semap_change", "semap_rule", MAP_PUBLICATION)
QUIET_COMMIT_S = 1.0
RECEIVE_S = 0.5
ALIVE_S = 5.0
"""So often the worker says that it is at work, in the same thread, so that one that hangs does not."""


def work(dsn: str, stop: Signal, making: Callable[..., Making | Publishing] = Making) -> None:
    """Follow the log until `stop` is set; a lost server or broker is awaited, a taken slot too.

    making  what is done with what the log says, of a connection, a stretch and progress
    raises  SlotLost where the slot is gone, so that changes may have been missed; Conflict as `making` does
    """
    patience = Patience(log, "Changes wait to become events")
    while not stop.is_set():
        try:
            for _ in _follow(dsn, stop, making):
                patience.restored()
        except SlotLost:
            raise
        except (ServerUnavailable, ServiceUnreachable, psycopg.OperationalError) as error:
            patience.wait(error, stop, logging.INFO if isinstance(error, SlotInUse) else logging.WARNING)


def _follow(dsn: str, stop: Signal, making: Callable[..., Making | Publishing]) -> Iterator[None]:
    """Read and commit; yields after a commit, so that its caller knows that all is well."""
    with connect(dsn, ROLE, application="semap work") as connection:
        # a look-up over many partitions looks dear, and is over long before it would be compiled
        connection.execute("set jit = off")
        progress = load_progress(connection)
        if progress.lsn == 0:
            raise SlotLost("A `semap db resync` was begun and did not end.", "Run `semap db resync` again.")
        stretch = Stretch(connection, progress, time.monotonic())
        made = making(connection, stretch, progress)
        stream = open_stream(dsn, _slot(connection), PUBLICATIONS, progress.lsn)
        log.info(
            "Following the log from %s with %d rules.", format_lsn(progress.lsn), len(progress.intake.rules)
        )
        try:
            yield from Reading(connection, stream, stretch, made).run(stop)
        finally:
            stream.close()


class Reading:
    """Mutable: the log as it comes in, and how much of it is committed."""

    def __init__(
        self,
        connection: psycopg.Connection,
        stream: ReplicationStream,
        stretch: Stretch,
        making: Making | Publishing,
    ) -> None:
        self._connection = connection
        self._stream = stream
        self._progress = progress = making.progress
        self._stretch = stretch
        self._making = making
        self._committed_lsn = progress.lsn
        self._commit_due_s: float | None = None
        self._given_up = progress.rules.given_up
        self._alive_due_s = 0.0

    def run(self, stop: Signal) -> Iterator[None]:
        while not stop.is_set():
            for transaction in self._stream.receive(RECEIVE_S):
                if self._stretch.begins_a_rule(transaction) and self._commit_due_s is not None:
                    self._commit()
                if self._commit_due_s is None:
                    self._commit_due_s = time.monotonic() + QUIET_COMMIT_S
                self._making.take(transaction, time.monotonic())
            self._note_silence()
            if self._making.has_made() or (self._commit_due_s or float("inf")) <= time.monotonic():
                self._commit()
                yield
            self._say_alive()
        if self._commit_due_s is not None:
            self._commit()

    def _say_alive(self) -> None:
        """Only with nothing left to commit: what cannot be committed is no work."""
        if self._commit_due_s is None and self._alive_due_s <= time.monotonic():
            say_alive(self._connection)
            self._alive_due_s = time.monotonic() + ALIVE_S

    def _commit(self) -> None:
        lsn = self._progress.lsn
        self._making.commit(self._connection, self._committed_lsn)
        self._committed_lsn, self._commit_due_s = lsn, None
        self._stream.acknowledge(lsn)
        self._say_what_was_given_up()

    def _note_silence(self) -> None:
        silent = self._stretch.silent(time.monotonic())
        if silent:
            note_idle(self._connection, silent)

    def _say_what_was_given_up(self) -> None:
        rules = self._progress.rules
        given_up = rules.given_up
        for rule_id, each in given_up.items():
            if each != self._given_up.get(rule_id):
                log.warning("Rule %s: %s", rules.rules[rule_id].name, each.as_text())
        self._given_up = given_up


def _slot(connection: psycopg.Connection) -> str:
    with translated():
        row = connection.execute("select semap.rule_slot()").fetchone()
    return "" if row is None else str(row[0])
