"""Stateful regions followed once more, in plain Python: which memories of a track may be right.

What semap keeps of a track near a stateful region (`relation`) depends on the path of the track, and
begins anew when the track appears, when the region is edited, and when its query begins to be about the
track. When that was is not stored. So all beginnings are followed at once: the set of memories holds one
for each state that may have been the first, and as many for what was before the first state that is known.
A memory that is stored and is not among them cannot be right. Most states decide (deep inside, far
outside), so that the set is small.

Nothing here is shared with the triggers: shapes are asked of shapely, not of PostGIS. No I/O.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from semap.model.predicate import RegionTest

Flags = NDArray[np.bool_]
Numbers = NDArray[np.float64]
NEAR_US = 2
"""So exact are moments between two states, which are rounded."""


class Memory(NamedTuple):
    """As in semap.relation, with None for a moment that makes no difference any more.

    pending_us  since when `pending` waits to be confirmed; UNKNOWN: before the first known state
    """

    confirmed: bool
    pending: bool
    pending_us: int | None
    raw: bool
    raw_us: int | None


UNKNOWN = -(2**62)


@dataclass(frozen=True)
class StatefulRegion:
    """A row of semap.region; times in microseconds, lengths in metres."""

    region_id: int
    query_id: int
    name: str
    test: RegionTest
    footprint: shapely.Geometry
    shape: shapely.Geometry
    distance_m: float | None
    enter_area: shapely.Geometry | None
    leave_area: shapely.Geometry | None
    z_min_m: float
    z_max_m: float
    enter_confirm_us: int
    leave_confirm_us: int
    enter_stds: float | None
    leave_stds: float | None
    widest_std_m: float | None
    longest_gap_us: int | None
    fastest_mps: float | None
    is_chosen: bool

    def confirm_us(self, pending: bool) -> int:
        return self.enter_confirm_us if pending else self.leave_confirm_us

    def boundaries(self) -> list[shapely.Geometry]:
        return [each for each in (self.footprint, self.enter_area, self.leave_area) if each is not None]


@dataclass(frozen=True)
class Way:
    """States of one track, in order. All arrays are (n,); z_m and std_m are NaN where a state has none,
    std_across_m and std_yaw_rad where its error is alike in all directions.

    is_whole  the first state is the one with which the track appeared
    """

    stamp_us: NDArray[np.int64]
    x_m: Numbers
    y_m: Numbers
    z_m: Numbers
    std_m: Numbers
    std_across_m: Numbers
    std_yaw_rad: Numbers
    is_last: Flags
    is_whole: bool


@dataclass(frozen=True)
class _Stand:
    raw: Flags
    enters: Flags
    leaves: Flags


def possible_memories(region: StatefulRegion, way: Way) -> set[Memory]:
    """What may be kept of the track after its last state; at least one state is needed."""
    stand = _stand(region, way.x_m, way.y_m, way.z_m, way.std_m, way.std_across_m, way.std_yaw_rad)
    memories = set() if way.is_whole else set(_unknown(bool(stand.raw[0])))
    between = _between(region, way)
    for n, stamp_us in enumerate(way.stamp_us.tolist()):
        raw = bool(stand.raw[n])
        if (n == 0 and way.is_whole) or (n > 0 and way.is_last[n - 1]):
            memories = set()
        found: set[Memory] = set()
        for memory in memories:
            for step in _step(region, memory, between.get(n, []), stamp_us):
                found |= set(
                    _tread(region, step, stamp_us, raw, bool(stand.enters[n]), bool(stand.leaves[n]))
                )
        memories = found | {Memory(raw, raw, None, raw, None)}
    return memories


def is_possible(region: StatefulRegion, memories: set[Memory], stored: Memory, stamp_us: int) -> bool:
    """Whether what is stored is one of these, at the stamp of the last state."""
    wanted = _tidy(stored)
    due_us = None if wanted.pending_us is None else wanted.pending_us + region.confirm_us(wanted.pending)
    return any(
        (memory.confirmed, memory.pending, memory.raw) == (wanted.confirmed, wanted.pending, wanted.raw)
        and (
            due_us is not None and due_us > stamp_us
            if memory.pending_us == UNKNOWN
            else _near(memory.pending_us, wanted.pending_us)
        )
        and (memory.raw_us == UNKNOWN or _near(memory.raw_us, wanted.raw_us))
        for memory in memories
    )


def _near(one: int | None, other: int | None) -> bool:
    if one is None or other is None:
        return one is other
    return abs(one - other) <= NEAR_US


def _unknown(raw: bool) -> Iterator[Memory]:
    for confirmed in (False, True):
        for pending in (False, True):
            yield _tidy(Memory(confirmed, pending, UNKNOWN, raw, UNKNOWN))


def _tidy(memory: Memory) -> Memory:
    pending_us = None if memory.confirmed == memory.pending else memory.pending_us
    raw_us = None if memory.confirmed == memory.pending == memory.raw else memory.raw_us
    return memory._replace(pending_us=pending_us, raw_us=raw_us)


def _settled(region: StatefulRegion, memory: Memory, at_us: int) -> Iterator[Memory]:
    if memory.confirmed == memory.pending:
        yield memory
        return
    confirm_us = region.confirm_us(memory.pending)
    is_unknown = memory.pending_us == UNKNOWN
    if is_unknown or at_us >= (memory.pending_us or 0) + confirm_us:
        yield memory._replace(confirmed=memory.pending)
    if (is_unknown and confirm_us > 0) or (not is_unknown and at_us < (memory.pending_us or 0) + confirm_us):
        yield memory


def _tread(
    region: StatefulRegion, memory: Memory, at_us: int, raw: bool, enters: bool, leaves: bool
) -> Iterator[Memory]:
    """One place of the way."""
    if raw != memory.raw:
        memory = memory._replace(raw=raw, raw_us=at_us)
    if (enters and not memory.pending) or (leaves and memory.pending):
        memory = memory._replace(pending=enters, pending_us=at_us)
    for settled in _settled(region, memory, at_us):
        yield _tidy(settled)


def _step(
    region: StatefulRegion, memory: Memory, parts: list[tuple[int, bool, bool, bool]], stamp_us: int
) -> set[Memory]:
    """The way to a state, where it is known: each part of it, up to the state."""
    memories = {memory}
    for at_us, raw, enters, leaves in parts:
        waited = {settled for each in memories for settled in _settled(region, each, at_us)}
        memories = {after for each in waited for after in _tread(region, each, at_us, raw, enters, leaves)}
    if parts:
        memories = {settled for each in memories for settled in _settled(region, each, stamp_us)}
    return memories


def _depth_m(
    boundary: shapely.Geometry,
    x_m: Numbers,
    y_m: Numbers,
    std_m: Numbers,
    across_m: Numbers,
    yaw_rad: Numbers,
) -> Numbers:
    """How far from the boundary, the shorter axis of each error ellipse stretched to the longer one."""
    depth_m: Numbers = shapely.distance(boundary, shapely.points(x_m, y_m))
    for n in np.flatnonzero(across_m < std_m).tolist():
        stretch = std_m[n] / max(across_m[n], std_m[n] / 1000)
        cos, sin = np.cos(yaw_rad[n]), np.sin(yaw_rad[n])
        turn = np.array([[cos, sin], [-sin * stretch, cos * stretch]])
        seen = shapely.transform(boundary, lambda at, n=n, turn=turn: (at - (x_m[n], y_m[n])) @ turn.T)
        depth_m[n] = shapely.distance(seen, shapely.Point(0, 0))
    return depth_m


def _stand(
    region: StatefulRegion,
    x_m: Numbers,
    y_m: Numbers,
    z_m: Numbers,
    std_m: Numbers,
    across_m: Numbers,
    yaw_rad: Numbers,
) -> _Stand:
    points = shapely.points(x_m, y_m)
    at_height = np.isnan(z_m) | ((z_m >= region.z_min_m) & (z_m < region.z_max_m))
    if region.test == "covers":
        raw = shapely.covers(region.shape, points)
    elif region.test == "dwithin":
        raw = shapely.dwithin(region.shape, points, region.distance_m)
    else:
        raw = shapely.contains(region.shape, points)
    raw = raw & at_height
    enters, far = raw.copy(), ~raw
    if region.enter_area is not None:
        enters &= shapely.contains(region.enter_area, points)
    if region.leave_area is not None:
        far &= ~shapely.contains(region.leave_area, points)
    if region.enter_stds is not None and region.leave_stds is not None and region.widest_std_m is not None:
        depth_m = _depth_m(shapely.boundary(region.footprint), x_m, y_m, std_m, across_m, yaw_rad)
        known_m = np.nan_to_num(std_m)
        is_vague = known_m > region.widest_std_m
        enters &= (depth_m >= region.enter_stds * known_m) & ~is_vague
        far &= (depth_m >= region.leave_stds * known_m) & ~is_vague
    return _Stand(raw, enters, far | ~at_height)


def _between(region: StatefulRegion, way: Way) -> dict[int, list[tuple[int, bool, bool, bool]]]:
    """By state: the parts of the way to it, each with its beginning and how it stands to the region."""
    if region.longest_gap_us is None or region.fastest_mps is None or len(way.stamp_us) < 2:
        return {}
    gap_us = np.diff(way.stamp_us)
    length_m = np.hypot(np.diff(way.x_m), np.diff(way.y_m))
    is_known = (gap_us <= region.longest_gap_us) & (length_m <= region.fastest_mps * gap_us / 1e6)
    found = {}
    for n in (np.flatnonzero(is_known) + 1).tolist():
        parts = sorted(_parts(region, way, n))
        if not parts or way.is_last[n - 1]:
            continue
        starts = sorted({0.0, *(part for part in parts if part < 1)})
        middles = np.array([(a + b) / 2 for a, b in pairwise([*starts, 1.0])])
        stand = _stand(
            region,
            way.x_m[n - 1] + middles * (way.x_m[n] - way.x_m[n - 1]),
            way.y_m[n - 1] + middles * (way.y_m[n] - way.y_m[n - 1]),
            way.z_m[n - 1] + middles * (way.z_m[n] - way.z_m[n - 1]),
            *(np.full(len(middles), each[n]) for each in (way.std_m, way.std_across_m, way.std_yaw_rad)),
        )
        found[n] = [
            (
                int(way.stamp_us[n - 1]) + round(start * int(gap_us[n - 1])),
                bool(raw),
                bool(enters),
                bool(leaves),
            )
            for start, raw, enters, leaves in zip(starts, stand.raw, stand.enters, stand.leaves, strict=True)
        ]
    return found


def _parts(region: StatefulRegion, way: Way, n: int) -> set[float]:
    """Parts of the way to state n at which it meets a boundary or an end of the heights."""
    parts: set[float] = set()
    x_m, y_m, z_m = way.x_m[n - 1 : n + 1], way.y_m[n - 1 : n + 1], way.z_m[n - 1 : n + 1]
    length_m = float(np.hypot(x_m[1] - x_m[0], y_m[1] - y_m[0]))
    if length_m > 0:
        line = shapely.LineString(np.column_stack([x_m, y_m]))
        for shape in region.boundaries():
            if not shapely.intersects(line, shapely.box(*shape.bounds)):
                continue
            met = shapely.get_coordinates(shapely.intersection(shapely.boundary(shape), line))
            parts |= {float(np.hypot(x - x_m[0], y - y_m[0])) / length_m for x, y in met}
    if not np.isnan(z_m).any() and z_m[0] != z_m[1]:
        heights = (float((z - z_m[0]) / (z_m[1] - z_m[0])) for z in (region.z_min_m, region.z_max_m))
        parts |= {part for part in heights if 0 <= part <= 1}
    return parts
