"""Rows that came after the watermark had passed them: kept, counted, and not yet given to the rules."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, func, select

from semap.store.database.connection import translated
from semap.store.database.tables import late_row, map_


@dataclass(frozen=True)
class LateRows:
    """How many rows of an input came late, and were replayed since, and between which stamps they lie."""

    map: str
    input: str
    rows: int
    replayed: int
    first: datetime
    last: datetime


def count_late_rows(connection: Connection, *, map_name: str | None = None) -> tuple[LateRows, ...]:
    """By map and input."""
    found = (
        select(
            map_.c.name,
            late_row.c.input,
            func.count(),
            func.count(late_row.c.replayed_at),
            func.min(late_row.c.stamp),
            func.max(late_row.c.stamp),
        )
        .join(map_, map_.c.map_id == late_row.c.map_id)
        .group_by(map_.c.name, late_row.c.input)
        .order_by(map_.c.name, late_row.c.input)
    )
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    with translated():
        return tuple(LateRows(*row) for row in connection.execute(found))
