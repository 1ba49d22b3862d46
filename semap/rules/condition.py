"""Conditions and measures of rules: CQL2 text that may also ask of the rows bound so far.

A property alone is of the row asked about (in a measure: of the last row bound). `A.x` and `last(A.x)` are of
the last row bound to the variable A, `first(A.x)` of the first; `count`, `sum`, `avg`, `min` and `max` are of
all. A alone stands for A.stamp in `first(A)`, `last(A)` and `count(A)`. `prev(x)` is of the row before in the
key, and `seconds_between(a, b)` is b - a.

Read, each of these is one form: a call of a function with the name of the variable and the property.
"""

from __future__ import annotations

import ast
import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NoReturn

from semap.cql2 import (
    Array,
    Call,
    Expression,
    Function,
    Functions,
    Instant,
    Interval,
    Kind,
    Kinds,
    Literal,
    Property,
    check,
    check_parts,
    kind_of,
    parse,
    parts,
)
from semap.cql2.evaluate import Subject, compile_expression, compile_filter
from semap.cql2.logic import Code, code
from semap.cql2.text import place_of
from semap.cql2.value import instant_text, json_at
from semap.errors import InvalidInput
from semap.rules.binding import AGGREGATES, NAVIGATION, seconds_between
from semap.rules.bound import Bound, Condition
from semap.rules.row import PROPERTIES, Value

VARIABLE: tuple[Kind, ...] = ("text",)
ANY_KIND: tuple[Kind, ...] = ("boolean", "number", "text", "instant", "shape", "array", "any")
FUNCTIONS: Functions = {
    **dict.fromkeys(NAVIGATION, Function((VARIABLE, ANY_KIND))),
    "count": Function((VARIABLE, ANY_KIND), "number"),
    **dict.fromkeys(("sum", "avg"), Function((VARIABLE, ("number",)), "number")),
    **dict.fromkeys(("min", "max"), Function((VARIABLE, ("number", "text", "instant")))),
    "prev": Function((ANY_KIND,)),
    "seconds_between": Function((("instant",), ("instant",)), "number"),
}
OF_BOUND = (*NAVIGATION, *AGGREGATES)
NAMES: Mapping[str, object] = {
    "json_at": json_at,
    "seconds_between": seconds_between,
    **NAVIGATION,
    **{f"{name}_of": function for name, function in AGGREGATES.items()},
}
"""Of functions, as code calls them."""

OF_STAMP = ("first", "last", "count")
"""Those that may be given a variable alone."""


def read_condition(text: str, place: str, variables: frozenset[str]) -> Expression:
    """A condition on a row.

    place      how messages call it
    variables  that it may ask of; none before rows are partitioned
    raises     InvalidInput with the line and character; without, if it is about all of it
    """
    return _read(text, place, variables, _check_condition)


def read_measure(text: str, place: str, variables: frozenset[str]) -> Expression:
    """What is measured of a match: a value of any kind but a shape or an interval.

    raises  InvalidInput as `read_condition`
    """
    return _read(text, place, variables, _check_measure)


def compile_condition(expression: Expression) -> Condition:
    """A condition that `read_condition` gave."""
    test = compile_filter(expression, _rows("row", "row, bound=None, before=None"))
    asked = {part.op for part in parts(expression) if isinstance(part, Call)}
    by_row_alone = asked.isdisjoint((*OF_BOUND, "prev"))
    return Condition(test if by_row_alone else None, test, reads(expression), "prev" in asked)


def compile_measure(expression: Expression) -> Callable[[Bound], Value]:
    """What the rows of a match, the last one first, give; it is JSON, instants being RFC 3339 texts."""
    measured = compile_expression(expression, _rows("bound.row", "bound"))
    match kind_of(expression, PROPERTIES, FUNCTIONS):
        case "instant":
            return lambda bound: instant_text(measured(bound))
        case "number":
            return lambda bound: _finite(measured(bound))
        case "array":
            return lambda bound: None if (found := measured(bound)) is None else list(found)
    return measured


def reads(expression: Expression) -> frozenset[str]:
    """The properties of rows that it reads, of whichever row; of attributes.x, attributes."""
    found = {part.name.partition(".")[0] for part in parts(expression) if isinstance(part, Property)}
    if any(isinstance(part, Call) and part.op == "isA" for part in parts(expression)):
        found.add("concept")
    return frozenset(found)


def _read(
    text: str, place: str, variables: frozenset[str], check_read: Callable[[Expression], None]
) -> Expression:
    try:
        expression = _Naming(variables).named(parse(text, place, FUNCTIONS))
        check_read(expression)
    except InvalidInput as error:
        if not error.where.startswith((f"{place}.", f"{place}[")):
            raise
        message = str(error).removeprefix(f"{error.where}: ")
        raise InvalidInput(message, error.remedy, place_of(text, place, error.where)) from error
    return expression


def _check_condition(expression: Expression) -> None:
    check(expression, PROPERTIES, FUNCTIONS)


