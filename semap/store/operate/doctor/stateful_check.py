"""Relations with stateful regions against the states of tracks, followed once more (`stateful_replay`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np
import shapely
from sqlalchemy import Connection, text

from semap.store.operate.doctor.stateful_replay import (
    Memory,
    StatefulRegion,
    Way,
    is_possible,
    possible_memories,
)
from semap.timeline.stamp import to_us

READ_AT_ONCE = 20_000
MOST_STATES = 10_000
REACH = timedelta(hours=1)
"""So far back, and so many of each track, states are read."""

SHAPES = ("footprint", "shape", "enter_area", "leave_area")
REGIONS = text("""
    select region_id, query_id, format('%s (%s)', instance_name, query_name) as name, test, distance_m,
           st_asbinary(footprint) as footprint, st_asbinary(coalesce(shape, footprint)) as shape,
           st_asbinary(enter_area) as enter_area, st_asbinary(leave_area) as leave_area, z_min_m, z_max_m,
           (extract(epoch from enter_confirm) * 1000000)::bigint as enter_confirm_us,
           (extract(epoch from leave_confirm) * 1000000)::bigint as leave_confirm_us,
           enter_stds, leave_stds, widest_std_m,
           (extract(epoch from longest_gap) * 1000000)::bigint as longest_gap_us, fastest_mps,
           subject is not null as is_chosen
    from semap.region where map_id = :map_id and stateful order by region_id
""")
TRACKS = text("""
    select p.track_id, k.name, p.stamp, t.first_stamp, p.x_m, p.y_m, coalesce(p.z_m, 'NaN') as z_m,
           coalesce(p.std_m, 'NaN')::float8 as std_m, coalesce(p.std_across_m, 'NaN')::float8 as std_across_m,
           coalesce(p.std_yaw_rad, 'NaN')::float8 as std_yaw_rad,
           s.jump_m, s.jump_mps, s.late_states > 0 as has_late,
           array(select query_id from semap.query_track q where q.track_id = p.track_id) as query_ids,
           array(select query_id from semap.continuous_query q
                 where q.map_id = :map_id and semap.reads_amended(q.query_id, p.track_id)) as amended_ids
    from semap.present_places(:map_id) p
    join semap.track_now t using (track_id)
    join semap.track k using (track_id)
    join semap.source s on s.source_id = p.source_id
    where p.live order by p.track_id
""")
MEMORIES = text("""
    select n.track_id, r.region_id, n.confirmed, n.pending, n.pending_at, n.raw, n.raw_at
    from semap.relation n join semap.region r using (query_id, instance_id)
    where n.map_id = :map_id and r.stateful and not semap.reads_amended(r.query_id, n.track_id)
""")
STATES = text("""
    select track_id, (extract(epoch from stamp) * 1000000)::bigint, x_m, y_m, z_m, std_m::float8,
           std_across_m::float8, std_yaw_rad::float8, is_last
    from (
      select s.*, row_number() over (partition by s.track_id order by s.stamp desc) as back
      from semap.states(:ids, :since, 'infinity') s
      join unnest(cast(:ids as bigint[]), cast(:until as timestamptz[])) p (track_id, until) using (track_id)
      where s.stamp <= p.until
    ) newest
    where back <= cast(:most as bigint) order by track_id, stamp
