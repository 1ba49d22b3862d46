"""One GeoJSON geometry as a shape: read as it is where it is valid, repaired where it is not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, MultiPolygon, Point, Polygon
from shapely.errors import GEOSException

from semap.errors import InvalidInput

Shape: TypeAlias = Polygon | MultiPolygon | LineString | Point


class ShapeError(ValueError):
    """The geometry cannot be used; the feature is to be skipped."""


@dataclass(frozen=True)
class ShapeNote:
    """What was done to a geometry ('repaired' or 'note'), and why."""

    action: str
    reason: str


def parse_shape(geometry: object, where: str) -> tuple[Shape, tuple[ShapeNote, ...]]:
    """The shape of a GeoJSON geometry on the xy plane; the coordinates of a valid one are not touched.

    where    names the feature in errors
    raises   ShapeError if it says nothing that semap can use; InvalidInput if a coordinate is no finite
             number, or the coordinates are not nested as the type demands
    """
    if not isinstance(geometry, Mapping):
        raise ShapeError("it has no geometry")
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if not isinstance(coordinates, list) or not coordinates:
        raise ShapeError(f"its geometry {kind!r} has no coordinates")
    notes: list[ShapeNote] = []
    shape: Shape
    if kind == "Polygon":
        shape = _repaired(_polygon(coordinates, where, notes), notes)
    elif kind == "MultiPolygon":
        parts = [_polygon(_list(part, where), where, notes) for part in coordinates]
        shape = _repaired(MultiPolygon(parts), notes)
    elif kind == "LineString":
        shape = LineString(_points(coordinates, 2, where, notes))
        if shape.length == 0:
            raise ShapeError("its line has no length")
    elif kind == "Point":
        shape = Point(_points([coordinates], 1, where, notes)[0])
    else:
        raise ShapeError(f"a geometry of type {kind!r} is neither a polygon, a line nor a point")
    return shape, tuple(dict.fromkeys(notes))


def _polygon(rings: list[object], where: str, notes: list[ShapeNote]) -> Polygon:
    closed: list[NDArray[np.float64]] = []
    for ring in rings:
        points = _points(ring, 3, where, notes)
        if (points[0] != points[-1]).any():
            notes.append(ShapeNote("repaired", "a ring is not closed"))
            points = np.concatenate([points, points[:1]])
        is_repeated = np.zeros(len(points), dtype=bool)
        is_repeated[1:] = (points[1:] == points[:-1]).all(axis=1)
        if is_repeated.any():
            notes.append(ShapeNote("repaired", "a ring repeats a point"))
            points = points[~is_repeated]
        if len(points) < 4:
            raise ShapeError("a ring has fewer than three different points")
        closed.append(points)
    if not closed:
        raise ShapeError("its polygon has no ring")
    return Polygon(closed[0], closed[1:])


def _repaired(shape: Polygon | MultiPolygon, notes: list[ShapeNote]) -> Polygon | MultiPolygon:
    if shape.is_valid:
        return shape
    reason = shapely.is_valid_reason(shape)
    try:
        valid = shapely.union_all(list(_polygonal_parts(shapely.make_valid(shape))))
    except GEOSException as error:
        raise ShapeError(f"it cannot be repaired ({reason}; {error})") from error
    if valid.is_empty or not isinstance(valid, Polygon | MultiPolygon):
        raise ShapeError(f"it encloses no area ({reason})")
    notes.append(ShapeNote("repaired", reason))
    return valid


def _polygonal_parts(shape: shapely.Geometry) -> Iterable[Polygon]:
    for part in shapely.get_parts(shape):
        if isinstance(part, Polygon):
            yield part
        elif isinstance(part, MultiPolygon):
            yield from part.geoms


def _points(points: object, least: int, where: str, notes: list[ShapeNote]) -> NDArray[np.float64]:
    """(n, 2) float64; a third coordinate is left out and noted."""
    rows = [_list(point, where) for point in _list(points, where)]
    if len(rows) < least:
        raise ShapeError(f"{len(rows)} points are too few")
    if any(len(row) < 2 for row in rows):
        raise InvalidInput("a point has fewer than two coordinates", "Give x and y.", where)
    if any(len(row) > 2 for row in rows):
        notes.append(ShapeNote("note", "heights in coordinates are not used; give `elevation_m`"))
    pairs = [row[:2] for row in rows]
    if any(isinstance(value, bool) or not isinstance(value, int | float) for pair in pairs for value in pair):
        raise InvalidInput("a coordinate is not a number", "Give numbers.", where)
    try:
        array = np.array(pairs, dtype=np.float64)
    except OverflowError:
        array = np.array([[np.inf, np.inf]])
    if not np.isfinite(array).all():
        raise InvalidInput("a coordinate is not finite", "Give finite numbers.", where)
    return array


def _list(value: object, where: str) -> list[object]:
    if not isinstance(value, list):
        raise InvalidInput(
            "its coordinates are not nested as its type demands",
            "A polygon is a list of rings, a ring a list of points.",
            where,
        )
    return value
