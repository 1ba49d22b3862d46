"""The states that the caller may see, for statements that Python composes."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import BigInteger, ColumnElement, Double, FromClause, and_, column, literal, table
from sqlalchemy.dialects.postgresql import INTERVAL

from semap.store.database.tables import STAMP
from semap.store.motion.track_history import STATES

SLOT = literal(timedelta(minutes=30), INTERVAL)
SEEN = table(
    STATES.partition(".")[2],
    column("track_id", BigInteger),
    *(column(name, STAMP) for name in ("stamp", "from_stamp", "to_stamp")),
    *(column(name, Double) for name in ("x_m", "y_m", "z_m")),
    schema="semap",
)


def seen_at(stamp: ColumnElement[object], states: FromClause = SEEN) -> ColumnElement[bool]:
    """The condition that a state is of this stamp, which is known before states are read."""
    return and_(
        states.c.stamp == stamp,
        states.c.from_stamp > stamp - SLOT,
        states.c.from_stamp <= stamp,
        states.c.to_stamp >= stamp,
    )
