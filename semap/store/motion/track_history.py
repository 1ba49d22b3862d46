"""The states of a track over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, text

from semap.store.database.connection import translated

STATES = "semap.track_state_seen"
"""What states of a stretch of time are read from: those that the caller may see, be they rows or packed."""

ALL_STATES = "semap.stored_state"
"""The same for those who may see all."""

SLOT = "interval '30 min'"
"""In so long a time lie all states that are packed in one row."""


def within(first: str, last: str) -> str:
    """The condition that a state `s` of STATES or ALL_STATES is from one stamp to another, both included.

    first, last  SQL that is known before states are read: a parameter, or what a LATERAL subquery is given
    """
    return (
        f"s.stamp >= {first} and s.stamp <= {last}"
        f" and s.from_stamp > {first} - {SLOT} and s.from_stamp <= {last} and s.to_stamp >= {first}"
    )


STATE = (
    "stamp, x_m, y_m, z_m, std_m, heading_rad, speed_mps, length_m, width_m, std_across_m, std_yaw_rad,"
    " is_last"
)
HISTORY = text(f"select {STATE} from semap.states_of_track(:track_id, :from, :to, :after, :limit)")  # noqa: S608
STATE_AT = text(f"select {STATE} from semap.state_before(:track_id, :at)")  # noqa: S608  (a constant)
AROUND = text(f"""
    select i.stamp, b.*, a.*
    from unnest(cast(:stamps as timestamptz[])) with ordinality i (stamp, place)
    cross join lateral (select {STATE} from semap.state_before(:track_id, i.stamp)) b
    left join lateral (
      select {STATE} from semap.states_of_track(:track_id, i.stamp, 'infinity', i.stamp, 1)) a on true
    order by i.place
""")  # noqa: S608
SPAN = text("""
    select (select stamp from semap.states_of_track(:track_id, '-infinity', 'infinity', '-infinity', 1)),
           (select stamp from semap.state_before(:track_id, 'infinity'))
""")


@dataclass(frozen=True)
class PastState:
    """Where a track was seen, in the map frame, as in `TrackState`. After its last it was gone."""

    stamp: datetime
    x_m: float
    y_m: float
    z_m: float | None
    std_m: float | None
    heading_rad: float | None
    speed_mps: float | None
    length_m: float | None
    width_m: float | None
    std_across_m: float | None
    std_yaw_rad: float | None
    is_last: bool


def history(
    connection: Connection,
    track_id: int,
    start: datetime,
    end: datetime,
    *,
    after: datetime,
    limit: int,
) -> tuple[PastState, ...]:
    """At most `limit` states of a track from `start` to `end`, both included, beginning after `after`."""
    asked = {"track_id": track_id, "from": start, "to": end, "after": after, "limit": limit}
    with translated():
        return _states(connection.execute(HISTORY, asked).all())


def state_at(connection: Connection, track_id: int, at: datetime) -> PastState | None:
    """The newest state of a track at a time; None where it was not seen before."""
    with translated():
        found = _states(connection.execute(STATE_AT, {"track_id": track_id, "at": at}).all())
    return found[0] if found else None


def states_around(
    connection: Connection, track_id: int, stamps: Sequence[datetime]
) -> tuple[tuple[datetime, PastState, PastState | None], ...]:
    """Each of the times at which a track had been seen, with its states at or before it and after it."""
    with translated():
        rows = connection.execute(AROUND, {"track_id": track_id, "stamps": list(stamps)}).all()
    size = len(PastState.__dataclass_fields__)
    return tuple(
        (
            row[0],
            PastState(*row[1 : size + 1]),
            None if row[size + 1] is None else PastState(*row[size + 1 :]),
        )
        for row in rows
    )


def span(connection: Connection, track_id: int) -> tuple[datetime, datetime] | None:
    """When a track was seen first and last; None where it was not seen."""
    with translated():
        first, last = connection.execute(SPAN, {"track_id": track_id}).one()
    return None if first is None else (first, last)


def _states(rows: Sequence[object]) -> tuple[PastState, ...]:
    return tuple(PastState(*row) for row in rows)  # type: ignore[misc]
