"""States of tracks in PostgreSQL's binary COPY format, made of whole arrays at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray

from semap.model.track_state import COORDINATES, MEASURES

COLUMNS = ("track_id", "stamp", *COORDINATES, "std_m", "is_last")
"""Those that `pack_states` always writes."""

POSTGRES_EPOCH_US = 946_684_800_000_000
HEADER = b"PGCOPY\n\xff\r\n\0" + bytes(8)
TRAILER = b"\xff\xff"

TYPES = {
    "track_id": ">i8",
    "stamp": ">i8",
    "is_last": "?",
    **dict.fromkeys(COORDINATES, ">f8"),
    **dict.fromkeys(MEASURES, ">f4"),
}
NULLABLE = ("z_m", *MEASURES)


def copy_statement(*measures: str) -> str:
    """Takes what `pack_states` makes where it is given these measures."""
    return f"copy semap.track_state ({', '.join((*COLUMNS, *measures))}) from stdin (format binary)"


COPY_STATES = copy_statement()


def pack_states(
    track_id: NDArray[np.int64],
    stamp_us: NDArray[np.int64],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: NDArray[np.float64],
    std_m: NDArray[np.float64],
    is_last: NDArray[np.bool_],
    **measures: NDArray[np.float64],
) -> bytes:
    """A whole COPY (format binary) of `COLUMNS`, and of what else was measured, named as in `MEASURES`.

    All arrays are (n,); NaN becomes null in those of `NULLABLE`. Rows with the same columns null are written
    together, so that each group is one array of fixed width; the order of rows within a COPY has no meaning.
    """
    values: dict[str, NDArray[Any]] = {
        "track_id": track_id,
        "stamp": stamp_us - POSTGRES_EPOCH_US,
        "x_m": x_m,
        "y_m": y_m,
        "z_m": z_m,
        "std_m": std_m,
        "is_last": is_last,
        **measures,
    }
    nullable = [name for name in NULLABLE if name in values]
    nulls = np.zeros(len(track_id), dtype=np.int64)
    for bit, name in enumerate(nullable):
        nulls |= np.isnan(values[name]).astype(np.int64) << bit
    parts = [HEADER]
    for pattern in np.unique(nulls):
        rows = np.flatnonzero(nulls == pattern)
        missing = {name for bit, name in enumerate(nullable) if int(pattern) >> bit & 1}
        parts.append(_pack({name: value[rows] for name, value in values.items()}, missing))
    parts.append(TRAILER)
    return b"".join(parts)


def copy_rows(statement: str, cursor: psycopg.Cursor[Any], data: bytes) -> None:
    """Send a whole COPY, by a statement that takes it."""
    with cursor.copy(statement) as copy:
        copy.write(data)


def _pack(values: Mapping[str, NDArray[Any]], nulls: set[str]) -> bytes:
    fields: list[tuple[str, str]] = [("count", ">i2")]
    for name in values:
        fields.append((f"{name}_size", ">i4"))
        if name not in nulls:
            fields.append((name, TYPES[name]))
    rows = np.empty(len(values["track_id"]), dtype=fields)
    rows["count"] = len(values)
    for name, value in values.items():
        if name in nulls:
            rows[f"{name}_size"] = -1
        else:
            rows[f"{name}_size"] = np.dtype(TYPES[name]).itemsize
            rows[name] = value
    return rows.tobytes()
