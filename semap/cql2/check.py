"""What kinds of values the parts of a filter have, and whether they fit together.

`any` is a value whose kind only the thing itself tells, such as an attribute in JSON. Where another kind is
wanted of it, a value of any other kind counts as missing, and what is asked of a missing value is unknown:
neither true nor false, as null in SQL.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal as Only
from typing import NoReturn

from semap.cql2.expression import Array, Call, Expression, Instant, Interval, Literal, Property, Shape
from semap.errors import InvalidInput

Kind = Only["boolean", "number", "text", "instant", "interval", "shape", "array", "any", "null"]
Kinds = Mapping[str, Kind]
"""The kind of each property; one of kind `any` has properties of its own, such as attributes.seats."""


@dataclass(frozen=True)
class Function:
    """A function that is asked for beside CQL2's own.

    takes  of each part, the kinds that it may be of
    gives  its kind; None is that of its last part
    """

    takes: tuple[tuple[Kind, ...], ...]
    gives: Kind | None = None


Functions = Mapping[str, Function]
"""By name."""

NO_FUNCTIONS: Functions = {}

LOGIC = ("and", "or", "not")
COMPARISONS = ("=", "<>", "<", "<=", ">", ">=")
ARITHMETIC = ("+", "-", "*", "/", "^", "%", "div")
SPATIAL = (
    "s_intersects",
    "s_equals",
    "s_disjoint",
    "s_touches",
    "s_within",
    "s_overlaps",
    "s_crosses",
    "s_contains",
)
TEMPORAL_PARTS: Mapping[str, tuple[str, ...]] = {
    "t_after": ("a.start > b.end",),
    "t_before": ("a.end < b.start",),
    "t_contains": ("a.start < b.start", "a.end > b.end"),
    "t_disjoint": ("a.start > b.end", "a.end < b.start"),
    "t_during": ("a.start > b.start", "a.end < b.end"),
    "t_equals": ("a.start = b.start", "a.end = b.end"),
    "t_finishedBy": ("a.start < b.start", "a.end = b.end"),
    "t_finishes": ("a.start > b.start", "a.end = b.end"),
    "t_intersects": ("a.start <= b.end", "a.end >= b.start"),
    "t_meets": ("a.end = b.start",),
    "t_metBy": ("a.start = b.end",),
    "t_overlappedBy": ("a.start > b.start", "a.start < b.end", "a.end > b.end"),
    "t_overlaps": ("a.start < b.start", "a.end > b.start", "a.end < b.end"),
    "t_startedBy": ("a.start = b.start", "a.end > b.end"),
    "t_starts": ("a.start = b.start", "a.end < b.end"),
}
"""What of two intervals holds together; of t_disjoint, either."""
TEMPORAL = tuple(TEMPORAL_PARTS)
ARRAYS = ("a_contains", "a_containedBy", "a_equals", "a_overlaps")
OPERATORS = (
    *LOGIC,
    *COMPARISONS,
    "like",
    "between",
    "in",
    "isNull",
    "casei",
    "accenti",
    *ARITHMETIC,
    *SPATIAL,
    *TEMPORAL,
    *ARRAYS,
    "isA",
)

ORDERED = ("number", "text", "instant")
COUNTS = {"not": 1, "isNull": 1, "casei": 1, "accenti": 1, "isA": 1, "between": 3}
WANTED: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(LOGIC, ("boolean",)),
    **dict.fromkeys(ARITHMETIC, ("number",)),
    **dict.fromkeys(SPATIAL, ("shape",)),
    **dict.fromkeys(TEMPORAL, ("instant", "interval")),
    **dict.fromkeys(ARRAYS, ("array",)),
    **dict.fromkeys(("like", "casei", "accenti"), ("text",)),
}


def check(expression: Expression, kinds: Kinds, functions: Functions = NO_FUNCTIONS) -> None:
    """raises InvalidInput unless the expression is a filter: everything in it is known and fits together"""
    if kind_of(expression, kinds, functions) not in ("boolean", "any"):
        _refuse(expression, "it is neither true nor false", "Compare it with something.")
    check_parts(expression, kinds, functions)


def kind_of(expression: Expression, kinds: Kinds, functions: Functions = NO_FUNCTIONS) -> Kind:
    """The kind of a part.

    raises  InvalidInput for an unknown property
    """
    match expression:
        case Property(name=name):
            kind = kinds.get(name)
            head, _, key = name.partition(".")
            if kind is None and key and kinds.get(head) == "any":
                return "any"
            if kind is None:
                _refuse(expression, f"there is no property {name}", _near(name, kinds))
            return kind
        case Literal(value=value):
            return _literal_kind(value)
        case Instant():
            return "instant"
        case Interval():
            return "interval"
        case Shape():
            return "shape"
        case Array():
            return "array"
        case Call(op=op, args=args):
            if op in functions:
                return functions[op].gives or (kind_of(args[-1], kinds, functions) if args else "null")
            if op in ARITHMETIC:
                return "number"
            return "text" if op in ("casei", "accenti") else "boolean"


def _literal_kind(value: object) -> Kind:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "boolean"
    return "text" if isinstance(value, str) else "number"


def check_parts(expression: Expression, kinds: Kinds, functions: Functions = NO_FUNCTIONS) -> None:
    """raises InvalidInput unless all in the expression, of whatever kind it is, is known and fits together"""
    match expression:
        case Call(op=op, args=args):
            least = len(functions[op].takes) if op in functions else COUNTS.get(op, 2)
            if len(args) < least or (len(args) > least and op not in ("and", "or")):
                _refuse(expression, f"{op} of {len(args)} parts", f"Give it {least}.")
            for each in args:
                check_parts(each, kinds, functions)
            found = [kind_of(each, kinds, functions) for each in args]
            _check_taken(expression, found, functions)
            _check_kinds(expression, found, kinds, functions)
        case Array(items=items):
            for each in items:
                check_parts(each, kinds, functions)
                if kind_of(each, kinds, functions) in ("array", "shape", "interval", "null"):
                    _refuse(
                        each,
                        "a list of other things than texts, numbers, times or truth values",
                        "Leave it out.",
                    )
        case Interval(start=start, end=end):
            for side in (start, end):
                if side is None:
                    continue
                check_parts(side, kinds, functions)
                if kind_of(side, kinds, functions) not in ("instant", "any"):
                    _refuse(side, "an end of an interval that is no time", "Give a time, or '..'.")
            if isinstance(start, Instant) and isinstance(end, Instant) and start.stamp > end.stamp:
                _refuse(expression, "an interval that ends before it begins", "Give the earlier time first.")
        case Property():
            kind_of(expression, kinds, functions)


def _check_taken(call: Call, found: list[Kind], functions: Functions) -> None:
    wanted: tuple[tuple[str, ...] | None, ...] = (WANTED.get(call.op),) * len(found)
    if call.op in functions:
        wanted = functions[call.op].takes
    for each, kind, allowed in zip(call.args, found, wanted, strict=True):
        if allowed is not None and kind != "any" and kind not in allowed:
            _refuse(each, f"{call.op} of a {kind}", f"Give it a {' or '.join(allowed)}.")


def _check_collections(call: Call) -> None:
    """raises InvalidInput where PostGIS does not relate a collection of points, lines and areas"""
    for each in call.args:
        if isinstance(each, Shape) and each.geometry.geom_type == "GeometryCollection":
            _refuse(
                each,
                f"{call.op} of a collection of points, lines and areas together",
                "Ask it of each of its shapes, or ask S_INTERSECTS or S_DISJOINT.",
            )


def _check_kinds(call: Call, found: list[Kind], kinds: Kinds, functions: Functions) -> None:
    if call.op in COMPARISONS:
        _check_alike(call, found, ORDERED if call.op not in ("=", "<>") else (*ORDERED, "boolean"))
    elif call.op in SPATIAL and call.op not in ("s_intersects", "s_disjoint"):
        _check_collections(call)
    elif call.op == "between":
        _check_alike(call, found, ORDERED)
    elif call.op == "like":
        _check_pattern(call.args[1])
    elif call.op == "in":
        listed = call.args[1]
        if not isinstance(listed, Array):
            _refuse(listed, "in of something that is no list", "Give a list: name in ('a', 'b').")
        for each in listed.items:
            alike = Call("in", (call.args[0], each), each.place)
            _check_alike(alike, [found[0], kind_of(each, kinds, functions)], (*ORDERED, "boolean"))
    elif call.op == "isA":
        of = call.args[0]
        if not isinstance(of, Literal) or not isinstance(of.value, str):
            _refuse(of, "isA of something that is no name", "Name a concept: isA('Room').")
    elif call.op == "isNull" and found[0] in ("null", "array", "interval"):
        _refuse(call, f"isNull of a {found[0]}", "Ask it of a property.")


def _check_alike(call: Call, found: list[Kind], allowed: tuple[str, ...]) -> None:
    if "null" in found:
        _refuse(call, "a comparison with null is never true", "Write: alias IS NULL (op isNull).")
    known = {kind for kind in found if kind != "any"}
    if len(known) > 1:
        hint = (
            "Write times as TIMESTAMP('2026-01-31T12:00:00Z')."
            if "instant" in known
            else "Compare like with like."
        )
        _refuse(call, f"{call.op} of a {' and a '.join(sorted(known))}", hint)
    if not known <= set(allowed):
        _refuse(call, f"{call.op} of a {known.pop()}", f"Use it for {', '.join(allowed)}.")


def _check_pattern(pattern: Expression) -> None:
    while isinstance(pattern, Call) and pattern.op in ("casei", "accenti") and len(pattern.args) == 1:
        pattern = pattern.args[0]
    if not isinstance(pattern, Literal) or not isinstance(pattern.value, str):
        _refuse(
            pattern,
            "like of something that is no pattern",
            "Give a text; % stands for any, _ for one character.",
        )
    if (len(pattern.value) - len(pattern.value.rstrip("\\"))) % 2:
        _refuse(pattern, "a pattern that ends with \\", "Write \\\\ for a backslash.")


def _near(name: str, kinds: Kinds) -> str:
    near = difflib.get_close_matches(name, kinds, n=1)
    known = [f"{each}.<key>" if kind == "any" else each for each, kind in kinds.items()]
    return (f"Did you mean {near[0]}? " if near else "") + f"There are {', '.join(known)}."


def _refuse(part: Expression, message: str, remedy: str) -> NoReturn:
    raise InvalidInput(message, remedy, part.place)
