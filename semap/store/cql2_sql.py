"""A filter in CQL2 as a condition in SQL: values are parameters, operators and columns come from tables.

What is unknown (a missing attribute, one of another kind) is null, and null as a whole selects nothing.
Numbers are compared as double precision, texts by code points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import shapely
from sqlalchemy import (
    ColumnElement,
    Double,
    LargeBinary,
    Numeric,
    Text,
    and_,
    any_,
    bindparam,
    case,
    cast,
    collate,
    false,
    func,
    literal,
    not_,
    null,
    or_,
)
from sqlalchemy.dialects.postgresql import ARRAY, JSONB, array
from sqlalchemy.sql.elements import Grouping

from semap.cql2 import (
    Array,
    Call,
    Expression,
    Instant,
    Interval,
    Kind,
    Kinds,
    Literal,
    Property,
    Shape,
    kind_of,
)
from semap.cql2.check import ARITHMETIC, ARRAYS, COMPARISONS, SPATIAL, TEMPORAL
from semap.store.tables import STAMP

Sql = ColumnElement[Any]
JSON_TYPES: Mapping[Kind, str] = {
    "number": "number",
    "text": "string",
    "boolean": "boolean",
    "array": "array",
}

SPATIAL_SQL: Mapping[str, Callable[..., Sql]] = {
    "s_intersects": func.public.st_intersects,
    "s_equals": func.public.st_equals,
    "s_disjoint": func.public.st_disjoint,
    "s_touches": func.public.st_touches,
    "s_within": func.public.st_within,
    "s_overlaps": func.public.st_overlaps,
    "s_crosses": func.public.st_crosses,
    "s_contains": func.public.st_contains,
}
COMPARISON_SQL: Mapping[str, Callable[[Sql, Sql], ColumnElement[bool]]] = {
    "=": lambda a, b: a == b,
    "<>": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}
ARITHMETIC_SQL: Mapping[str, Callable[[Sql, Sql], Sql]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / func.nullif(b, 0),
    "div": lambda a, b: func.trunc(a / func.nullif(b, 0)),
    # functions, since what would name a part twice doubles with each level
    "%": lambda a, b: func.semap.remainder(a, b, type_=Double),
    "^": lambda a, b: func.semap.real_power(a, b, type_=Double),
}


@dataclass(frozen=True)
class Span:
    """From a moment to a moment; an instant is both."""

    start: Sql
    end: Sql


TEMPORAL_SQL: Mapping[str, Callable[[Span, Span], Sql]] = {
    "t_after": lambda a, b: a.start > b.end,
    "t_before": lambda a, b: a.end < b.start,
    "t_contains": lambda a, b: and_(a.start < b.start, a.end > b.end),
    "t_disjoint": lambda a, b: or_(a.start > b.end, a.end < b.start),
    "t_during": lambda a, b: and_(a.start > b.start, a.end < b.end),
    "t_equals": lambda a, b: and_(a.start == b.start, a.end == b.end),
    "t_finishedBy": lambda a, b: and_(a.start < b.start, a.end == b.end),
    "t_finishes": lambda a, b: and_(a.start > b.start, a.end == b.end),
    "t_intersects": lambda a, b: and_(a.start <= b.end, a.end >= b.start),
    "t_meets": lambda a, b: a.end == b.start,
    "t_metBy": lambda a, b: a.start == b.end,
    "t_overlappedBy": lambda a, b: and_(a.start > b.start, a.start < b.end, a.end > b.end),
    "t_overlaps": lambda a, b: and_(a.start < b.start, a.end > b.start, a.end < b.end),
    "t_startedBy": lambda a, b: and_(a.start == b.start, a.end > b.end),
    "t_starts": lambda a, b: and_(a.start == b.start, a.end < b.end),
}


@dataclass(frozen=True)
class Thing:
    """What a filter is asked of.

    kinds    of its properties
    columns  what each is in SQL; one of kind `any` is jsonb
    is_a     whether it is of a concept, or of one below it
    """

    kinds: Kinds
    columns: Mapping[str, Sql]
    is_a: Callable[[str], Sql]


def condition(expression: Expression, thing: Thing) -> ColumnElement[bool]:
    """The condition that a filter is; `expression` is checked."""
    return _Translation(thing).of_kind(expression, "boolean")


class _Translation:
    def __init__(self, thing: Thing) -> None:
        self.thing = thing

    def kind(self, part: Expression) -> Kind:
        return kind_of(part, self.thing.kinds)

    def of_kind(self, part: Expression, kind: Kind) -> Sql:
        """The SQL of a part as a value of a kind; null where it is of another."""
        if kind == "array" and isinstance(part, Array):
            return func.jsonb_build_array(*(self.json(each) for each in part.items))
        found = self.sql(part)
        return _typed(found, kind) if self.kind(part) == "any" and kind != "any" else found

    def json(self, part: Expression) -> Sql:
        """The SQL of a part as jsonb."""
        match part:
            case Literal(value=bool() as value):
                return func.to_jsonb(cast(literal(value), _BOOLEAN))
            case Literal(value=str(value)):
                return func.to_jsonb(cast(literal(value), Text))
            case Instant(stamp=stamp):
                return func.to_jsonb(cast(literal(stamp.isoformat()), Text))
        if self.kind(part) == "number":
            return func.to_jsonb(self.sql(part))
        return self.sql(part) if self.kind(part) == "any" else func.to_jsonb(self.sql(part))

    def sql(self, part: Expression) -> Sql:
        match part:
            case Property(name=name):
                return self.property(name)
            case Literal(value=bool() as value):
                return literal(value, _BOOLEAN)
            case Literal(value=str(value)):
                return cast(literal(value), Text)
            case Literal(value=value):
                return cast(literal(value), Double)
            case Instant(stamp=stamp):
                return cast(literal(stamp), STAMP)
            case Shape(geometry=geometry):
                return func.public.st_geomfromwkb(bindparam(None, shapely.to_wkb(geometry), LargeBinary))
            case Call():
                return self.call(part)
        raise AssertionError(f"{part} has no value of its own")

    def property(self, name: str) -> Sql:
        if name in self.thing.columns:
            return self.thing.columns[name]
        head, *keys = name.split(".")
        found: Sql = self.thing.columns[head].op("#>")(cast(literal(keys, ARRAY(Text)), ARRAY(Text)))
        return func.nullif(found, cast(literal("null", Text), JSONB), type_=JSONB)

    def call(self, call: Call) -> Sql:
        match call:
            case Call(op="and"):
                return and_(*(self.of_kind(each, "boolean") for each in call.args))
            case Call(op="or"):
                return or_(*(self.of_kind(each, "boolean") for each in call.args))
            case Call(op="not", args=(inner,)):
                # in parentheses, since NOT binds looser than what may be asked of it
                return Grouping(not_(self.of_kind(inner, "boolean")))
            case Call(op="isNull", args=(inner,)):
                return self.sql(inner).is_(None)
            case Call(op="isA", args=(Literal(value=str(concept)),)):
                return self.thing.is_a(concept)
            case Call(op="casei", args=(inner,)):
                return func.semap.lower_case(self.of_kind(inner, "text"), type_=Text)
            case Call(op="accenti", args=(inner,)):
                return func.semap.without_accents(self.of_kind(inner, "text"), type_=Text)
            case Call(op="like", args=(inner, pattern)):
                return self.of_kind(inner, "text").like(self.of_kind(pattern, "text"))
            case Call(op="between", args=(inner, low, high)):
                return and_(self.compared(">=", inner, low), self.compared("<=", inner, high))
            case Call(op="in", args=(inner, Array(items=items))):
                return self.listed(inner, items)
        return self.pair(call)

    def listed(self, inner: Expression, items: Sequence[Expression]) -> Sql:
        kind = self.kind(inner)
        if kind == "any" or not items:
            return or_(false(), *(self.compared("=", inner, each) for each in items))
        # not `in`: the server makes a comparison with each of what is no constant, and copies the left side
        listed = array([self.of_kind(each, kind) for each in items])
        return _comparable(self.sql(inner), kind) == any_(listed)

    def pair(self, call: Call) -> Sql:
        """What the operators of two parts are."""
        a, b = call.args
        if call.op in COMPARISONS:
            return self.compared(call.op, a, b)
        if call.op in ARITHMETIC:
            return ARITHMETIC_SQL[call.op](self.of_kind(a, "number"), self.of_kind(b, "number"))
        if call.op in SPATIAL:
            return SPATIAL_SQL[call.op](self.of_kind(a, "shape"), self.of_kind(b, "shape"))
        if call.op in TEMPORAL:
            return TEMPORAL_SQL[call.op](self.span(a), self.span(b))
        assert call.op in ARRAYS, call.op  # noqa: S101  (checked)
        return _array_call(call.op, self.of_kind(a, "array"), self.of_kind(b, "array"))

    def compared(self, op: str, a: Expression, b: Expression) -> Sql:
        compare = COMPARISON_SQL[op]
        known = [kind for kind in (self.kind(a), self.kind(b)) if kind != "any"]
        if known:
            return compare(*(_comparable(self.of_kind(each, known[0]), known[0]) for each in (a, b)))
        left, right = self.sql(a), self.sql(b)
        alike = func.jsonb_typeof(left) == func.jsonb_typeof(right)
        if op in ("=", "<>"):
            return case((alike, compare(left, right)), else_=null())
        kinds: tuple[Kind, ...] = ("number", "text")
        return func.coalesce(
            *(compare(*(_comparable(_typed(each, kind), kind) for each in (left, right))) for kind in kinds)
        )

    def span(self, part: Expression) -> Span:
        if isinstance(part, Interval):
            return Span(self._end(part.start, "-infinity"), self._end(part.end, "infinity"))
        at = self.of_kind(part, "instant")
        return Span(at, at)

    def _end(self, end: Expression | None, otherwise: str) -> Sql:
        return cast(literal(otherwise, Text), STAMP) if end is None else self.of_kind(end, "instant")


LARGEST_FLOAT = Decimal("1.7e308")
_BOOLEAN = false().type


def _typed(json: Sql, kind: Kind) -> Sql:
    """The value of a kind that a jsonb is; null where it is of another."""
    plain: Sql = json.op("#>>")(cast(literal([], ARRAY(Text)), ARRAY(Text)))
    if kind == "instant":
        return func.semap.instant_of(
            case((func.jsonb_typeof(json) == "string", plain), else_=null()), type_=STAMP
        )
    if kind == "shape":
        return func.public.st_geomfromwkb(null())
    value: Sql = plain
    if kind == "number":
        # jsonb keeps numbers that no float holds; a case keeps the cast from being tried on them
        is_float = func.abs(cast(plain, Numeric)) <= LARGEST_FLOAT
        value = case(
            (case((func.jsonb_typeof(json) == "number", is_float), else_=false()), cast(plain, Double))
        )
    elif kind == "boolean":
        value = cast(plain, _BOOLEAN)
    elif kind == "array":
        value = json
    else:
        value = cast(plain, Text)
    return case((func.jsonb_typeof(json) == JSON_TYPES[kind], value), else_=null())


def _comparable(value: Sql, kind: Kind) -> Sql:
    return collate(value, "C") if kind == "text" else value


def _array_call(op: str, a: Sql, b: Sql) -> Sql:
    """Arrays as sets; items that are arrays themselves count by what they contain."""
    match op:
        case "a_contains":
            return a.op("@>", is_comparison=True)(b)
        case "a_containedBy":
            return b.op("@>", is_comparison=True)(a)
        case "a_equals":
            return func.semap.has_same_items(a, b)
    return func.semap.shares_items(a, b)
