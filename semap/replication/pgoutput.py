"""The pgoutput protocol, version 1 (PostgreSQL manual, "Logical Replication Message Formats").

The server sends each committed transaction as a run of messages: begin, then a relation's layout
before its first row, rows as they were inserted, updated, deleted or truncated, and commit. Values
come as text. `Assembler` is fed message by message and gives each transaction when it is whole; it
never gives part of one.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Literal

from semap.errors import UntrustedBytes

Operation = Literal["insert", "update", "delete", "truncate"]
Row = dict[str, str | None]

POSTGRES_EPOCH_US = 946_684_800_000_000
COUNT, LENGTH = struct.Struct("!H"), struct.Struct("!I")
NULL, UNCHANGED, TEXT = b"nut"
"""How the values of a row are marked."""


@dataclass(frozen=True)
class Change:
    """One row changed in `table` (schema left out).

    row  insert, update: the new row, without values that are unchanged and stored out of line, unless
         the table's replica identity is full; delete: the key of the row that went; truncate: empty
    """

    table: str
    operation: Operation
    row: Row


@dataclass(frozen=True)
class Transaction:
    """One committed transaction; a reader that has dealt with it goes on at `end_lsn`.

    committed_at_us  by the server's clock, since 1970 in UTC
    xid              its number, the lower 32 bits
    """

    end_lsn: int
    changes: tuple[Change, ...]
    committed_at_us: int = 0
    xid: int = 0


@dataclass(frozen=True)
class _Layout:
    table: str
    columns: tuple[str, ...]


@dataclass
class Assembler:
    """Gathers messages into transactions. One per connection: layouts are sent once on each."""

    _layouts: dict[int, _Layout] = field(default_factory=dict)
    _open: list[Change] | None = None
    _committed_at_us: int = 0
    _xid: int = 0

    @property
    def between_transactions(self) -> bool:
        return self._open is None

    def feed(self, message: bytes) -> Transaction | None:
        """Take one message; gives the transaction that it completes.

        raises UntrustedBytes if the message does not follow the protocol
        """
        reader = _Reader(message)
        try:
            transaction = self._take(reader.text(1), reader)
            reader.require_end()
        except (struct.error, IndexError, UnicodeDecodeError, KeyError) as error:
            raise UntrustedBytes(
                f"A message of the replication stream is malformed: {message[:40]!r}"
            ) from error
        return transaction

    def _take(self, kind: str, reader: _Reader) -> Transaction | None:
        match kind:
            case "B":
                reader.skip(8)
                self._committed_at_us = POSTGRES_EPOCH_US + reader.int64()
                self._xid = reader.uint32()
                self._open = []
            case "C":
                if self._open is None:
                    raise UntrustedBytes("The replication stream commits a transaction that never began.")
                reader.skip(1 + 8)
                transaction = Transaction(
                    reader.uint64(), tuple(self._open), self._committed_at_us, self._xid
                )
                reader.skip(8)
                self._open = None
                return transaction
            case "R":
                self._learn(reader)
            case "I" | "U" | "D":
                self._row(kind, reader)
            case "T":
                count = reader.uint32()
                reader.skip(1)
                for _ in range(count):
                    self._append(Change(self._layouts[reader.uint32()].table, "truncate", {}))
            case "O" | "Y" | "M":
                reader.skip_rest()
            case _:
                raise UntrustedBytes(f"The replication stream holds a message of unknown kind {kind!r}.")
        return None

    def _learn(self, reader: _Reader) -> None:
        oid = reader.uint32()
        reader.string()
        table = reader.string()
        reader.skip(1)
        columns = []
        for _ in range(reader.uint16()):
            reader.skip(1)
            columns.append(reader.string())
            reader.skip(4 + 4)
        self._layouts[oid] = _Layout(table, tuple(columns))

    def _row(self, kind: str, reader: _Reader) -> None:
        layout = self._layouts[reader.uint32()]
        part = reader.text(1)
        row = reader.row(layout.columns)
        if kind == "U" and part in "KO":
            reader.text(1)
            new = reader.row(layout.columns)
            row = {**row, **new} if part == "O" else new
        if kind == "D":
            row = {name: value for name, value in row.items() if part == "O" or value is not None}
        operation: Operation = {"I": "insert", "U": "update", "D": "delete"}[kind]  # type: ignore[assignment]
        self._append(Change(layout.table, operation, row))

    def _append(self, change: Change) -> None:
        if self._open is None:
            raise UntrustedBytes("The replication stream holds a row outside a transaction.")
        self._open.append(change)


class _Reader:
    """Reads big-endian values off a message, from its front."""

    def __init__(self, message: bytes) -> None:
        self._message = message
        self._at = 0

    def skip(self, count: int) -> None:
        self._take(count)

    def skip_rest(self) -> None:
        self._at = len(self._message)

    def require_end(self) -> None:
        if self._at != len(self._message):
            raise IndexError("message too long")

    def text(self, count: int) -> str:
        return self._take(count).decode()

    def uint16(self) -> int:
        return int(struct.unpack("!H", self._take(2))[0])

    def uint32(self) -> int:
        return int(struct.unpack("!I", self._take(4))[0])

    def uint64(self) -> int:
        return int(struct.unpack("!Q", self._take(8))[0])

    def int64(self) -> int:
        return int(struct.unpack("!q", self._take(8))[0])

    def string(self) -> str:
        end = self._message.find(b"\0", self._at)
        if end < 0:
            raise IndexError("unterminated string")
        value = self._message[self._at : end].decode()
        self._at = end + 1
        return value

    def row(self, columns: tuple[str, ...]) -> Row:
        """In one go: it is most of what a message holds."""
        message, at = self._message, self._at + COUNT.size
        if COUNT.unpack_from(message, self._at)[0] != len(columns):
            raise IndexError("a row and its layout differ in length")
        row: Row = {}
        for name in columns:
            kind = message[at]
            at += 1
            if kind == TEXT:
                begin = at + LENGTH.size
                at = begin + LENGTH.unpack_from(message, at)[0]
                if at > len(message):
                    raise IndexError("message too short")
                row[name] = message[begin:at].decode()
            elif kind == NULL:
                row[name] = None
            elif kind != UNCHANGED:
                raise IndexError(f"value of kind {kind}")
        self._at = at
        return row

    def _take(self, count: int) -> bytes:
        taken = self._message[self._at : self._at + count]
        if len(taken) != count:
            raise IndexError("message too short")
        self._at += count
        return taken


def format_lsn(lsn: int) -> str:
    """A position of the log as PostgreSQL writes it."""
    return f"{lsn >> 32:X}/{lsn & 0xFFFFFFFF:X}"


def parse_lsn(text: str) -> int:
    """A position of the log from PostgreSQL's writing.

    raises UntrustedBytes if it is none
    """
    high, slash, low = text.partition("/")
    try:
        if not slash:
            raise ValueError
        return (int(high, 16) << 32) | int(low, 16)
    except ValueError as error:
        raise UntrustedBytes(f"{text!r} is not a position of the log.") from error
