"""How many tracks were in an instance over time, by the relations that continuous queries keep."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from sqlalchemy import Connection, text

from semap.store.database.connection import translated

Unit = Literal["hour", "day"]

SPANS = text("""
    select o.since, o.until, o.mean, o.peak, o.peak_at, o.tracks
    from (
      select array_agg(distinct m order by m) as moments
      from (
        select unnest(array[cast(:from as timestamptz), cast(:to as timestamptz)]) as m
        union all
        select case when :each = 'day' then n at time zone :zone else n at time zone 'UTC' end
        from generate_series(
          date_trunc(:each, cast(:from as timestamptz), :zone)
            at time zone case when :each = 'day' then :zone else 'UTC' end,
          cast(:to as timestamptz) at time zone case when :each = 'day' then :zone else 'UTC' end,
          cast('1 ' || :each as interval)) n
      ) every
      where m between :from and :to
    ) m
    cross join lateral semap.occupancy(:instance_id, m.moments) o
""")
SUMMARY = text("""
    select count(*), count(distinct track_id), coalesce(sum(extract(epoch from until - since)), 0)::float8,
           percentile_cont(0.5) within group (order by extract(epoch from until - since)),
           max(extract(epoch from until - since))::float8
    from semap.stays_in(:instance_id, :from, :to)
""")
VISITORS = text("""
    select s.track_id, t.name, count(*), sum(extract(epoch from s.until - s.since))::float8 as seconds,
           min(s.since), max(s.until)
    from semap.stays_in(:instance_id, :from, :to) s join semap.track t using (track_id)
    group by s.track_id, t.name
    order by seconds desc, s.track_id limit :limit
""")


@dataclass(frozen=True)
class Span:
    """How many were in it between two moments.

    mean     on average over that time
    peak     at most, and `peak_at` since when so many at first; None where nobody was
    tracks   how many different ones
    """

    since: datetime
    until: datetime
    mean: float
    peak: int
    peak_at: datetime | None
    tracks: int


@dataclass(frozen=True)
class Visitor:
    """A track that was in it: how often, how long in all [s], from when and until when."""

    track_id: int
    name: str
    stays: int
    total_s: float
    since: datetime
    until: datetime


@dataclass(frozen=True)
class Occupancy:
    """Stays are cut to the time that was asked for; lengths are None where there was none."""

    spans: tuple[Span, ...]
    stays: int
    tracks: int
    total_s: float
    median_s: float | None
    longest_s: float | None
    visitors: tuple[Visitor, ...]


def occupancy(
    connection: Connection,
    instance_id: int,
    start: datetime,
    end: datetime,
    *,
    each: Unit,
    zone: str = "UTC",
    visitors: int = 20,
) -> Occupancy:
    """How many tracks were in an instance from `start` to `end`, hour by hour or day by day.

    zone      name of a time zone (IANA), in whose hours and days
    visitors  those that were in it longest, at most so many
    raises    InvalidInput, where there is no such zone
    """
    asked = {"instance_id": instance_id, "from": start, "to": end}
    with translated():
        spans = connection.execute(SPANS, {**asked, "each": each, "zone": zone}).all()
        summary = connection.execute(SUMMARY, asked).one()
        found = connection.execute(VISITORS, {**asked, "limit": visitors}).all()
    stays, tracks, total_s, median_s, longest_s = summary
    return Occupancy(
        tuple(Span(*row) for row in spans),
        stays,
        tracks,
        total_s,
        median_s,
        longest_s,
        tuple(Visitor(*row) for row in found),
    )
