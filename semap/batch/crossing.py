"""Who was in which region from when to when, by the exact shapes and the way between two states.

A track that is inside at one state and not at the next crossed the edge between them: at the moment at which
the straight way between both does. Across a pause that parts a track, the change counts at the first state
that shows it, as it does for the triggers.

An excursion over the edge that stays nearer to it than the standard deviation of the position says
nothing, and is passed over: where a track stands at an edge, noise and smoothing alone make such.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

Cause = Literal["moved", "appeared", "disappeared"]

MANY_STATES = 150
"""So many states in a row on one side of an edge are no noise."""


@dataclass(frozen=True)
class Area:
    """A region: its outline [m, map frame] and the band of heights that it fills [m, map frame]."""

    region_id: int
    footprint: shapely.Geometry
    z_min_m: float
    z_max_m: float


@dataclass(frozen=True)
class Path:
    """States of tracks, sorted by track and then by stamp.

    track       (n,)
    stamp_us    (n,)
    position_m  (n, 2) [m, map frame]
    std_m       (n,) of the position on each axis [m]
    z_m         (n,) NaN where unknown
    piece       (n,) parts of a track between which nothing is known
    is_last     (n,) the track ended with this state
    is_first    (n,) the track began with this state
    over_us     (n,) of one with which the track ended: when it did, at its stamp or later; None: at its stamp
    """

    track: NDArray[np.int64]
    stamp_us: NDArray[np.int64]
    position_m: NDArray[np.float64]
    std_m: NDArray[np.float64]
    z_m: NDArray[np.float64]
    piece: NDArray[np.int64]
    is_last: NDArray[np.bool_]
    is_first: NDArray[np.bool_]
    over_us: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class Visit:
    """A track was in a region.

    ended_us  None: it was still there at its last state
    began_by  None: it was there already at its first state here, which is not the track's first
    """

    track: int
    region_id: int
    began_us: int
    began_by: Cause | None
    ended_us: int | None
    ended_by: Cause | None


def visits(path: Path, areas: Sequence[Area]) -> Iterator[Visit]:
    """Every visit, area by area, each in the order of the states."""
    if len(path.track) == 0:
        return
    points = shapely.points(path.position_m)
    tree = shapely.STRtree(points)
    for area in areas:
        shapely.prepare(area.footprint)
        inside = np.sort(tree.query(area.footprint, predicate="contains"))
        z_m = path.z_m[inside]
        inside = inside[np.isnan(z_m) | ((z_m >= area.z_min_m) & (z_m < area.z_max_m))]
        if len(inside):
            yield from _of_area(path, area, inside)


def _of_area(path: Path, area: Area, inside: NDArray[np.int64]) -> Iterator[Visit]:
    before, after = inside[:-1], inside[1:]
    parted = (after - before > 1) | (path.track[before] != path.track[after]) | path.is_last[before]
    first = inside[np.concatenate([[True], parted])]
    last = inside[np.concatenate([parted, [True]])]
    for i, k in _telling(path, area, zip(first.tolist(), last.tolist(), strict=True)):
        began_us, began_by = _beginning(path, area, i)
        ended_us, ended_by = _end(path, area, k)
        yield Visit(int(path.track[i]), area.region_id, began_us, began_by, ended_us, ended_by)


def _telling(path: Path, area: Area, runs: Iterable[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Runs of states inside: joined where the track was hardly out, without those where it was hardly in."""
    whole: tuple[int, int] | None = None
    for i, k in runs:
        if (
            whole is not None
            and _is_one_way(path, whole[1], i)
            and not _is_far(path, area, whole[1] + 1, i - 1)
        ):
            whole = whole[0], k
            continue
        if whole is not None and _is_visit(path, area, *whole):
            yield whole
        whole = i, k
    if whole is not None and _is_visit(path, area, *whole):
        yield whole


def _is_visit(path: Path, area: Area, i: int, k: int) -> bool:
    """Whether a run of states inside tells: the track did not only come over the edge a little and go."""
    came_and_went = i > 0 and k + 1 < len(path.track) and _is_one_way(path, i - 1, k + 1)
    return not came_and_went or _is_far(path, area, i, k)


def _is_one_way(path: Path, i: int, k: int) -> bool:
    """Whether one track went from one state to the other, and was seen all the way."""
    return bool(path.piece[i] == path.piece[k] and not path.is_last[i:k].any())


def _is_far(path: Path, area: Area, i: int, k: int) -> bool:
    """Whether one of these states is at least its standard deviation from the edge, or there are many."""
    if k - i >= MANY_STATES:
        return True
    edge = shapely.boundary(area.footprint)
    distance_m = shapely.distance(shapely.points(path.position_m[i : k + 1]), edge)
    z_m = path.z_m[i : k + 1]
    beyond = (z_m < area.z_min_m) | (z_m >= area.z_max_m)
    return bool((beyond | (distance_m >= path.std_m[i : k + 1])).any())


def _beginning(path: Path, area: Area, i: int) -> tuple[int, Cause | None]:
    stamp_us = int(path.stamp_us[i])
    if path.is_first[i]:
        return stamp_us, "appeared"
    if i == 0 or path.track[i - 1] != path.track[i]:
        return stamp_us, None
    if path.piece[i - 1] != path.piece[i]:
        return stamp_us, "moved"
    before_us = int(path.stamp_us[i - 1])
    share = _share_inside(path, area, i, i - 1)
    return stamp_us - int(share * (stamp_us - before_us)), "moved"


def _end(path: Path, area: Area, k: int) -> tuple[int | None, Cause | None]:
    stamp_us = int(path.stamp_us[k])
    if path.is_last[k]:
        return stamp_us if path.over_us is None else int(path.over_us[k]), "disappeared"
    if k + 1 == len(path.track) or path.track[k + 1] != path.track[k]:
        return None, None
    after_us = int(path.stamp_us[k + 1])
    if path.piece[k + 1] != path.piece[k]:
        return after_us, "moved"
    return stamp_us + int(_share_inside(path, area, k, k + 1) * (after_us - stamp_us)), "moved"


def _share_inside(path: Path, area: Area, inner: int, outer: int) -> float:
    """How much of the way from a state inside to a neighbour outside is inside without a break: 0 to 1."""
    start, end = path.position_m[inner], path.position_m[outer]
    way = shapely.LineString([start, end])
    share = 1.0
    if way.length > 0 and not area.footprint.contains(shapely.Point(end)):
        edge = shapely.intersection(way, shapely.boundary(area.footprint))
        share = float(shapely.distance(shapely.Point(start), edge) / way.length)
    from_m, to_m = path.z_m[inner], path.z_m[outer]
    if from_m < to_m and to_m >= area.z_max_m:
        share = min(share, (area.z_max_m - from_m) / (to_m - from_m))
    elif to_m < from_m and to_m < area.z_min_m:
        share = min(share, (from_m - area.z_min_m) / (from_m - to_m))
    return share
