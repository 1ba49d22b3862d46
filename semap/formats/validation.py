"""What is doubtful about a building: exports of planning programs are often shifted or incomplete.

Nothing is changed; each doubt is a finding that says what to look at. Only what lies beyond any place on
earth is refused.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, STRtree

from semap.errors import InvalidInput
from semap.formats.refusals import Refusals
from semap.geometry.abstractions import FARTHEST_M
from semap.geometry.outline import outline
from semap.geometry.pose import transform_mesh, transform_points
from semap.model.building import Building, Finding, HeightBand, Item, Storey

OVERLAP_M2 = 0.01
OVERLAP_M = 0.01
"""Rooms overlap if they share more area than this, and more height."""

HUGE_M = 10_000.0
LONGEST_NAME = 200
HUGE_ROOM_M = 300.0
"""Half of the rooms are as wide as that in no building."""

TINY_M = 1.0
FAR_M = 10_000.0
BELOW_STOREY_M = 1.0
"""How far a storey's rooms may begin below its elevation, sunken floors included."""


def refuse_unusable(building: Building, where: str) -> None:
    """raises  InvalidInput if names are too long, or something lies where no place on earth is"""
    wrong = Refusals()
    for storey in building.storeys:
        with wrong.of_part(-1):
            require_short("storey", storey.name)
    for place, item in enumerate(building.items):
        with wrong.of_part(place):
            require_short("thing", item.name)
            require_short("concept", item.concept)
            reach_m = float(np.abs(_corners([item])).max(initial=0))
            reach_m = max(reach_m, *(abs(each) for each in (item.pose.x_m, item.pose.y_m, item.pose.z_m)))
            if not reach_m <= FARTHEST_M:
                raise InvalidInput(
                    f"it lies {reach_m:.3g} m from the origin, where nothing can be",
                    "Mind the unit, and shift the building to an origin of its own.",
                    repr(item.name),
                )
    wrong.raise_if_any("things", where)


def require_short(kind: str, name: str, where: str = "") -> None:
    """raises  InvalidInput for a name that neither an index nor the service would take"""
    if len(name) > LONGEST_NAME:
        raise InvalidInput(
            f"the {kind} {name[:20]!r}... has a name of {len(name)} characters",
            f"Choose one of at most {LONGEST_NAME}.",
            where,
        )


def doubts(building: Building) -> tuple[Finding, ...]:
    """Findings, action 'note', on the parts of a building and on the whole.

    Rooms without geometry, rooms that overlap, doors that join nothing or more than two, names given
    twice, a size that no building has, a place far from the origin, storeys that are not in order.
    """
    rooms = [item for item in building.items if item.concept == "Room"]
    outlines = {place: area for place, item in enumerate(rooms) if (area := _outline(item)) is not None}
    corners_m = _corners(building.items)
    kinds: Sequence[Iterator[Finding]] = (
        _size(corners_m, list(outlines.values())),
        _repeated_names(building),
        _without_geometry(rooms),
        _overlaps(rooms, outlines),
        _joins(building.items),
        _shift(corners_m),
        _storeys(building.storeys, rooms),
    )
    return tuple(finding for kind in kinds for finding in kind)


def _repeated_names(building: Building) -> Iterator[Finding]:
    counts = Counter([*(each.name for each in building.storeys), *(each.name for each in building.items)])
    for name, count in counts.items():
        if count > 1:
            yield Finding("note", name, f"its name is given {count} times; it must occur once on a map")


def _without_geometry(rooms: Sequence[Item]) -> Iterator[Finding]:
    for room in rooms:
        if room.body is None and room.footprint is None:
            yield Finding("note", room.name, "a room without geometry: nothing is ever found in it")


def _overlaps(rooms: Sequence[Item], outlines: Mapping[int, Polygon | MultiPolygon]) -> Iterator[Finding]:
    if not outlines:
        return
    places = list(outlines)
    shapes = [outlines[place] for place in places]
    heights = [_heights(rooms[place]) for place in places]
    for i, j in STRtree(shapes).query(shapes, predicate="intersects").T.tolist():
        one, other = rooms[places[i]], rooms[places[j]]
        if i >= j or one.storey != other.storey or not _share_height(heights[i], heights[j]):
            continue
        area_m2 = shapes[i].intersection(shapes[j]).area
        if area_m2 > OVERLAP_M2:
            reason = f"it overlaps {other.name!r} by {area_m2:.2f} m2; a track there is in both"
            yield Finding("note", one.name, reason)


