"""Track states as they were stored, and the regions that they are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from semap.batch.crossing import Area
from semap.store.database.connection import translated

STATES = """
    select s.track_id, (extract(epoch from s.stamp) * 1000000)::bigint, s.x_m, s.y_m, coalesce(s.z_m, 'nan'),
           coalesce(sqrt((s.std_m::float8 ^ 2 + coalesce(s.std_across_m, s.std_m)::float8 ^ 2) / 2)::real,
                    'nan'), s.is_last
    from semap.states_of_map(%(map_id)s, %(start)s, %(end)s) s
    where s.stamp < %(end)s
    order by s.track_id, s.stamp
"""
# as queries that follow amendments take them: whose states are whose, and who went on as another was not over
STATES_AS_AMENDED = """
    with state as (
      select distinct on (g.track_id, s.stamp) s.*, g.track_id as of_track
      from semap.states_of_map(%(map_id)s, %(start)s, %(end)s) s
      join semap.track_reading g
        on g.state_track_id = s.track_id and s.stamp >= g.from_stamp and s.stamp < g.to_stamp
      where s.stamp < %(end)s
      order by g.track_id, s.stamp, g.track_id <> s.track_id, s.track_id
    )
    select s.of_track, (extract(epoch from s.stamp) * 1000000)::bigint, s.x_m, s.y_m, coalesce(s.z_m, 'nan'),
           coalesce(sqrt((s.std_m::float8 ^ 2 + coalesce(s.std_across_m, s.std_m)::float8 ^ 2) / 2)::real,
                    'nan'),
           s.is_last and lead(s.track_id) over (partition by s.of_track order by s.stamp) = s.track_id
    from state s order by s.of_track, s.stamp
"""
ENDS_AS_AMENDED = """
    select g.track_id, case when bool_and(k.ended_at < %(end)s) then max(k.ended_at) end,
           count(k.track_id) > 0
    from semap.track_reading g
    left join semap.track k on k.track_id = g.state_track_id and g.to_stamp = 'infinity'
    where g.map_id = %(map_id)s group by g.track_id
"""
# a track may have stood unseen for long before the span: what it was in then, the triggers have noted
TRACKS = """
    with seen as (
      select distinct on (track_id) track_id, stamp, is_last
      from semap.states(%(track_ids)s, %(start)s - interval '1 hour', %(start)s) s
      where stamp < %(start)s
      order by track_id, stamp desc
    ), noted as (
      select distinct on (track_id) track_id, stamp, cause = 'disappeared' as is_last
      from semap.relation_change c
      where stamp < %(start)s and track_id = any (%(track_ids)s) and amendment is distinct from 'retracted'
        and not exists (select from semap.relation_change d where d.retracts = c.uid)
      order by track_id, stamp desc, is_last desc, change_id desc
    )
    select t.track_id, t.name, t.uid, case when t.ended_at < %(end)s then t.ended_at end,
           not coalesce(case when n.stamp >= s.stamp then n.is_last end, s.is_last, n.is_last, true)
    from semap.track t left join seen s using (track_id) left join noted n using (track_id)
    where t.track_id = any (%(track_ids)s)
"""
REGIONS = """
    select region_id, query_id, query_name, instance_id, instance_uid, instance_name,
           st_asbinary(footprint), z_min_m, z_max_m,
           (select follows_amendments from semap.continuous_query q where q.query_id = r.query_id)
    from semap.region r where map_id = %(map_id)s
"""


@dataclass(frozen=True)
class StoredTrack:
    """A track as a span of its states sees it.

    ended_at   where it ended before the end of the span
    was_there  it was there before the span and had not ended
    """

    track_id: int
    name: str
    uid: str
    ended_at: datetime | None
    was_there: bool


@dataclass(frozen=True)
class StoredRegion:
    """A region with the query and the instance that it is of."""

    area: Area
    query_id: int
    query_name: str
    instance_id: int
    instance_uid: str
    instance_name: str
    follows_amendments: bool


@dataclass(frozen=True)
class StoredStates:
    """States of a span, sorted by track and stamp.

    track_id    (n,)
    stamp_us    (n,)
    position_m  (n, 2) [m, map frame]
    z_m, std_m  (n,) NaN where unknown; std_m on average of all directions
    is_last     (n,)
    """

    track_id: NDArray[np.int64]
    stamp_us: NDArray[np.int64]
    position_m: NDArray[np.float64]
    z_m: NDArray[np.float64]
    std_m: NDArray[np.float64]
    is_last: NDArray[np.bool_]


PAGE = 50_000


def read_states(
    connection: psycopg.Connection, map_id: int, start: datetime, end: datetime, *, as_amended: bool = False
) -> StoredStates:
    """All states of a map's tracks from `start` on and before `end`; as amended: of amended tracks alone."""
    numbers: list[NDArray[np.float64]] = []
    stamps: list[NDArray[np.int64]] = []
    with translated(), connection.transaction(), connection.cursor("states", binary=True) as cursor:
        cursor.execute(
            STATES_AS_AMENDED if as_amended else STATES, {"map_id": map_id, "start": start, "end": end}
        )
        while page := cursor.fetchmany(PAGE):
            # a float holds a stamp of today to a quarter of a microsecond, but not one of any year
            stamps.append(np.array([row[1] for row in page], np.int64))
            numbers.append(np.array([(row[0], *row[2:]) for row in page], np.float64))
    if not numbers:
        return StoredStates(*_nothing())
    table = np.concatenate(numbers)
    return StoredStates(
        table[:, 0].astype(np.int64),
        np.concatenate(stamps),
        table[:, 1:3],
        table[:, 3],
        table[:, 4],
        table[:, 5].astype(np.bool_),
    )


def read_tracks(
    connection: psycopg.Connection, track_ids: list[int], start: datetime, end: datetime
) -> Mapping[int, StoredTrack]:
    """Those of a span from `start` on and before `end`, by id."""
    wanted = {"track_ids": track_ids, "start": start, "end": end}
    with translated():
        rows = connection.execute(TRACKS, wanted).fetchall()
    return {row[0]: StoredTrack(row[0], row[1], str(row[2]), row[3], row[4]) for row in rows}


def read_amended_tracks(
    connection: psycopg.Connection, map_id: int, start: datetime, end: datetime
) -> Mapping[int, StoredTrack]:
    """The amended tracks of a map, as `read_tracks` has them; one whose states another has since is over."""
    with translated():
        rows = connection.execute(ENDS_AS_AMENDED, {"map_id": map_id, "end": end}).fetchall()
    tracks = read_tracks(connection, [row[0] for row in rows], start, end)
    return {
        track_id: replace(tracks[track_id], ended_at=ended_at if goes_on else start)
        for track_id, ended_at, goes_on in rows
    }


def read_regions(connection: psycopg.Connection, map_id: int) -> Mapping[int, StoredRegion]:
    """By id; the map as it is now."""
    with translated():
        rows = connection.execute(REGIONS, {"map_id": map_id}).fetchall()
    return {
        region_id: StoredRegion(
            Area(region_id, shapely.from_wkb(bytes(wkb)), low, high),
            query_id,
            query,
            instance_id,
            str(uid),
            name,
            bool(follows),
        )
        for region_id, query_id, query, instance_id, uid, name, wkb, low, high, follows in rows
    }


def _nothing() -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64],
                        NDArray[np.float64], NDArray[np.bool_]]:  # fmt: skip
    return (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros(0),
            np.zeros(0, np.bool_))  # fmt: skip
