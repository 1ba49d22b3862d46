"""States of past days, written as they would lie there, and maintenance that is due for them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import psycopg
from world import World

from semap.store.operate.maintenance import Maintained, maintain

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
        for table in ("track_state", "line_observation"):
            connection.execute(f"comment on table semap.{table}_{day:%Y%m%d} is null")


def write(connection: psycopg.Connection, rows: Sequence[Sequence[object]]) -> None:
    """Rows of COLUMNS, past the triggers; the last columns may be missing."""
    connection.execute("set session_replication_role = replica")
    with connection.cursor() as cursor, cursor.copy(
        f"copy semap.track_state ({', '.join(COLUMNS)}) from stdin (format binary)"
    ) as copy:  # fmt: skip
        copy.set_types(["int8", "timestamptz", *["float8"] * 3, "float4", "bool", *["float4"] * 6])
        for row in rows:
            copy.write_row(_whole(row))
    connection.execute("set session_replication_role = origin")


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


def retain(
    connection: psycopg.Connection, kind: str, pack: str | None = None, drop: str | None = None
) -> None:
    connection.execute(
        "update semap.retention set pack_after = %s, drop_after = %s where kind = %s", [pack, drop, kind]
    )


def pack_all(world: World) -> Maintained:
    """Pack whatever is older than a day."""
    retain(world.connection, "states", pack="1 d")
    return maintain(world.dsn)
