"""Reading CQL2, text or JSON, to the same tree; neither time nor depth can run away."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Mapping
from datetime import UTC, datetime

import numpy as np
import shapely
from shapely.geometry import shape

from semap.cql2.check import OPERATORS
from semap.cql2.expression import Array, Call, Expression, Instant, Interval, Literal, Property, Shape
from semap.cql2.text import DEEPEST, STANDARD, read_text
from semap.errors import InvalidInput

LONGEST = 8_000
"""Characters of a text."""

MOST_PARTS = 2_000
SHAPES = (
    "Point",
    "MultiPoint",
    "LineString",
    "MultiLineString",
    "Polygon",
    "MultiPolygon",
    "GeometryCollection",
)
LITERALS = ("property", "timestamp", "date", "interval", "bbox", "type", "op")
CANONICAL = {name.lower(): name for name in OPERATORS}


def parse(
    source: str | Mapping[str, object] | bool,
    place: str = "filter",
    functions: Collection[str] = (),
    *,
    degrees: bool = False,
) -> Expression:
    """A filter from CQL2 text, or from CQL2 JSON that is read already.

    place      how messages call it
    functions  that are known beside CQL2's own; they may also stand as ends of an interval
    degrees    whether shapes are in longitude and latitude, so that a box may cross the antimeridian
    raises     InvalidInput with the place that cannot be read
    """
    if isinstance(source, str) and len(source) > LONGEST:
        raise InvalidInput(f"more than {LONGEST} characters", "Use CQL2 JSON, or a shorter filter.", place)
    document = read_text(source, place) if isinstance(source, str) else source
    return _Reader(functions, degrees=degrees).expression(document, place, 0)


class _Reader:
    """Makes the tree and counts its parts."""

    def __init__(self, functions: Collection[str], *, degrees: bool) -> None:
        self.count = 0
        self.degrees = degrees
        self.functions = {name.lower(): name for name in functions}

    def expression(self, value: object, place: str, depth: int) -> Expression:
        self.count += 1
        if depth > DEEPEST or self.count > MOST_PARTS:
            raise InvalidInput(f"more than {DEEPEST} levels or {MOST_PARTS} parts", "Ask for less.", place)
        match value:
            case None | bool() | str():
                return Literal(value, place)
            case int() | float():
                return Literal(_number(value, place), place)
            case list() | tuple():
                items = (self.expression(each, f"{place}[{n}]", depth + 1) for n, each in enumerate(value))
                return Array(tuple(items), place)
            case {"op": str(op), "args": list(args), **rest} if not rest:
                return self._call(op, args, place, depth)
            case {"property": str(name), **rest} if not rest:
                return Property(name, place)
            case {"timestamp": str(stamp), **rest} if not rest:
                return _timestamp(stamp, place)
            case {"date": str(day), **rest} if not rest:
                return _date(day, place)
            case {"interval": [start, end], **rest} if not rest:
                first = self._end_of(start, f"{place}[0]", depth)
                return Interval(first, self._end_of(end, f"{place}[1]", depth), place)
            case {"bbox": list(bounds), **rest} if not rest:
                return _bbox(bounds, place, degrees=self.degrees)
            case {"type": "GeometryCollection", "geometries": list() | tuple()}:
                return _shape(value, place)
            case {"type": str(kind), "coordinates": list() | tuple()} if kind != "GeometryCollection":
                return _shape(value, place)
        raise InvalidInput(
            "it is none of " + ", ".join(LITERALS), f"Give a part as CQL2 JSON writes it. {STANDARD}", place
        )

    def _call(self, op: str, args: list[object], place: str, depth: int) -> Call:
        canonical = CANONICAL | self.functions
        name = canonical.get(op.lower())
        if name is None:
            near = difflib.get_close_matches(op.lower(), canonical, n=1, cutoff=0.7)
            hint = f"Did you mean {canonical[near[0]]}? " if near else ""
            known = ", ".join(canonical.values())
            raise InvalidInput(f"there is no operator or function {op}", f"{hint}There are {known}.", place)
        inner = (self.expression(each, f"{place}.args[{n}]", depth + 1) for n, each in enumerate(args))
        return Call(name, tuple(inner), place)

    def _end_of(self, value: object, place: str, depth: int) -> Instant | Property | Call | None:
        match value:
            case {"op": str(op), "args": list(args), **rest} if not rest and op.lower() in self.functions:
                return self._call(op, args, place, depth + 1)
        return _end_of(value, place)


def _number(value: float, place: str) -> float:
    try:
        finite = math.isfinite(value)
    except OverflowError:  # of an int that no float holds
        finite = False
    if not finite:
        raise InvalidInput("a number that is not finite, or too large for a float", "Give a number.", place)
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 2**53 else value


def _timestamp(stamp: str, place: str) -> Instant:
    try:
        read = datetime.fromisoformat(stamp)
        if read.tzinfo is None:
            raise InvalidInput(f"{stamp} is in no time zone", "Write 2026-01-31T12:00:00Z.", place)
        return Instant(read.astimezone(UTC), place)
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f"{stamp} is no time", "Write 2026-01-31T12:00:00Z.", place) from error


def _date(day: str, place: str) -> Instant:
    try:
        return Instant(datetime.strptime(day, "%Y-%m-%d").replace(tzinfo=UTC), place)
    except ValueError as error:
        raise InvalidInput(f"{day} is no date", "Write 2026-01-31.", place) from error


def _end_of(value: object, place: str) -> Instant | Property | None:
    match value:
        case "..":
            return None
        case str():
            return _timestamp(value, place) if "T" in value.upper() else _date(value, place)
        case {"property": str(name)}:
            return Property(name, place)
        case {"timestamp": str(stamp)}:
            return _timestamp(stamp, place)
        case {"date": str(day)}:
            return _date(day, place)
    raise InvalidInput("it is no end of an interval", "Give a time, a date, a property or '..'.", place)


def _bbox(bounds: list[object], place: str, *, degrees: bool) -> Shape:
    if len(bounds) not in (4, 6) or not all(isinstance(each, int | float) for each in bounds):
        raise InvalidInput(
            "a box that is not of four or six numbers", "Give BBOX(x_min, y_min, x_max, y_max).", place
        )
    half = len(bounds) // 2
    x_min, y_min, x_max, y_max = (_number(each, place) for each in (*bounds[:2], *bounds[half : half + 2]))  # type: ignore[arg-type]
    if degrees and 180 >= x_min > x_max >= -180 and y_min < y_max:
        parts = [shapely.box(x_min, y_min, 180, y_max), shapely.box(-180, y_min, x_max, y_max)]
        return Shape(shapely.multipolygons([part for part in parts if part.area]), place)
    if not (x_min < x_max and y_min < y_max):
        raise InvalidInput("a box without an area", "Give the lower corner first.", place)
    return Shape(shapely.box(x_min, y_min, x_max, y_max), place)


def _shape(value: object, place: str) -> Shape:
    assert isinstance(value, dict)  # noqa: S101  (matched)
    if value["type"] not in SHAPES:
        raise InvalidInput(f"there is no shape {value['type']}", f"Give one of {', '.join(SHAPES)}.", place)
    try:
        read = shapely.force_2d(shape(value))
    except (
        ValueError,
        TypeError,
        IndexError,
        KeyError,
        AttributeError,
        shapely.errors.GEOSException,
    ) as error:
        raise InvalidInput(f"coordinates that are no {value['type']}", "Close each ring.", place) from error
    if not np.isfinite(shapely.get_coordinates(read)).all():
        raise InvalidInput("coordinates that are not finite", "Give numbers.", place)
    if read.is_empty or not read.is_valid:
        raise InvalidInput(
            f"a {value['type']} that is empty or crosses itself",
            "Give a valid shape in metres of the map.",
            place,
        )
    return Shape(_alike(read), place)


def _alike(read: shapely.Geometry) -> shapely.Geometry:
    """A collection of shapes of one dimension as one shape; another as it is, within no other."""
    if read.geom_type != "GeometryCollection":
        return read
    inner = shapely.get_parts(read)
    while any(part.geom_type == "GeometryCollection" for part in inner):
        inner = shapely.get_parts(inner)
    if len({int(shapely.get_dimensions(part)) for part in inner}) == 1:
        return shapely.union_all(inner)
    return shapely.geometrycollections(inner)
