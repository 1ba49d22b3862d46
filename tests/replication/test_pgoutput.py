"""The bytes of pgoutput, made here as the manual describes them, and malformed ones."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from semap.errors import UntrustedBytes
from semap.replication.pgoutput import Assembler, Change, Transaction, format_lsn, parse_lsn


def text(value: str | None) -> bytes:
    if value is None:
        return b"n"
    data = value.encode()
    return b"t" + struct.pack("!I", len(data)) + data


def tuple_data(*values: str | None) -> bytes:
    return struct.pack("!H", len(values)) + b"".join(text(value) for value in values)


BEGIN = b"B" + struct.pack("!QqI", 500, -1_000_000, 7)
COMMIT = b"C\0" + struct.pack("!QQQ", 500, 540, 0)
LAYOUT = (
    b"R" + struct.pack("!I", 16) + b"semap\0rule\0d" + struct.pack("!H", 2)
    + b"\1id\0" + struct.pack("!Ii", 23, -1) + b"\0name\0" + struct.pack("!Ii", 25, -1)
)  # fmt: skip
ROW = struct.pack("!I", 16)
MESSAGES = [
    BEGIN,
    LAYOUT,
    b"I" + ROW + b"N" + tuple_data("1", "größe"),
    b"U" + ROW + b"N" + tuple_data("1", None),
    b"U" + ROW + b"K" + tuple_data("1", None) + b"N" + tuple_data("2", "b"),
    b"U" + ROW + b"N" + struct.pack("!H", 2) + text("2") + b"u",
    b"U" + ROW + b"O" + tuple_data("2", "long") + b"N" + struct.pack("!H", 2) + text("3") + b"u",
    b"D" + ROW + b"K" + tuple_data("2", None),
    b"T" + struct.pack("!I", 1) + b"\0" + ROW,
    b"O" + struct.pack("!Q", 0) + b"origin\0",
    COMMIT,
]
CHANGES = (
    Change("rule", "insert", {"id": "1", "name": "größe"}),
    Change("rule", "update", {"id": "1", "name": None}),
    Change("rule", "update", {"id": "2", "name": "b"}),
    Change("rule", "update", {"id": "2"}),
    Change("rule", "update", {"id": "3", "name": "long"}),
    Change("rule", "delete", {"id": "2"}),
    Change("rule", "truncate", {}),
)


def test_a_transaction_comes_whole_at_its_commit() -> None:
    assembler = Assembler()
    given_out = [assembler.feed(message) for message in MESSAGES]
    assert given_out == [None] * 10 + [Transaction(540, CHANGES, 946_684_799_000_000, 7)]
    assert assembler.between_transactions


@pytest.mark.parametrize(
    "messages",
    [
        [b"I" + ROW + b"N" + tuple_data("1", "a")],
        [BEGIN, b"I" + ROW + b"N" + tuple_data("1", "a")],
        [LAYOUT, b"I" + ROW + b"N" + tuple_data("1", "a")],
        [BEGIN, LAYOUT, b"I" + ROW + b"N" + tuple_data("1")],
        [BEGIN, LAYOUT, b"I" + ROW + b"N" + struct.pack("!H", 2) + b"x"],
        [BEGIN, LAYOUT, b"I" + ROW + b"N" + struct.pack("!H", 2) + text("1") + b"t\0\0\0\1\xff"],
        [COMMIT],
        [b"?"],
        [b""],
    ],
)
def test_what_breaks_the_protocol_is_an_error(messages: list[bytes]) -> None:
    assembler = Assembler()
    for message in messages[:-1]:
        assembler.feed(message)
    with pytest.raises(UntrustedBytes):
        assembler.feed(messages[-1])


@given(st.integers(0, len(MESSAGES) - 1), st.data())
def test_a_cut_message_is_an_error_and_never_a_wrong_row(which: int, data: st.DataObject) -> None:
    message = MESSAGES[which]
    cut = message[: data.draw(st.integers(0, len(message) - 1))]
    assembler = Assembler()
    for earlier in MESSAGES[:which]:
        assembler.feed(earlier)
    if message[:1] == b"O" and cut:
        assert assembler.feed(cut) is None
    else:
        with pytest.raises(UntrustedBytes):
            assembler.feed(cut)


@given(st.integers(0, 2**64 - 1))
def test_lsn_round_trip(lsn: int) -> None:
    assert parse_lsn(format_lsn(lsn)) == lsn


def test_lsn_as_postgresql_writes_it() -> None:
    assert format_lsn(0x16_B374D848) == "16/B374D848"
    for wrong in ("", "16", "x/y", "1/"):
        with pytest.raises(UntrustedBytes):
            parse_lsn(wrong)