""")

Progress = Callable[[str], None]


@dataclass
class StatefulResult:
    """Mutable while tracks are looked at.

    pairs     looked at: a track and a region that is or was near
    partly    of these, such whose way could not be followed from where the track appeared
    wrong     track and region ids
    examples  thing, stored and wanted, of the first few
    """

    pairs: int = 0
    partly: int = 0
    wrong: list[tuple[int, int]] = field(default_factory=list)
    examples: list[tuple[str, str, str]] = field(default_factory=list)


@dataclass(frozen=True)
class _Track:
    track_id: int
    name: str
    stamp: datetime
    first_stamp: datetime | None
    x_m: float
    y_m: float
    z_m: float
    std_m: float
    std_across_m: float
    std_yaw_rad: float
    jump_m: float | None
    jump_mps: float
    has_late: bool
    query_ids: list[int]
    amended_ids: list[int]


def check_stateful(
    connection: Connection, map_id: int, progress: Progress, most_examples: int
) -> StatefulResult:
    """Each live track beside each stateful region of a map that it is or was near, within one snapshot.

    Tracks that a query takes as amended are left out for it.
    """
    result = StatefulResult()
    regions = _regions(connection, map_id)
    tracks = _tracks(connection, map_id)
    stored = {(row[0], row[1]): row for row in connection.execute(MEMORIES, {"map_id": map_id})}
    if regions and tracks:
        near = shapely.STRtree([shapely.box(*_bounds(region)) for region in regions])
        numbers = {region.region_id: n for n, region in enumerate(regions)}
        for done, (track, states) in enumerate(_ways(connection, tracks), 1):
            if done % 100 == 0:
                progress(f"{done} of {len(tracks)} tracks followed past stateful regions")
            box = shapely.box(states.x_m.min(), states.y_m.min(), states.x_m.max(), states.y_m.max())
            told = {numbers[key[1]] for key in stored if key[0] == track.track_id and key[1] in numbers}
            for n in sorted(told | set(near.query(box.buffer(0.001)).tolist())):
                if regions[n].query_id in track.amended_ids:
                    continue
                row = stored.pop((track.track_id, regions[n].region_id), None)
                _compare(result, track, regions[n], states, row, most_examples)
    for track_id, region_id in stored:
        result.wrong.append((track_id, region_id))
        if len(result.examples) < most_examples:
            result.examples.append(
                (f"track {track_id}, region {region_id}", "a relation", "the track does not live")
            )
    return result


def _compare(
    result: StatefulResult,
    track: _Track,
    region: StatefulRegion,
    way: Way,
    row: tuple[Any, ...] | None,
    most: int,
) -> None:
    memory = Memory(False, False, None, False, None)
    if row is not None:
        _, _, confirmed, pending, pending_at, raw, raw_at = row
        memory = Memory(confirmed, pending, _us(pending_at), raw, _us(raw_at))
    result.pairs += 1
    result.partly += not way.is_whole
    if not region.is_chosen or region.query_id in track.query_ids:
        memories = possible_memories(region, way)
    else:
        memories = {Memory(False, False, None, False, None)}
    if is_possible(region, memories, memory, int(way.stamp_us[-1])):
        return
    result.wrong.append((track.track_id, region.region_id))
    if len(result.examples) < most:
        wanted = sorted({_words(each) for each in memories})
        result.examples.append((f"track {track.name}, {region.name}", _words(memory), ", or ".join(wanted)))


def _words(memory: Memory) -> str:
    said = "a relation" if memory.confirmed else "no relation"
    if memory.confirmed != memory.pending:
        said += f" that waits to {'begin' if memory.pending else 'end'}"
    return said + (", inside of the boundary" if memory.raw else ", outside of the boundary")


def _us(stamp: datetime | None) -> int | None:
    return None if stamp is None else to_us(stamp)


def _regions(connection: Connection, map_id: int) -> list[StatefulRegion]:
    found = []
    for row in connection.execute(REGIONS, {"map_id": map_id}).mappings():
        shapes = shapely.from_wkb([row[name] for name in SHAPES])  # None where there is none
        shapely.prepare(shapes)
        found.append(StatefulRegion(**{**row, **dict(zip(SHAPES, shapes, strict=True))}))
    return found


def _tracks(connection: Connection, map_id: int) -> list[_Track]:
    return [_Track(**row) for row in connection.execute(TRACKS, {"map_id": map_id}).mappings()]


def _bounds(region: StatefulRegion) -> tuple[float, float, float, float]:
    bounds = np.array([each.bounds for each in region.boundaries() if not each.is_empty])
    low, high = np.nanmin(bounds[:, :2], axis=0), np.nanmax(bounds[:, 2:], axis=0)
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _ways(connection: Connection, tracks: list[_Track]) -> Iterator[tuple[_Track, Way]]:
    """Each track with as much of its way as is certain: at least where it is."""
    newest = max(track.stamp for track in tracks)
    recent = {
        track.track_id: track for track in tracks if track.stamp > newest - REACH and not track.has_late
    }
    since = min((track.stamp for track in recent.values()), default=newest) - REACH
    parameters = {
        "ids": list(recent),
        "until": [track.stamp for track in recent.values()],
        "since": since,
        "most": MOST_STATES,
    }
    followed: set[int] = set()
    found = connection.execute(STATES, parameters, execution_options={"yield_per": READ_AT_ONCE})
    for track_id, rows in groupby(found, itemgetter(0)):
        followed.add(track_id)
        yield recent[track_id], _way(recent[track_id], [row[1:] for row in rows])
    for track in tracks:
        if track.track_id not in followed:
            yield track, _present(track)


def _way(track: _Track, rows: Sequence[Sequence[Any]]) -> Way:
    """What came in order and passed the gate for outliers without doubt."""
    columns = list(zip(*rows, strict=True))
    stamp_us = np.array(columns[0], dtype=np.int64)
    numbers = tuple(np.array(column, dtype=np.float64) for column in columns[1:7])
    x_m, y_m = numbers[:2]
    is_last = np.array(columns[7], dtype=np.bool_)
    if stamp_us[-1] != to_us(track.stamp) or (x_m[-1], y_m[-1]) != (track.x_m, track.y_m):
        return _present(track)
    start = 0
    if track.jump_m is not None and len(stamp_us) > 1:
        far_m = np.hypot(np.diff(x_m), np.diff(y_m)) - track.jump_mps * np.diff(stamp_us) / 1e6
        start = int(np.flatnonzero(far_m > track.jump_m).max(initial=-1)) + 1
    kept = slice(start, None)
    is_whole = start == 0 and len(stamp_us) < MOST_STATES and _us(track.first_stamp) == stamp_us[0]
    x_m, y_m, z_m, std_m, std_across_m, std_yaw_rad = (each[kept] for each in numbers)
    return Way(stamp_us[kept], x_m, y_m, z_m, std_m, std_across_m, std_yaw_rad, is_last[kept], is_whole)


def _present(track: _Track) -> Way:
    known = (track.x_m, track.y_m, track.z_m, track.std_m, track.std_across_m, track.std_yaw_rad)
    stamp_us = np.array([to_us(track.stamp)], dtype=np.int64)
    x_m, y_m, z_m, std_m, std_across_m, std_yaw_rad = (np.array([value]) for value in known)
    is_last = np.zeros(1, dtype=np.bool_)
    return Way(stamp_us, x_m, y_m, z_m, std_m, std_across_m, std_yaw_rad, is_last, False)
