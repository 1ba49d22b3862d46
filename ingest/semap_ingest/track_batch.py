"""Track batches: what a source says of many tracks at one stamp, as arrays (`semap.add_states`).

A batch is one prepared statement: a COPY goes to the server twice, a sixth of the time of a small one.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray
from psycopg.adapt import Dumper
from psycopg.pq import Format

from semap.model.track_state import COORDINATES, MEASURES
from semap.timeline.stamp import to_datetime

ADD = f"select semap.add_states(%s, %s, %s, {', '.join(f'{name} => %s' for name in COORDINATES + MEASURES)})"
NULL = b"\xff\xff\xff\xff"


class _Array(bytes):
    """A one-dimensional array in PostgreSQL's binary format.

    oid, element_oid, sent_as  of its type, and of its elements
    """

    oid: int
    element_oid: int
    sent_as: str


class _Bigint(_Array):
    oid, element_oid, sent_as = 1016, 20, ">i8"


class _Float8(_Array):
    oid, element_oid, sent_as = 1022, 701, ">f8"


class _Float4(_Array):
    oid, element_oid, sent_as = 1021, 700, ">f4"


for _kind in (_Bigint, _Float8, _Float4):
    _dumper = type(
        f"{_kind.__name__}Dumper",
        (Dumper,),
        {"oid": _kind.oid, "format": Format.BINARY, "dump": lambda _, value: value},
    )
    psycopg.adapters.register_dumper(_kind, _dumper)


def pack_batch(
    source_id: int,
    stamp_us: int,
    track_id: NDArray[np.int64],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: NDArray[np.float64],
    **measures: NDArray[np.float64],
) -> Sequence[object]:
    """What `send_batch` takes; of what was measured, each is named as in `MEASURES`.

    All arrays are (n,). NaN becomes null in all but the first three.
    """
    return (
        source_id,
        to_datetime(stamp_us),
        _pack(track_id, _Bigint),
        *(_pack(each, _Float8) for each in (x_m, y_m, z_m)),
        *(_pack(measures[name], _Float4) if name in measures else None for name in MEASURES),
    )


def send_batch(cursor: psycopg.Cursor[Any], batch: Sequence[object]) -> None:
    cursor.execute(ADD, batch, prepare=True)


def _pack(values: NDArray[Any], kind: type[_Array]) -> _Array | None:
    nulls = np.isnan(values)
    if nulls.all():
        return None
    elements = np.empty(len(values), dtype=[("size", ">i4"), ("value", kind.sent_as)])
    elements["size"], elements["value"] = np.dtype(kind.sent_as).itemsize, values
    sent = (
        b"".join(NULL if null else each.tobytes() for null, each in zip(nulls, elements, strict=True))
        if nulls.any()
        else elements.tobytes()
    )
    return kind(struct.pack(">iiiii", 1, int(nulls.any()), kind.element_oid, len(values), 1) + sent)
