"""What a declaration says of the scene, in plain Python: shapely for what is flat, intervals for heights."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely
from query_scene import THINGS, WALKERS, Thing, Walker

from semap.cql2 import parse
from semap.cql2.evaluate import Subject, compile_filter
from semap.cql2.logic import code
from semap.model.continuous_query import Declaration, Side
from semap.query_text.condition import KINDS

One = Thing | Walker
REACH_M = 10.0


def pairs(declaration: Declaration) -> list[tuple[One, One]]:
    """Subject and object of each relation that holds."""
    subjects, objects = members(declaration.subject), members(declaration.object)
    if declaration.predicate == "nearest":
        return list(_nearest(declaration, subjects, objects))
    return [(s, o) for s in subjects for o in objects if s is not o and holds(declaration, s, o)]


def members(side: Side) -> list[One]:
    """Those of whom all is true that a side asks for."""
    all_: tuple[One, ...] = WALKERS if side.kind == "track" else THINGS
    subject = Subject(
        kinds=KINDS[side.kind],
        parameters="thing",
        property_of=lambda name: code(f"thing.get({name!r})"),
        is_a=lambda concept: code(f"{concept!r} in thing['concepts']"),
    )
    found = []
    for one in all_:
        if side.concept is not None and side.concept not in one.properties["concepts"]:  # type: ignore[operator]
            continue
        if side.uids is not None and one.uid not in side.uids:
            continue
        if side.where is not None and not compile_filter(parse(side.where), subject)(one.properties):
            continue
        found.append(one)
    return found


def holds(declaration: Declaration, s: One, o: One) -> bool:
    match declaration.predicate:
        case "contains" | "covers":
            within = getattr(shape(o, declaration), declaration.predicate)(shape(s, declaration))
            return within and (declaration.dimensions == 2 or _within_heights(s, o))
        case "intersects":
            a, b = (ground(each) if isinstance(each, Walker) else shape(each, declaration) for each in (s, o))
            return a is not None and b is not None and a.intersects(b)
        case "within_distance":
            return gap(declaration, s, o) <= (declaration.distance_m or 0)
        case "on":
            return _stands_on(s, o)
        case "in_front_of" | "behind" | "left_of" | "right_of":
            return _beside(declaration.predicate, s, o)
        case "facing":
            return _faces(s, o, declaration.angle_rad or 0)
        case "approaching":
            return _approaches(s, o, declaration.speed_mps or 0, declaration.distance_m or 0)
        case "crosses":
            assert isinstance(s, Walker)
            assert isinstance(o, Thing)
            return shapely.LineString([s.before, s.now]).intersects(o.footprint)
    raise AssertionError(declaration.predicate)


def shape(one: One, declaration: Declaration) -> shapely.Geometry:
    if isinstance(one, Walker):
        return shapely.Point(one.now)
    match declaration.abstraction:
        case "Position2D":
            return _position(one)
        case "FootprintHull":
            return one.footprint.convex_hull
    return one.footprint


def _position(one: Thing) -> shapely.Point:
    """The middle of the hull of its outline."""
    return one.footprint.convex_hull.centroid


def ground(one: Walker) -> shapely.Polygon | None:
    """The ellipse of 16 corners that a body of known size covers."""
    if one.size is None:
        return None
    length, width = one.size
    if one.heading_rad is None:
        length = width = max(one.size)
    circle = shapely.Polygon([(math.cos(n * math.pi / 8), math.sin(n * math.pi / 8)) for n in range(16)])
    turned = shapely.affinity.rotate(
        shapely.affinity.scale(circle, length / 2, width / 2, origin=(0, 0)),
        one.heading_rad or 0, origin=(0, 0), use_radians=True,
    )  # fmt: skip
    return shapely.affinity.translate(turned, *one.now)


def gap(declaration: Declaration, s: One, o: One) -> float:
    if declaration.dimensions == 2:
        return float(shape(s, declaration).distance(shape(o, declaration)))
    if declaration.abstraction == "Position3D":
        flat = shapely.distance(*(_at(each) for each in (s, o)))
        return math.hypot(flat, _apart(_middle(s), _middle(o)))
    flat = shapely.distance(
        *(_at(each) if isinstance(each, Walker) else each.footprint.convex_hull for each in (s, o))
    )
    return math.hypot(flat, _apart(_heights(s), _heights(o)))


def _at(one: One) -> shapely.Point:
    return shapely.Point(one.now) if isinstance(one, Walker) else _position(one)


def _heights(one: One) -> tuple[float, float]:
    if isinstance(one, Thing):
        return one.heights
    return (-math.inf, math.inf) if one.z_m is None else (one.z_m, one.z_m)


def _middle(one: One) -> tuple[float, float]:
    if isinstance(one, Walker):
        return _heights(one)
    return (sum(one.heights) / 2, sum(one.heights) / 2)


def _apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    return max(0.0, b[0] - a[1], a[0] - b[1])


def _within_heights(s: One, o: One) -> bool:
    low, high = _heights(o)
    if isinstance(s, Walker):
        return s.z_m is None or low <= s.z_m < high
    return low <= s.heights[0] and s.heights[1] <= high


def _nearest(declaration: Declaration, subjects: list[One], objects: list[One]) -> Iterator[tuple[One, One]]:
    for s in subjects:
        others = sorted((o for o in objects if o is not s), key=lambda o: gap(declaration, s, o))
        yield from ((s, o) for o in others[: declaration.count])


def is_tied(declaration: Declaration) -> bool:
    """Whether the last of the nearest of some subject is as near as the next one."""
    objects = members(declaration.object)
    for s in members(declaration.subject):
        gaps = sorted(gap(declaration, s, o) for o in objects if o is not s)
        if gaps[declaration.count - 1 : declaration.count] == gaps[declaration.count : declaration.count + 1]:
            return True
    return False


def _stands_on(s: One, o: One) -> bool:
    assert isinstance(o, Thing)
    if isinstance(s, Walker):
        on_top = s.z_m is None or o.heights[1] - 0.1 <= s.z_m < o.heights[1] + 0.5
        return on_top and o.footprint.covers(shapely.Point(s.now))
    return abs(s.heights[0] - o.heights[1]) <= 0.05 and o.footprint.intersection(s.footprint).area > 0


def _beside(direction: str, s: One, o: One) -> bool:
    """Of boxes along the axes; x is forward in the object's own frame."""
    assert isinstance(o, Thing)
    turned = {"in_front_of": 0, "left_of": 1, "behind": 2, "right_of": 3}[direction] + o.turned
    x_min, y_min, x_max, y_max = o.footprint.bounds
    region = (
        (x_max, y_min, x_max + REACH_M, y_max), (x_min, y_max, x_max, y_max + REACH_M),
        (x_min - REACH_M, y_min, x_min, y_max), (x_min, y_min - REACH_M, x_max, y_min),
    )[turned % 4]  # fmt: skip
    if isinstance(s, Walker):
        return shapely.box(*region).contains(shapely.Point(s.now)) and _within_heights(s, o)
    low, high = s.heights
    return (
        shapely.box(*region).intersection(s.footprint).area > 0 and low < o.heights[1] and high > o.heights[0]
    )


