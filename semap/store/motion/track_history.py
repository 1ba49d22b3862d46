"""The states of a track over time."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from itertools import groupby

from sqlalchemy import Connection, text

from semap.model.track_state import STATE_COLUMNS, TrackState
from semap.store.database.connection import translated

LONGEST_GAP = timedelta(seconds=30)
"""Not seen for longer than this, a track was elsewhere, or gone."""

MOST_STATES = 5_000_000

STATE = ", ".join(STATE_COLUMNS)
HISTORY = text(f"""
    select {STATE} from semap.states_around(
      :track_id, greatest(cast(:from as timestamptz), cast(:after as timestamptz) + interval '1 us'), 0,
      :limit, :to)
""")  # noqa: S608
STATE_AT = text(f"""
    select {STATE} from semap.states_around(:track_id, cast(:at as timestamptz) + interval '1 us', 1, 0)
""")  # noqa: S608  (a constant)
AROUND = text(f"""
    select i.stamp, b.*, a.*
    from unnest(cast(:stamps as timestamptz[])) with ordinality i (stamp, place)
    cross join lateral (select {STATE} from semap.states_around(:track_id, i.stamp + interval '1 us', 1, 0)) b
    left join lateral (
      select {STATE} from semap.states_around(:track_id, i.stamp + interval '1 us', 0, 1)) a on true
    order by i.place
""")  # noqa: S608
PATH = text("""
    with seen as (
      select stamp, x_m, y_m, stamp - lag(stamp) over (order by stamp) > :longest_gap as has_gap
      from semap.states_around(:track_id, :from, 0, :most, :to)
    ), part as (
      select *, count(*) filter (where has_gap) over (order by stamp) as part from seen
    ), line as (
      select part, st_simplify(
               st_makeline(st_makepoint(x_m, y_m, extract(epoch from stamp - :from)) order by stamp),
               :tolerance_m, true) as line
      from part group by part
    )
    select l.part, st_x(p.geom), st_y(p.geom), st_z(p.geom)
    from line l cross join lateral st_dumppoints(l.line) p order by l.part, p.path
""")
SPAN = text("""
    select (select stamp from semap.states_around(:track_id, '-infinity', 0, 1)),
           (select stamp from semap.states_around(:track_id, 'infinity', 1, 0))
""")


def history(
    connection: Connection,
    track_id: int,
    start: datetime,
    end: datetime,
    *,
    after: datetime,
    limit: int,
) -> tuple[TrackState, ...]:
    """At most `limit` states of a track from `start` to `end`, both included, beginning after `after`."""
    asked = {"track_id": track_id, "from": start, "to": end, "after": after, "limit": limit}
    with translated():
        return _states(connection.execute(HISTORY, asked).all())


def state_at(connection: Connection, track_id: int, at: datetime) -> TrackState | None:
    """The newest state of a track at a time; None where it was not seen before."""
    with translated():
        found = _states(connection.execute(STATE_AT, {"track_id": track_id, "at": at}).all())
    return found[0] if found else None


def states_around(
    connection: Connection, track_id: int, stamps: Sequence[datetime]
) -> tuple[tuple[datetime, TrackState, TrackState | None], ...]:
    """Each of the times at which a track had been seen, with its states at or before it and after it."""
    with translated():
        rows = connection.execute(AROUND, {"track_id": track_id, "stamps": list(stamps)}).all()
    size = len(STATE_COLUMNS)
    return tuple(
        (
            row[0],
            TrackState(*row[1 : size + 1]),
            None if row[size + 1] is None else TrackState(*row[size + 1 :]),
        )
        for row in rows
    )


def path(
    connection: Connection, track_id: int, start: datetime, end: datetime, *, tolerance_m: float
) -> list[list[list[float]]]:
    """The way of a track from `start` to `end`, both included, a part for each time without a break.

    tolerance_m  the way lies no farther from the positions than this
    returns      of each part its points: x and y [m, map frame], and time from `start` on [s], in its order
    """
    asked = {
        "track_id": track_id,
        "from": start,
        "to": end,
        "tolerance_m": tolerance_m,
        "longest_gap": LONGEST_GAP,
        "most": MOST_STATES,
    }
    with translated():
        rows = connection.execute(PATH, asked).all()
    return [
        [[x_m, y_m, t_s] for _, x_m, y_m, t_s in points]
        for _, points in groupby(rows, key=lambda row: int(row[0]))
    ]


def span(connection: Connection, track_id: int) -> tuple[datetime, datetime] | None:
    """When a track was seen first and last; None where it was not seen."""
    with translated():
        first, last = connection.execute(SPAN, {"track_id": track_id}).one()
    return None if first is None else (first, last)


def _states(rows: Sequence[object]) -> tuple[TrackState, ...]:
    return tuple(TrackState(*row) for row in rows)  # type: ignore[misc]
