"""States of past days, written as they would lie there, and maintenance that is due for them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import psycopg

COLUMNS = (
    "track_id", "stamp", "x_m", "y_m", "z_m", "std_m", "is_last", "heading_rad", "speed_mps", "length_m", "width_m",
    "std_across_m", "std_yaw_rad",
)  # fmt: skip
FORMS = {"x_m": "d", "y_m": "d", "z_m": "d"} | dict.fromkeys(COLUMNS[7:], "f") | {"std_m": "f"}
Bits = tuple[object, ...]


def midnight(days_ago: int) -> datetime:
    """The beginning of a day (UTC)."""
    today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
    return today - timedelta(days=days_ago)


def make_partitions(connection: psycopg.Connection, *days_ago: int) -> None:
    """As if they had been there for long."""
    days = [midnight(each).date() for each in days_ago]
    connection.execute("select semap.ensure_partitions(%s::date[])", [days])
    for day in days:
        for table in ("state_chunk", "line_observation"):
            connection.execute(f"comment on table semap.{table}_{day:%Y%m%d} is null")


def write(connection: psycopg.Connection, rows: Sequence[Sequence[object]]) -> None:
    """Rows of COLUMNS, past the functions that move tracks; the last columns may be missing."""
    connection.execute("create temp table if not exists given (like semap.track_state)")
    connection.execute("truncate given")
    with connection.cursor() as cursor, cursor.copy(
        f"copy given ({', '.join(COLUMNS)}) from stdin (format binary)"
    ) as copy:  # fmt: skip
        copy.set_types(["int8", "timestamptz", *["float8"] * 3, "float4", "bool", *["float4"] * 6])
        for row in rows:
            copy.write_row(_whole(row))
    connection.execute(
        "insert into semap.state_chunk select c.* from ("
        " select stamp, array_agg(track_id) as ids, count(*) as states,"
        + ", ".join(f"array_agg({name}) as {name}" for name in COLUMNS[2:])
        + " from given group by stamp) s cross join lateral semap.new_chunk("
        " source_id => 0, from_stamp => stamp, to_stamp => stamp, track_ids => ids, "
        + ", ".join(f"{name} => s.{name}" for name in COLUMNS[2:])
        + ") c"
    )


def compact(connection: psycopg.Connection) -> None:
    """All states, of whatever source."""
    connection.execute(
        "select semap.compact_all(array(select distinct source_id from semap.state_chunk where track_id is null))"
    )


def bits(row: Sequence[object]) -> Bits:
    """A state with its numbers as bytes: equal only if each bit is."""
    return tuple(
        value if value is None or name not in FORMS else struct.pack(FORMS[name], value)
        for name, value in zip(COLUMNS, _whole(row), strict=True)
    )


def _whole(row: Sequence[object]) -> list[object]:
    return [*row, *[None] * (len(COLUMNS) - len(row))]


def stored(connection: psycopg.Connection, relation: str = "stored_state") -> list[Bits]:
    with connection.cursor(binary=True) as cursor:
        found = cursor.execute(f"select {', '.join(COLUMNS)} from semap.{relation} order by track_id, stamp")
        return [bits(row) for row in found.fetchall()]


def retain(connection: psycopg.Connection, kind: str, drop: str | None = None) -> None:
    connection.execute("update semap.retention set drop_after = %s where kind = %s", [drop, kind])