def _check_measure(expression: Expression) -> None:
    check_parts(expression, PROPERTIES, FUNCTIONS)
    kind = kind_of(expression, PROPERTIES, FUNCTIONS)
    if kind in ("shape", "interval"):
        _refuse(expression, f"a measure that is a {kind}", "Measure a number, text, time or truth value.")
    for part in parts(expression):
        if isinstance(part, Call) and part.op == "prev":
            _refuse(part, "prev in a measure", "Ask for it in a condition, or bind that row to a variable.")


class _Naming:
    """Makes one form of what asks of variables."""

    def __init__(self, variables: frozenset[str]) -> None:
        self.variables = variables

    def named(self, part: Expression) -> Expression:
        match part:
            case Property():
                return self.property(part)
            case Call(op=op, args=(Property() as asked,)) if op in OF_BOUND:
                return self.of_bound(op, asked, part.place)
            case Call(op=op) if op in OF_BOUND:
                _refuse(part, f"{op} of something else than a variable", f"Write {op}(A.stamp).")
            case Call(op="prev", args=args):
                if len(args) != 1 or not isinstance(args[0], Property) or self.variable(args[0]):
                    _refuse(part, "prev of something else than a property", "Write prev(type).")
            case Call(op=op, args=args):
                return Call(op, tuple(self.named(each) for each in args), part.place)
            case Array(items=items):
                return Array(tuple(self.named(each) for each in items), part.place)
            case Interval(start=start, end=end):
                return Interval(self.end(start), self.end(end), part.place)
        return part

    def end(self, part: Instant | Property | Call | None) -> Instant | Property | Call | None:
        found = None if part is None else self.named(part)
        return found if isinstance(found, Instant | Property | Call) else None

    def variable(self, asked: Property) -> str:
        """The variable that is asked of; empty where it is the row."""
        head, _, rest = asked.name.partition(".")
        return head if head in self.variables and (rest or asked.name not in PROPERTIES) else ""

    def property(self, asked: Property) -> Expression:
        head, _, rest = asked.name.partition(".")
        if self.variable(asked):
            if not rest:
                _refuse(asked, f"{head} is a variable", f"Ask of its rows: {head}.stamp, count({head}).")
            return self.of_bound("last", asked, asked.place)
        if head not in PROPERTIES:
            what = "neither a property nor a variable" if rest else "no property"
            _refuse(asked, f"there is {what} {head}", self.hint(head, PROPERTIES))
        return asked

    def of_bound(self, op: str, asked: Property, place: str) -> Expression:
        head, _, rest = asked.name.partition(".")
        if head not in self.variables:
            _refuse(asked, f"there is no variable {head}", self.hint(head, {}))
        if not rest and op not in OF_STAMP:
            _refuse(asked, f"{op} of no property", f"Name one: {op}({head}.duration_s).")
        return Call(op, (Literal(head, asked.place), Property(rest or "stamp", asked.place)), place)

    def hint(self, name: str, kinds: Kinds) -> str:
        """What may have been meant, and what there is."""
        known = [*sorted(self.variables), *kinds]
        near = difflib.get_close_matches(name, known, n=1)
        meant = f"Did you mean {near[0]}? " if near else ""
        variables = ", ".join(sorted(self.variables)) or "none"
        properties = f"; the properties are {', '.join(kinds)}" if kinds else ""
        return f"{meant}The variables are {variables}{properties}."


def _rows(row: str, parameters: str) -> Subject:
    """Rows as what is asked of; `row` is code of the one whose properties stand alone."""
    return Subject(
        kinds=PROPERTIES,
        parameters=parameters,
        property_of=lambda name: code(f"{row}.values.get(NAME)", NAME=ast.Constant(name)),
        is_a=lambda concept: code(f"CONCEPT in {row}.concepts", CONCEPT=ast.Constant(concept)),
        functions=FUNCTIONS,
        function_of=_function,
        names=NAMES,
    )


def _function(call: Call, args: Sequence[Code]) -> Code:
    """By `bound`, the rows bound so far, and `before`, the row before in the key."""
    match call:
        case Call(op="prev", args=(Property(name=name),)):
            head, *keys = name.split(".")
            found = code("None if before is None else before.values.get(NAME)", NAME=ast.Constant(head))
            return _at(found, keys)
        case Call(op=op, args=(Literal(value=str(variable)), Property(name=name))):
            head, *keys = name.split(".")
            asked = {"VARIABLE": ast.Constant(variable), "NAME": ast.Constant(head)}
            if op in NAVIGATION:
                return _at(code(f"{op}(bound, VARIABLE, NAME)", **asked), keys)
            return code(f"{op}_of(bound, VARIABLE, NAME, KEYS)", **asked, KEYS=_keys(keys))
    start, end = args
    return code("seconds_between(START, END)", START=start, END=end)


def _at(found: Code, keys: Sequence[str]) -> Code:
    return code("json_at(VALUE, KEYS)", VALUE=found, KEYS=_keys(keys)) if keys else found


def _keys(keys: Sequence[str]) -> Code:
    return ast.Tuple([ast.Constant(key) for key in keys], ast.Load())


def _finite(value: Value) -> Value:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _refuse(part: Expression, message: str, remedy: str) -> NoReturn:
    raise InvalidInput(message, remedy, part.place)
