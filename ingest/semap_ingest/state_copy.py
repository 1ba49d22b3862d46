"""States of tracks in PostgreSQL's binary COPY format, made of whole arrays at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

COLUMNS = ("track_id", "stamp", "x_m", "y_m", "z_m", "std_m", "is_last")
POSTGRES_EPOCH_US = 946_684_800_000_000
HEADER = b"PGCOPY\n\xff\r\n\0" + bytes(8)
TRAILER = b"\xff\xff"


def pack_states(
    track_id: NDArray[np.int64],
    stamp_us: NDArray[np.int64],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: NDArray[np.float64],
    std_m: NDArray[np.float64],
    is_last: NDArray[np.bool_],
) -> bytes:
    """A whole COPY (format binary) of `COLUMNS`; NaN in z_m or std_m becomes null.

    All arrays are (n,). Rows with the same columns null are written together, so that each group
    is one array of fixed width; the order of rows within a COPY has no meaning.
    """
    values = {
        "track_id": track_id,
        "stamp": stamp_us - POSTGRES_EPOCH_US,
        "x_m": x_m,
        "y_m": y_m,
        "z_m": z_m,
        "std_m": std_m,
        "is_last": is_last,
    }
    no_z, no_std = np.isnan(z_m), np.isnan(std_m)
    parts = [HEADER]
    for z_is_null in (False, True):
        for std_is_null in (False, True):
            rows = np.flatnonzero((no_z == z_is_null) & (no_std == std_is_null))
            if len(rows):
                nulls = {name for name, null in (("z_m", z_is_null), ("std_m", std_is_null)) if null}
                parts.append(_pack({name: value[rows] for name, value in values.items()}, nulls))
    parts.append(TRAILER)
    return b"".join(parts)


def _pack(values: Mapping[str, NDArray[Any]], nulls: set[str]) -> bytes:
    types = {
        "track_id": ">i8",
        "stamp": ">i8",
        "x_m": ">f8",
        "y_m": ">f8",
        "z_m": ">f8",
        "std_m": ">f4",
        "is_last": "?",
    }
    fields: list[tuple[str, str]] = [("count", ">i2")]
    for name in COLUMNS:
        fields.append((f"{name}_size", ">i4"))
        if name not in nulls:
            fields.append((name, types[name]))
    rows = np.empty(len(values["track_id"]), dtype=fields)
    rows["count"] = len(COLUMNS)
    for name in COLUMNS:
        if name in nulls:
            rows[f"{name}_size"] = -1
        else:
            rows[f"{name}_size"] = np.dtype(types[name]).itemsize
            rows[name] = values[name]
    return rows.tobytes()
