"""A page of a collection: filtered, sorted, and found again by where the page before ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import shapely
from sqlalchemy import (
    ColumnElement,
    Connection,
    LargeBinary,
    Select,
    String,
    Text,
    and_,
    bindparam,
    cast,
    collate,
    false,
    func,
    literal,
    literal_column,
    or_,
    select,
    true,
    tuple_,
    union_all,
)
from sqlalchemy.dialects.postgresql import JSON

from semap.cql2 import Array, Call, Expression, Interval, Kind, Property, Shape
from semap.cql2.check import SPATIAL
from semap.errors import InvalidInput, NotFound
from semap.store.database.connection import translated
from semap.store.database.cql2_sql import condition
from semap.store.database.tables import STAMP, abstraction
from semap.store.features.collection import Collection
from semap.store.features.placing import CRS84, FAR_AWAY, Placed, Placing, System, on_map
from semap.store.features.source import GEOMETRY, TYPES, Source, Sql, source_of

RFC3339_SQL = 'YYYY-MM-DD"T"HH24:MI:SS.US"Z"'
DIGITS_DEG, DIGITS_M = 9, 6
"""A tenth of a millimetre, and a micrometre."""


@dataclass(frozen=True)
class SortKey:
    """A property to sort by; what lacks it comes last."""

    property: str
    descending: bool = False


@dataclass(frozen=True)
class Cursor:
    """Where another page ended: go on after these values of the sort keys and keys, or back before them."""

    values: tuple[object, ...]
    back: bool = False


@dataclass(frozen=True)
class Box:
    """A box in the system of the request, first axis first, with heights [m] where they count."""

    bounds: tuple[float, float, float, float]
    heights_m: tuple[float, float] | None = None

    def shape(self) -> shapely.Geometry:
        """A polygon, or the line or point that a box without an area is."""
        low, high = self.bounds[:2], self.bounds[2:]
        if low == high:
            return shapely.Point(low)
        if low[0] == high[0] or low[1] == high[1]:
            return shapely.LineString([low, high])
        return shapely.box(*self.bounds)


@dataclass(frozen=True)
class Wanted:
    """Which features, in which order, and how they are shown.

    boxes       any of these
    start, end  what was at some time between, both included; None: without an end on that side
    filter      checked, over the properties of the source; shapes in `filter_system`
    properties  None: all
    """

    boxes: tuple[Box, ...] = ()
    box_system: System = CRS84
    start: datetime | None = None
    end: datetime | None = None
    filter: Expression | None = None
    filter_system: System = CRS84
    sort: tuple[SortKey, ...] = ()
    properties: tuple[str, ...] | None = None
    system: System = CRS84


@dataclass(frozen=True)
class Page:
    """Features as GeoJSON texts; `first` and `last` are where it begins and ends.

    matched  how many features there are on all pages
    """

    features: tuple[str, ...]
    matched: int
    first: tuple[object, ...] | None
    last: tuple[object, ...] | None
    before: bool
    after: bool


def read_page(
    connection: Connection,
    collection: Collection,
    placing: Placing,
    wanted: Wanted,
    *,
    limit: int,
    offset: int = 0,
    cursor: Cursor | None = None,
) -> Page:
    """At most `limit` features of a collection.

    raises  InvalidInput for a cursor that does not fit the sort keys
    """
    source = source_of(collection)
    where = _conditions(connection, source, placing, wanted)
    matched = _matched(connection, source, where)
    keys = _sort_keys(source, wanted.sort)
    back = cursor is not None and cursor.back
    statement = _features(source, placing, wanted, keys).order_by(*_order(keys, back))
    if cursor is not None:
        statement = statement.where(*where, _beyond(keys, cursor)).limit(limit + 1)
    elif offset:
        # by their keys first: what is passed over is not shown
        ids = list(source.keys.values())
        passed = select(*ids).select_from(source.rows).where(*where).order_by(*_order(keys, back))
        statement = statement.where(tuple_(*ids).in_(passed.limit(limit + 1).offset(offset)))
    else:
        statement = statement.where(*where).limit(limit + 1)
    with translated():
        rows = list(connection.execute(statement).all())
    is_full = len(rows) > limit
    rows = rows[:limit]
    if back:
        rows.reverse()
    places = [tuple(row[1]) for row in rows]
    return Page(
        tuple(row[0] for row in rows),
        matched,
        places[0] if places else None,
        places[-1] if places else None,
        before=is_full if back else cursor is not None or offset > 0,
        after=True if back else is_full,
    )


def read_feature(
    connection: Connection, collection: Collection, placing: Placing, feature_id: str, wanted: Wanted
) -> str:
    """One feature as a GeoJSON text.

    raises  NotFound
    """
    source = source_of(collection)
    parts = feature_id.split("-")
    missing = NotFound("feature", feature_id, f"List /collections/{collection.id}/items to see their ids.")
    if len(parts) != len(source.keys) or not all(each.isdecimal() and len(each) < 20 for each in parts):
        raise missing
    if any(int(each) >= 2**63 for each in parts):
        raise missing
    found = _features(source, placing, wanted, _sort_keys(source, ())).where(
        source.where, *(key == int(part) for key, part in zip(source.keys.values(), parts, strict=True))
    )
    with translated():
        row = connection.execute(found).one_or_none()
    if row is None:
        raise missing
    return str(row[0])


def _matched(connection: Connection, source: Source, where: Sequence[Sql]) -> int:
    key = next(iter(source.keys.values()))
    with translated():
        return int(connection.scalar(select(func.count(key)).select_from(source.rows).where(*where)) or 0)


@dataclass(frozen=True)
class _Key:
    value: Sql
    kind: Any
    descending: bool = False
    nullable: bool = True


def _sort_keys(source: Source, sort: Sequence[SortKey]) -> list[_Key]:
    keys = []
    for each in sort:
        kind = source.thing.kinds[each.property]
        value = source.thing.columns[each.property]
        found = collate(value, "C") if kind == "text" else value
        nullable = each.property not in source.complete
        keys.append(_Key(found, TYPES[kind], each.descending, nullable))
    return [*keys, *(_Key(value, value.type, nullable=False) for value in source.keys.values())]


def _order(keys: Sequence[_Key], back: bool) -> list[Sql]:
    order: list[Sql] = []
    for each in keys:
        if each.nullable:
            order.append(each.value.is_(None).desc() if back else each.value.is_(None))
        order.append(each.value.desc() if each.descending != back else each.value)
    return order


def _beyond(keys: Sequence[_Key], cursor: Cursor) -> Sql:
    """What comes after a place in the order, or before it: the first key that differs decides."""
    if len(cursor.values) != len(keys):
        raise InvalidInput("it is no place in this order", "Follow the links of a page.", "cursor")
    found: list[Sql] = []
    alike: list[Sql] = []
    for key, value in zip(keys, cursor.values, strict=True):
        if value is None:
            further: Sql = key.value.is_not(None) if cursor.back else false()
            same: Sql = key.value.is_(None)
        else:
            here: Sql = cast(literal(str(value), Text), key.kind)
            if key.kind is String:
                here = collate(here, "C")
            rises = key.value > here if key.descending == cursor.back else key.value < here
            further = rises if cursor.back or not key.nullable else or_(rises, key.value.is_(None))
            same = key.value == here
        found.append(and_(*alike, further))
        alike.append(same)
    return found[0] if len(found) == 1 else or_(*found)


def _features(source: Source, placing: Placing, wanted: Wanted, keys: Sequence[_Key]) -> Select[Any]:
    shown = placing.shown(source.shape, wanted.system)
    digits = DIGITS_DEG if wanted.system.degrees else DIGITS_M
    geometry = cast(func.public.st_asgeojson(shown, digits, 0), JSON)
    names = source.properties if wanted.properties is None else wanted.properties
    properties: list[Sql] = []
    for name in names:
        properties += [_word(name), _json(source.thing.columns[name], source.thing.kinds[name])]
    ids = list(source.keys.values())
    identity = ids[0] if len(ids) == 1 else func.concat_ws("-", *ids)
    feature = func.json_build_object(
        _word("type"),
        _word("Feature"),
        _word("id"),
        identity,
        _word("geometry"),
        geometry,
        _word("properties"),
        func.json_build_object(*properties),
    )
    place = func.json_build_array(*(cast(key.value, Text) for key in keys))
    return select(cast(feature, Text), place).select_from(source.rows)


def _word(word: str) -> Sql:
    return cast(literal(word, Text), Text)


def _json(value: Sql, kind: Kind) -> Sql:
    if kind == "instant":
        return func.to_char(func.timezone("UTC", value), RFC3339_SQL)
    return value


def _conditions(connection: Connection, source: Source, placing: Placing, wanted: Wanted) -> list[Sql]:
    found: list[Sql] = [source.where]
    if wanted.boxes:
        shapes = [each.shape() for each in wanted.boxes]
        placed = on_map(connection, placing, shapes, wanted.box_system)
        areas = [each for each in placed if isinstance(each, shapely.Geometry)]
        if "everywhere" not in placed:
            found.append(_near(source, areas))
        found.append(
            or_(
                *(
                    and_(_in_area(source, area), _in_heights(source, placing, box, wanted.box_system))
                    for area, box in zip(placed, wanted.boxes, strict=True)
                )
            )
        )
    if source.start is not None and source.end is not None:
        if wanted.start is not None:
            open_end = cast(literal("infinity", Text), STAMP)
            found.append(or_(source.start.is_(None), func.coalesce(source.end, open_end) >= wanted.start))
        if wanted.end is not None:
            found.append(or_(source.start.is_(None), source.start <= wanted.end))
    if wanted.filter is not None:
        expression = _on_map(connection, placing, wanted.filter, wanted.filter_system)
        found.append(condition(expression, source.thing))
        found += [_near(source, [shape]) for shape in _required(expression)]
    return found


def _in_area(source: Source, area: Placed) -> Sql:
    """Whether something is in an area; what has no place is in none."""
    shape = source.thing.columns[GEOMETRY]
    if isinstance(area, str):
        return shape.is_not(None) if area == "everywhere" else false()
    return func.public.st_intersects(shape, _literal(area))


def _near(source: Source, areas: Sequence[shapely.Geometry]) -> Sql:
    """What the indexes of shapes say of the boxes around areas; true where there is no index."""
    if source.unindexed is None or not areas:
        return true()
    ids = [
        select(abstraction.c.instance_id).where(
            abstraction.c.type == literal_column(f"'{kind}'", Text),
            abstraction.c.instance_id.is_not(None),
            abstraction.c.geometry.op("operator(public.&&)")(_literal(shapely.box(*area.bounds))),
        )
        for kind in ("Footprint", "Position2D")
        for area in areas
    ]
    return next(iter(source.keys.values())).in_(union_all(*ids, source.unindexed))


def _in_heights(source: Source, placing: Placing, box: Box, system: System) -> Sql:
    """Whether heights meet those of a box; what has none is at all of them."""
    if box.heights_m is None:
        return true()
    shift_m = 0.0 if system.epsg is None else placing.pose.z_m
    low, high = (height_m - shift_m for height_m in box.heights_m)
    return or_(source.low.is_(None), and_(source.low <= high, func.coalesce(source.high, source.low) >= low))


def _required(expression: Expression) -> Iterator[shapely.Geometry]:
    """Shapes that everything which meets a filter has to meet."""
    match expression:
        case Call(op="and", args=args):
            for each in args:
                yield from _required(each)
        case Call(op=op, args=(Property(name="geometry" | "footprint"), Shape(geometry=shape))) if (
            op in SPATIAL and op != "s_disjoint"
        ):
            yield shape
        case Call(op=op, args=(Shape(geometry=shape), Property(name="geometry" | "footprint"))) if (
            op in SPATIAL and op != "s_disjoint"
        ):
            yield shape


def _on_map(connection: Connection, placing: Placing, expression: Expression, system: System) -> Expression:
    """The filter with its shapes in the map frame."""
    shapes = list(_shapes(expression))
    if not shapes or system.epsg is None:
        return expression
    placed = on_map(connection, placing, [each.geometry for each in shapes], system)
    moved = iter([_as_shape(each, shape.geometry) for each, shape in zip(placed, shapes, strict=True)])
    return _with_shapes(expression, moved)


def _as_shape(placed: Placed, given: shapely.Geometry) -> shapely.Geometry:
    if isinstance(placed, str):
        return FAR_AWAY if placed == "nowhere" else shapely.box(-1e9, -1e9, 1e9, 1e9)
    return placed


def _shapes(expression: Expression) -> Iterator[Shape]:
    match expression:
        case Shape():
            yield expression
        case Call(args=inner) | Array(items=inner):
            for each in inner:
                yield from _shapes(each)


def _with_shapes(expression: Expression, moved: Iterator[shapely.Geometry]) -> Expression:
    match expression:
        case Shape():
            return replace(expression, geometry=next(moved))
        case Call(args=inner):
            return replace(expression, args=tuple(_with_shapes(each, moved) for each in inner))
        case Array(items=inner):
            return replace(expression, items=tuple(_with_shapes(each, moved) for each in inner))
        case Interval():
            return expression
    return expression


def _literal(shape: shapely.Geometry) -> ColumnElement[Any]:
    return func.public.st_geomfromwkb(bindparam(None, shapely.to_wkb(shape), LargeBinary), type_=None)