def _joins(items: Sequence[Item]) -> Iterator[Finding]:
    for item in items:
        if item.concept in ("Door", "Opening") and not item.joins:
            yield Finding("note", item.name, f"the {item.concept.lower()} joins no room")
        elif len(item.joins) > 2:
            yield Finding("note", item.name, f"it joins {len(item.joins)} rooms; all are kept")


def _size(corners_m: NDArray[np.float64], outlines: Sequence[Polygon | MultiPolygon]) -> Iterator[Finding]:
    if len(corners_m) < 2:
        return
    extent_m = float(np.ptp(corners_m[:, :2], axis=0).max())
    bounds_m = shapely.bounds(np.array(outlines, dtype=object)).reshape(-1, 4)
    widths_m = np.maximum(bounds_m[:, 2] - bounds_m[:, 0], bounds_m[:, 3] - bounds_m[:, 1])
    room_m = float(np.median(widths_m)) if len(widths_m) else 0.0
    if extent_m > HUGE_M or room_m > HUGE_ROOM_M:
        what = f"its rooms {room_m:.3g} m" if room_m > HUGE_ROOM_M else "no building is so wide"
        yield Finding(
            "note",
            "units",
            f"the building is {extent_m:.3g} m wide, {what}; is it in cm or mm? Scale it to metres, and"
            " import it again",
        )
    elif 0 < extent_m < TINY_M:
        yield Finding("note", "units", f"the building is {extent_m:.2g} m wide; is it in km or degrees?")


def _shift(corners_m: NDArray[np.float64]) -> Iterator[Finding]:
    if len(corners_m) == 0:
        return
    nearest_m = np.maximum(np.maximum(corners_m.min(axis=0), -corners_m.max(axis=0)), 0.0)
    if nearest_m.max() > FAR_M:
        x_m, y_m, z_m = corners_m.min(axis=0)
        yield Finding(
            "note",
            "origin",
            f"the building lies far from it, from ({x_m:.0f}, {y_m:.0f}, {z_m:.0f}) m on; shift it to an"
            " origin of its own, and if these are coordinates of a survey, anchor the map there",
        )


def _storeys(storeys: Sequence[Storey], rooms: Sequence[Item]) -> Iterator[Finding]:
    by_elevation: dict[float, str] = {}
    for storey in storeys:
        other = by_elevation.setdefault(storey.elevation_m, storey.name)
        if other != storey.name:
            yield Finding(
                "note", storey.name, f"it has the same elevation as {other!r}: {storey.elevation_m:g} m"
            )
    ordered = sorted(storeys, key=lambda storey: storey.elevation_m)
    above_of = {one.name: other.elevation_m for one, other in pairwise(ordered)}
    for storey in storeys:
        bottoms_m = [
            band.z_min_m
            for room in rooms
            if room.storey == storey.name and (band := _heights(room)) is not None
        ]
        if not bottoms_m:
            continue
        bottom_m = float(np.median(bottoms_m))
        if bottom_m < storey.elevation_m - BELOW_STOREY_M or bottom_m >= above_of.get(storey.name, np.inf):
            yield Finding(
                "note",
                storey.name,
                f"its elevation is {storey.elevation_m:g} m, but its rooms begin at {bottom_m:.2f} m",
            )


def _outline(item: Item) -> Polygon | MultiPolygon | None:
    if item.footprint is not None:
        return item.footprint
    if item.body is None:
        return None
    try:
        return outline(transform_mesh(item.pose.matrix(), item.body))
    except InvalidInput:
        # A body without area; the import says so.
        return None


def _heights(item: Item) -> HeightBand | None:
    """The band, else the heights of the body; None: unknown, or every height."""
    if item.band is not None or item.body is None:
        return item.band
    heights_m = transform_points(item.pose.matrix(), item.body.vertices_m)[:, 2]
    return HeightBand(float(heights_m.min()), float(heights_m.max()))


def _share_height(one: HeightBand | None, other: HeightBand | None) -> bool:
    if one is None or other is None:
        return True
    return min(one.z_max_m, other.z_max_m) - max(one.z_min_m, other.z_min_m) > OVERLAP_M


def _corners(items: Sequence[Item]) -> NDArray[np.float64]:
    """(n, 3) corners [m, map frame] of all shapes; those of outlines at height 0."""
    parts: list[NDArray[np.float64]] = []
    for item in items:
        if item.body is not None and len(item.body.vertices_m):
            parts.append(transform_points(item.pose.matrix(), item.body.vertices_m))
        elif item.footprint is not None:
            flat = shapely.get_coordinates(item.footprint)
            parts.append(np.column_stack([flat, np.zeros(len(flat))]))
    return np.concatenate(parts) if parts else np.empty((0, 3))
