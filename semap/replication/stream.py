"""The replication connection: the only place that speaks COPY_BOTH.

psycopg has no replication API; `psycopg.pq` carries it. A stream gives whole transactions and
acknowledges only what it is told to. The server may forget what was acknowledged, so a reader
acknowledges what it has made durable. Where nothing is outstanding, the server's own position is
acknowledged, so that the log of tables that nobody subscribed to is not kept for this slot.
"""

from __future__ import annotations

import select
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from psycopg import pq
from psycopg.conninfo import make_conninfo
from psycopg.pq.abc import PGconn

from semap.errors import ServerUnavailable, SlotLost, UntrustedBytes
from semap.replication.pgoutput import POSTGRES_EPOCH_US, Assembler, Transaction, format_lsn

POSTGRES_EPOCH_S = POSTGRES_EPOCH_US / 1e6
STATUS_INTERVAL_S = 5.0
OBJECT_IN_USE = b"55006"
UNDEFINED_OBJECT = b"42704"
PREREQUISITE = b"55000"


class SlotInUse(ServerUnavailable):
    """Another process reads this slot."""


@contextmanager
def losing_connection() -> Iterator[None]:
    """Whatever goes wrong while speaking to the server is a lost server."""
    try:
        yield
    except Exception as error:
        raise ServerUnavailable(f"The replication connection was lost: {error}") from error


@dataclass
class ReplicationStream:
    """An open replication connection."""

    connection: PGconn
    assembler: Assembler = field(default_factory=Assembler)
    received_lsn: int = 0
    acknowledged_lsn: int = 0
    handed_out_lsn: int = 0
    status_due_s: float = 0.0

    def receive(self, timeout_s: float, limit: int = 1000) -> list[Transaction]:
        """The transactions that are there, at most `limit`; waits up to `timeout_s` for the first.

        raises ServerUnavailable when the connection is lost
        """
        transactions: list[Transaction] = []
        deadline_s = time.monotonic() + timeout_s
        while len(transactions) < limit:
            with losing_connection():
                size, data = self.connection.get_copy_data(1)
            if size > 0:
                transaction = self._take(bytes(data or b""))
                if transaction is not None:
                    transactions.append(transaction)
                continue
            if size < 0:
                raise ServerUnavailable(f"The replication stream ended: {_message(self.connection)}")
            self._report_when_due()
            if transactions or not self._wait(deadline_s):
                break
        return transactions

    def acknowledge(self, lsn: int) -> None:
        """Tell the server that everything before `lsn` is durable here; it never goes back."""
        if lsn > self.acknowledged_lsn:
            self.acknowledged_lsn = lsn
            self._send_status()

    def close(self) -> None:
        self.connection.finish()

    def _take(self, data: bytes) -> Transaction | None:
        kind = data[:1]
        try:
            if kind == b"w":
                transaction = self.assembler.feed(data[25:])
                if transaction is not None:
                    self.handed_out_lsn = transaction.end_lsn
                return transaction
            if kind == b"k":
                wal_end, _, reply = struct.unpack("!QQB", data[1:18])
                self._idle_until(wal_end)
                if reply:
                    self._send_status()
                return None
        except struct.error as error:
            raise UntrustedBytes(
                f"A message of the replication stream is malformed: {data[:40]!r}"
            ) from error
        raise UntrustedBytes(f"The replication stream holds a message of unknown kind {kind!r}.")

    def _idle_until(self, wal_end: int) -> None:
        self.received_lsn = max(self.received_lsn, wal_end)
        if self.assembler.between_transactions and self.acknowledged_lsn >= self.handed_out_lsn:
            self.acknowledged_lsn = max(self.acknowledged_lsn, wal_end)

    def _wait(self, deadline_s: float) -> bool:
        left_s = min(deadline_s, self.status_due_s) - time.monotonic()
        readable, _, _ = select.select([self.connection.socket], [], [], max(left_s, 0.0))
        if readable:
            with losing_connection():
                self.connection.consume_input()
            return True
        return time.monotonic() < deadline_s

    def _report_when_due(self) -> None:
        if time.monotonic() >= self.status_due_s:
            self._send_status()

    def _send_status(self) -> None:
        self.status_due_s = time.monotonic() + STATUS_INTERVAL_S
        now_us = int((time.time() - POSTGRES_EPOCH_S) * 1e6)
        lsn = self.acknowledged_lsn
        with losing_connection():
            self.connection.put_copy_data(struct.pack("!cQQQQB", b"r", lsn, lsn, lsn, now_us, 0))
            self.connection.flush()


def open_stream(dsn: str, slot: str, publications: Sequence[str], start_lsn: int) -> ReplicationStream:
    """Read `slot` from `start_lsn` on.

    raises SlotInUse while another process reads it, SlotLost where it is gone, ServerUnavailable
    """
    connection = connect_replication(dsn)
    return start(connection, slot, publications, start_lsn)


def connect_replication(dsn: str) -> PGconn:
    """A connection that speaks the replication protocol, before it streams."""
    conninfo = make_conninfo(
        dsn,
        replication="database",
        application_name="semap replication",
        connect_timeout=10,
        client_encoding="UTF8",
        options="-c timezone=UTC -c datestyle=ISO -c extra_float_digits=1",
    )
    connection = pq.PGconn.connect(conninfo.encode())
    if connection.status != pq.ConnStatus.OK:
        message = _message(connection)
        connection.finish()
        raise ServerUnavailable(message, "See that the server runs and that the role may replicate.")
    return connection


def start(connection: PGconn, slot: str, publications: Sequence[str], start_lsn: int) -> ReplicationStream:
    """Let a replication connection stream."""
    names = ",".join(publications)
    command = (
        f'START_REPLICATION SLOT "{slot}" LOGICAL {format_lsn(start_lsn)} '
        f"(proto_version '1', publication_names '{names}')"
    )
    with losing_connection():
        result = connection.exec_(command.encode())
    if result.status != pq.ExecStatus.COPY_BOTH:
        state = result.error_field(pq.DiagnosticField.SQLSTATE)
        message = _message(connection)
        connection.finish()
        if state == OBJECT_IN_USE:
            raise SlotInUse(
                f"Another worker reads the slot {slot}.", "It is taken over as soon as it is free."
            )
        if state in (UNDEFINED_OBJECT, PREREQUISITE):
            raise SlotLost(
                message, "Run `semap db resync`: it makes the slot again and catches up from the tables."
            )
        raise ServerUnavailable(message)
    connection.nonblocking = 1
    return ReplicationStream(connection, acknowledged_lsn=start_lsn, handed_out_lsn=start_lsn)


def _message(connection: PGconn) -> str:
    return connection.get_error_message().strip() or "the server closed the connection"