def _faces(s: One, o: One, angle_rad: float) -> bool:
    assert isinstance(s, Walker)
    if s.heading_rad is None:
        return False
    x_m, y_m = np.subtract(_at(o).coords[0], s.now)
    turn = np.angle(complex(x_m, y_m) * np.exp(-1j * s.heading_rad))
    return bool(abs(turn) <= angle_rad)


def _approaches(s: One, o: One, speed_mps: float, within_m: float) -> bool:
    """The distance a moment later is less by that speed."""
    assert isinstance(s, Walker)
    if s.heading_rad is None or s.speed_mps is None:
        return False
    moment_s = 1e-6
    there = shapely.Point(o.now) if isinstance(o, Walker) else o.footprint
    if not 0 < there.distance(shapely.Point(s.now)) <= within_m:
        return False
    later = there if isinstance(o, Thing) else shapely.Point(_later(o, moment_s))
    falls_m = there.distance(shapely.Point(s.now)) - later.distance(shapely.Point(_later(s, moment_s)))
    return falls_m / moment_s >= speed_mps


def _later(one: Walker, moment_s: float) -> tuple[float, float]:
    speed, heading = one.speed_mps or 0.0, one.heading_rad or 0.0
    x_m, y_m = one.now
    return x_m + moment_s * speed * math.cos(heading), y_m + moment_s * speed * math.sin(heading)
