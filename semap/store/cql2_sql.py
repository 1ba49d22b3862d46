"""CQL2 compiled to SQL, for filters and for the conditions of continuous queries.

Operators and columns come from tables; what is said (texts, numbers, times, keys) is a parameter. It means
what `semap.cql2.evaluate` makes of it: what is unknown (a missing attribute, one of another kind, a number
that no float holds) is null, and null as a whole selects nothing. Numbers are compared as double precision,
texts by code points.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import shapely
from sqlalchemy import (
    ColumnElement,
    Double,
    LargeBinary,
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
    literal_column,
    not_,
    null,
    or_,
)
from sqlalchemy.dialects.postgresql import JSONB, array
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
from semap.cql2.check import ARITHMETIC, ARRAYS, COMPARISONS, SPATIAL, TEMPORAL, TEMPORAL_PARTS
from semap.store.tables import STAMP

Sql = ColumnElement[Any]
JSON_TYPES: Mapping[Kind, str] = {
    "text": "string",
    "instant": "string",
    "boolean": "boolean",
    "array": "array",
}

SPATIAL_SQL: Mapping[str, Callable[..., Sql]] = {
    op: getattr(func.public, f"st_{op.removeprefix('s_')}") for op in SPATIAL
}
COMPARISON_SQL: Mapping[str, Callable[[Sql, Sql], ColumnElement[bool]]] = dict(
    zip(
        COMPARISONS,
        (operator.eq, operator.ne, operator.lt, operator.le, operator.gt, operator.ge),
        strict=True,
    )
)


@dataclass(frozen=True)
class Thing:
    """What a filter is asked of.

    kinds    of its properties
    columns  what each is in SQL; one of kind `any` is jsonb
    is_a     whether it is of a concept, or of one below it
    said     what is in SQL for a text that the filter says: a parameter
    """

    kinds: Kinds
    columns: Mapping[str, Sql]
    is_a: Callable[[str], Sql]
    said: Callable[[str], Sql] = literal


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
        """The SQL of a part as jsonb; an instant is the text that `instant_text` makes of it."""
        found = self.sql(part)
        match self.kind(part):
            case "any":
                return found
            case "instant":
                found = func.to_char(func.timezone("UTC", found), 'YYYY-MM-DD"T"HH24:MI:SS.US"Z"')
        return func.to_jsonb(found)

    def said(self, value: str, as_type: type[Any] | Any) -> Sql:
        return cast(self.thing.said(value), as_type)

    def sql(self, part: Expression) -> Sql:
        match part:
            case Property(name=name):
                return self.property(name)
            case Literal(value=bool() as value):
                return literal_column(str(value).lower(), _BOOLEAN)
            case Literal(value=str(value)):
                return self.said(value, Text)
            case Literal(value=int() | float() as value):
                return self.said(repr(float(value)), Double)
            case Instant(stamp=stamp):
                return self.said(stamp.isoformat(), STAMP)
            case Shape(geometry=geometry):
                return func.public.st_geomfromwkb(bindparam(None, shapely.to_wkb(geometry), LargeBinary))
            case Call():
                return self.call(part)
        raise AssertionError(f"{part} has no value of its own")

    def property(self, name: str) -> Sql:
        if name in self.thing.columns:
            return self.thing.columns[name]
        head, *keys = name.split(".")
        found: Sql = self.thing.columns[head].op("#>")(array([self.said(each, Text) for each in keys]))
        return func.nullif(found, literal_column("jsonb 'null'"), type_=JSONB)

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
        by_kind: dict[Kind, list[Expression]] = {}
        for each in items:
            kind = self.kind(inner)
            by_kind.setdefault(self.kind(each) if kind == "any" else kind, []).append(each)
        found = [self.compared("=", inner, each) for each in by_kind.pop("any", ())]
        for kind, alike in by_kind.items():
            # not `in`: the server compares with each of what is no constant, and copies the left side
            listed = array([self.of_kind(each, kind) for each in alike])
            found.append(_comparable(self.of_kind(inner, kind), kind) == any_(listed))
        return or_(false(), *found)

    def pair(self, call: Call) -> Sql:
        """What the operators of two parts are."""
        a, b = call.args
        if call.op in COMPARISONS:
            return self.compared(call.op, a, b)
        if call.op in ARITHMETIC:
            sides = (self.of_kind(each, "number") for each in (a, b))
            return func.semap.real_arithmetic(literal_column(f"'{call.op}'"), *sides, type_=Double)
        if call.op in SPATIAL:
            return SPATIAL_SQL[call.op](self.of_kind(a, "shape"), self.of_kind(b, "shape"))
        if call.op in TEMPORAL:
            return self.temporal(call.op, {"a": self.span(a), "b": self.span(b)})
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

    def temporal(self, op: str, spans: Mapping[str, Mapping[str, Sql]]) -> Sql:
        found = []
        for part in TEMPORAL_PARTS[op]:
            left, comparison, right = part.split()
            sides = (spans[side[0]][side[2:]] for side in (left, right))
            found.append(COMPARISON_SQL[comparison](*sides))
        return (or_ if op == "t_disjoint" else and_)(*found)

    def span(self, part: Expression) -> Mapping[str, Sql]:
        """From a moment to a moment; an instant is both."""
        ends = (part.start, part.end) if isinstance(part, Interval) else (part, part)
        return {
            name: literal_column(f"timestamptz '{beyond}'") if end is None else self.of_kind(end, "instant")
            for name, end, beyond in zip(("start", "end"), ends, ("-infinity", "infinity"), strict=True)
        }


_BOOLEAN = false().type


def _typed(json: Sql, kind: Kind) -> Sql:
    """The value of a kind that a jsonb is; null where it is of another."""
    if kind == "shape":
        return func.public.st_geomfromwkb(null())
    if kind == "number":
        return func.semap.json_number(json, type_=Double)
    plain: Sql = json.op("#>>")(literal_column("'{}'"))
    of_kind = func.jsonb_typeof(json) == literal_column(f"'{JSON_TYPES[kind]}'")
    value = json if kind == "array" else cast(plain, _BOOLEAN if kind == "boolean" else Text)
    found = case((of_kind, value), else_=null())
    return func.semap.instant_of(found, type_=STAMP) if kind == "instant" else found


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
