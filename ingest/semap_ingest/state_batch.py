"""States of one source, written together: moments of many tracks as track batches, all else by COPY."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import psycopg
from numpy.typing import NDArray

from semap_ingest.state_copy import copy_rows, copy_statement, pack_states
from semap_ingest.track_batch import pack_batch, send_batch

MANY = 50
"""A batch of fewer states than this, on average, takes longer than a COPY of many moments."""


def state_writer(
    source_id: int,
    track_id: NDArray[np.int64],
    stamp_us: NDArray[np.int64],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: NDArray[np.float64],
    is_last: NDArray[np.bool_],
    *,
    std_m: NDArray[np.float64],
    **measures: NDArray[np.float64],
) -> Callable[[psycopg.Cursor], None]:
    """What writes these states; all arrays are (n,), NaN where a value is not known.

    Of several moments the newest is written by COPY: more of it may be to come, while a batch says that
    it is all of its stamp.

    measures  what else was measured, named as in `MEASURES`
    """
    values = {"x_m": x_m, "y_m": y_m, "z_m": z_m, "std_m": std_m, **measures}
    order = np.lexsort((track_id, stamp_us))  # frames of the same tracks follow one another in the same order
    moments = np.split(order, np.flatnonzero(np.diff(stamp_us[order])) + 1)
    whole = moments[:-1] if len(moments) > 1 else [each for each in moments if len(each) > 1]
    if is_last.any() or (len(moments) > 1 and len(order) < MANY * len(moments)):
        whole = []
    batches = [
        pack_batch(source_id, int(stamp_us[rows[0]]), track_id[rows], **_at(values, rows)) for rows in whole
    ]
    rest = order[sum(map(len, whole)) :]
    data = pack_states(track_id[rest], stamp_us[rest], is_last=is_last[rest], **_at(values, rest))

    def write(cursor: psycopg.Cursor) -> None:
        for batch in batches:
            send_batch(cursor, batch)
        if len(rest):
            copy_rows(copy_statement(*measures), cursor, data)

    return write


def _at(values: Mapping[str, NDArray[np.float64]], rows: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
    return {name: each[rows] for name, each in values.items()}
