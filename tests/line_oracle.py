"""Where a way crosses the line of a shape, exactly: by rational numbers, and by the sides on which its pieces lie."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise

import shapely


def walked(
    shape: shapely.Geometry, start: tuple[float, float], end: tuple[float, float], left: bool | None
) -> Iterable[tuple[Fraction | None, bool | None, bool | None]]:
    """Crossings of a shape's line on a way, exactly: parts, the side that is left, and (last) what is remembered.

    Sides: of an area its inside is left; of a line that goes on to the right all the way, what is above it.
    """
    a = Fraction(start[0]), Fraction(start[1])
    b = Fraction(end[0]), Fraction(end[1])
    is_left = inside_of if shape.geom_type != "LineString" else above
    if a == b:
        return [(None, None, left)]
    cuts = sorted({Fraction(0), Fraction(1), *meetings(shape, a, b)})
    found: list[tuple[Fraction | None, bool | None, bool | None]] = []
    came = is_left(shape, a)
    came = left if came is None else came
    for u, v in pairwise(cuts):
        now = is_left(shape, on_way(a, b, (u + v) / 2))
        if now is not None:
            if came is not None and now != came and strictly_on(shape, on_way(a, b, u)):
                found.append((u, came, None))
            came = now
    at_end = is_left(shape, b)
    return [*found, (None, None, came if at_end is None else None)]


Exact = tuple[Fraction, Fraction]


def on_way(a: Exact, b: Exact, part: Fraction) -> Exact:
    return a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])


def cross(o: Exact, a: Exact, b: Exact) -> Fraction:
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def edges(shape: shapely.Geometry) -> Iterable[tuple[Exact, Exact]]:
    lines = [shape] if shape.geom_type == "LineString" else shapely.get_parts(shapely.boundary(shape))
    for line in lines:
        points = [(Fraction(x), Fraction(y)) for x, y in line.coords]
        if shape.geom_type == "LineString":  # far beyond both ends, steeper than any way
            (x, y), (u, v) = points[0], points[-1]
            points = [(x - 1, y - 97 - Fraction(1, 13)), *points, (u + 1, v + 89 + Fraction(1, 17))]
        yield from pairwise(points)


def meetings(shape: shapely.Geometry, a: Exact, b: Exact) -> Iterable[Fraction]:
    length = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
    for p, q in edges(shape):
        from_p, from_q = cross(a, b, p), cross(a, b, q)
        for corner, side in ((p, from_p), (q, from_q)):
            if side == 0:
                part = ((corner[0] - a[0]) * (b[0] - a[0]) + (corner[1] - a[1]) * (b[1] - a[1])) / length
                if 0 <= part <= 1:
                    yield part
        if from_p * from_q < 0:
            from_a, from_b = cross(p, q, a), cross(p, q, b)
            part = from_a / (from_a - from_b)
            if 0 <= part <= 1:
                yield part


def inside_of(shape: shapely.Geometry, point: Exact) -> bool | None:
    inside = False
    for p, q in edges(shape):
        side = cross(p, q, point)
        if side == 0 and min(p[0], q[0]) <= point[0] <= max(p[0], q[0]) and (
            min(p[1], q[1]) <= point[1] <= max(p[1], q[1])
        ):  # fmt: skip
            return None
        if (p[1] > point[1]) != (q[1] > point[1]) and (side > 0) == (q[1] > p[1]):
            inside = not inside
    return inside


def above(shape: shapely.Geometry, point: Exact) -> bool | None:
    parts = list(edges(shape))
    if point[0] < parts[0][0][0]:
        p, q = parts[0]
    elif point[0] >= parts[-1][0][0]:
        p, q = parts[-1]
    else:
        p, q = next((p, q) for p, q in parts if p[0] <= point[0] <= q[0])
    side = cross(p, q, point)
    return None if side == 0 else side > 0


def strictly_on(shape: shapely.Geometry, point: Exact) -> bool:
    """Whether a point of the line is not an end of it, or beyond."""
    if shape.geom_type != "LineString":
        return True
    return Fraction(shape.coords[0][0]) < point[0] < Fraction(shape.coords[-1][0])
