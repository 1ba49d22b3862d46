"""Which rooms a door joins, found from shapes where a file does not say.

The door's long axis splits its surroundings in two sides. On each side a strip, as long as the door and
`REACH_M` deeper than its frame, is laid against the rooms; the room that fills most of it is joined. A
room beyond the door's end, around a corner, therefore never counts, however near it is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon, STRtree

REACH_M = 0.3
"""Rooms end at the wall's face; the door stands somewhere in the wall's thickness."""

CONTACT_M2 = 1e-3
"""A room that fills less of the strip only touches it."""


class Floor:
    """The rooms of one storey by where they are; footprints by name [m, map frame]."""

    def __init__(self, rooms: Mapping[str, Polygon | MultiPolygon]) -> None:
        self._names = list(rooms)
        self._footprints = list(rooms.values())
        self._tree = STRtree(self._footprints)

    def around(self, shape: shapely.Geometry) -> dict[str, Polygon | MultiPolygon]:
        """The rooms whose box meets that of a shape."""
        return {self._names[place]: self._footprints[place] for place in self._tree.query(shape).tolist()}


def joined_rooms(opening: shapely.Geometry, floor: Floor) -> tuple[str, ...]:
    """The names of at most two rooms on both sides of an opening, sorted.

    opening  its outline seen from above, its line in the wall, or a point [m, map frame]
    floor    the rooms of the opening's storey
    """
    if shapely.length(opening) == 0:
        return tuple(sorted(_nearest(opening, floor.around(opening.buffer(REACH_M)))))
    axis, half_depth_m = _long_axis(opening)
    strips = [
        axis.buffer(side * (half_depth_m + REACH_M), cap_style="flat", single_sided=True) for side in (1, -1)
    ]
    contacts = [_contacts(strip, floor.around(strip)) for strip in strips]
    return tuple(sorted(_one_on_each_side(*contacts)))


def _nearest(point: shapely.Geometry, rooms: Mapping[str, Polygon | MultiPolygon]) -> list[str]:
    distances_m = {name: shapely.distance(point, footprint) for name, footprint in rooms.items()}
    within = [name for name, distance_m in distances_m.items() if distance_m <= REACH_M]
    return sorted(within, key=lambda name: (distances_m[name], name))[:2]


def _long_axis(opening: shapely.Geometry) -> tuple[LineString, float]:
    """The middle line of the smallest rectangle around the opening, and half the rectangle's depth [m]."""
    box = opening.minimum_rotated_rectangle
    if isinstance(box, LineString | Point):
        return LineString(shapely.get_coordinates(box)[[0, -1]]), 0.0
    corners = shapely.get_coordinates(box)[:4]
    if np.linalg.norm(corners[1] - corners[0]) < np.linalg.norm(corners[2] - corners[1]):
        corners = np.roll(corners, -1, axis=0)
    a, b, c, d = corners
    return LineString([(a + d) / 2, (b + c) / 2]), float(np.linalg.norm(d - a) / 2)


def _contacts(strip: Polygon, rooms: Mapping[str, Polygon | MultiPolygon]) -> list[tuple[float, str]]:
    """Areas [m2] and names of the rooms in a strip, the largest first."""
    areas = ((float(strip.intersection(footprint).area), name) for name, footprint in rooms.items())
    return sorted(((area, name) for area, name in areas if area > CONTACT_M2), key=lambda c: (-c[0], c[1]))


def _one_on_each_side(left: list[tuple[float, str]], right: list[tuple[float, str]]) -> set[str]:
    """The best of each side; a room that is best on both keeps the side that it fills more."""
    if left and right and left[0][1] == right[0][1]:
        shared = left[0][1]
        weaker = right if left[0][0] >= right[0][0] else left
        return {shared, *(name for _, name in weaker[1:2])}
    return {side[0][1] for side in (left, right) if side}
