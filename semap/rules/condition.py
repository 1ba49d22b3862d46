"""Conditions and measures of rules: CQL2 text that may also ask of the rows bound so far.

A property alone is of the row asked about (in a measure: of the last row bound). `A.x` and `last(A.x)` are of
the last row bound to the variable A, `first(A.x)` of the first, `last(A.x, 2)` of the second before the last;
without a variable they are of all rows bound. Aggregates (`count`, `sum`, `array` ...) are of all rows of a
variable, or of all. A alone stands for A.stamp in `first(A)`, `last(A)` and `count(A)`. `prev(x, n)` and
`next(x, n)` are of rows around a row in its key, whatever binds them, `classifier()` is the variable that a
row is bound to, `match_number()` the number of the match, and `seconds_between(a, b)` is b - a.

Read, what asks of variables is one form: a call of a function with the name of the variable and what is asked
of each of its rows (`naming`).
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Sequence
from typing import NoReturn

from semap.cql2 import (
    Call,
    Expression,
    Functions,
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
from semap.rules import binding, scalar
from semap.rules.binding import AGGREGATES
from semap.rules.bound import Asked, Bound, Condition
from semap.rules.matching.neighbours import Neighbour
from semap.rules.naming import FUNCTIONS, OF_BOUND, SHIFTS, Label, Naming, Subsets
from semap.rules.row import PROPERTIES, Value

NAMES: dict[str, object] = {
    "json_at": json_at,
    "seconds_between": binding.seconds_between,
    "EVERY": binding.EVERY,
    "first": binding.first,
    "last": binding.last,
    "first_of": binding.first_of,
    "last_of": binding.last_of,
    "values": binding.values,
    "values_of": binding.values_of,
    "variable_at": binding.variable_at,
    **{f"{name}_of_all": function for name, function in AGGREGATES.items()},
    **{scalar.CODE_NAMES[name]: function for name, function in scalar.CALLED.items()},
}
"""Of functions, as code calls them."""

OF_THE_WHOLE = ("final", "match_number")


def read_condition(
    text: str, place: str, variables: frozenset[str], subsets: Subsets | None = None
) -> Expression:
    """A condition on a row.

    place      how messages call it
    variables  that it may ask of; none before rows are partitioned
    subsets    names for several of them
    raises     InvalidInput with the line and character; without, if it is about all of it
    """
    return _read(text, place, Naming(variables, subsets or {}), _check_condition)


def read_measure(
    text: str, place: str, variables: frozenset[str], subsets: Subsets | None = None
) -> Expression:
    """What is measured of a match: a value of any kind but a shape or an interval.

    raises  InvalidInput as `read_condition`
    """
    return _read(text, place, Naming(variables, subsets or {}), _check_measure)


def compile_condition(expression: Expression) -> Condition:
    """A condition that `read_condition` gave."""
    test = compile_filter(expression, _rows("row", "row, bound=None"))
    return Condition(None if asks_bound(expression) else test, test, reads(expression), _asked(expression))


def compile_measure(expression: Expression) -> Callable[[Bound, Bound, int], Value]:
    """What is measured of rows, the last one first, of the whole match and of its number; it is JSON.

    Instants are RFC 3339 texts.
    """
    measured = compile_expression(expression, _rows("bound.row", "bound, whole, number"))
    kind = kind_of(expression, PROPERTIES, FUNCTIONS)
    if kind == "instant":
        return lambda bound, whole, number: instant_text(measured(bound, whole, number))
    if kind == "number":
        return lambda bound, whole, number: _finite(measured(bound, whole, number))
    if kind == "array":
        each = instant_text if _is_of_instants(expression) else _finite

        def listed(bound: Bound, whole: Bound, number: int) -> Value:
            found = measured(bound, whole, number)
            return None if found is None else [each(value) for value in found]

        return listed
    return measured


def reads(expression: Expression) -> frozenset[str]:
    """The properties of rows that it reads, of whichever row; of attributes.x, attributes."""
    found = {part.name.partition(".")[0] for part in parts(expression) if isinstance(part, Property)}
    if any(isinstance(part, Call) and part.op == "isA" for part in parts(expression)):
        found.add("concept")
    return frozenset(found)


def asks_bound(expression: Expression) -> bool:
    """Whether it asks of more than the row, and what this says of its neighbours."""
    return any(
        isinstance(part, Call) and part.op in (*OF_BOUND, "classifier", "classifier_near")
        for part in parts(expression)
    )


def _asked(expression: Expression) -> frozenset[Asked] | None:
    """Which of the rows bound it asks; None where it may be all."""
    found = set()
    for part in parts(expression):
        match part:
            case Call(
                op="first" | "last" as end,
                args=(Literal(value=Label() as label), Literal(value=int(offset)), Property()),
            ):
                found.add(Asked(end, label.variables, offset))
            case Call(op=op) if op in (*OF_BOUND, "classifier", "classifier_near"):
                return None
    return frozenset(found)


def asks_of_pattern(expression: Expression) -> str:
    """What it asks that only a row pattern can say; empty where it asks nothing such."""
    asked = (part.op for part in parts(expression) if isinstance(part, Call))
    return next((op for op in asked if op in (*SHIFTS, "classifier", *OF_THE_WHOLE)), "")


def counts_matches(expression: Expression) -> bool:
    """Whether it reads the number of a match."""
    return any(isinstance(part, Call) and part.op == "match_number" for part in parts(expression))


def neighbours_in(expression: Expression) -> frozenset[Neighbour]:
    """What it reads of the rows around a row."""
    found = set()
    for part in parts(expression):
        match part:
            case Call(op="prev" | "next" as op, args=(Literal(value=int(offset)), Property(name=name))):
                found.add(Neighbour(op, offset, name.partition(".")[0]))
            case Call(op="classifier_near", args=(Literal(value=int(offset)),)):
                found.add(Neighbour("prev", offset, ""))
    return frozenset(found)


def _read(text: str, place: str, naming: Naming, check_read: Callable[[Expression], None]) -> Expression:
    try:
        expression = naming.named(parse(text, place, FUNCTIONS))
        check_read(expression)
    except InvalidInput as error:
        if not error.where.startswith((f"{place}.", f"{place}[")):
            raise
        message = str(error).removeprefix(f"{error.where}: ")
        raise InvalidInput(message, error.remedy, place_of(text, place, error.where)) from error
    return expression


def _check_condition(expression: Expression) -> None:
    check(expression, PROPERTIES, FUNCTIONS)
    for part in parts(expression):
        if isinstance(part, Call) and part.op in OF_THE_WHOLE:
            _refuse(
                part, f"{part.op} in a condition", "It is known once the match is: ask for it in measures."
            )


def _check_measure(expression: Expression) -> None:
    check_parts(expression, PROPERTIES, FUNCTIONS)
    kind = kind_of(expression, PROPERTIES, FUNCTIONS)
    if kind in ("shape", "interval"):
        _refuse(expression, f"a measure that is a {kind}", "Measure a number, text, time or truth value.")


def _is_of_instants(expression: Expression) -> bool:
    match expression:
        case Call(op="final", args=(inner,)):
            return _is_of_instants(inner)
        case Call(op="array" | "distinct", args=(_, inner)):
            return kind_of(inner, PROPERTIES, FUNCTIONS) == "instant"
    return False


def _rows(row: str, parameters: str) -> Subject:
    """Rows as what is asked of; `row` is code of the one whose properties stand alone."""
    functions: Functions = FUNCTIONS
    return Subject(
        kinds=PROPERTIES,
        parameters=parameters,
        property_of=lambda name: code(f"{row}.values.get(NAME)", NAME=ast.Constant(name)),
        is_a=lambda concept: code(f"CONCEPT in {row}.concepts", CONCEPT=ast.Constant(concept)),
        functions=functions,
        function_of=lambda call, args: _function(row, call, args),
        names=NAMES,
    )


def _function(row: str, call: Call, args: Sequence[Code]) -> Code:
    """By `bound`, the rows bound so far, and what a row says of its neighbours."""
    match call:
        case Call(op="prev" | "next" as op, args=(Literal(value=int(offset)), Property(name=name))):
            head, *keys = name.split(".")
            column = ast.Constant(Neighbour(op, offset, head).column)
            return _at(code(f"{row}.values.get(NAME)", NAME=column), keys)
        case Call(
            op="first" | "last" as op, args=(Literal(value=Label() as label), Literal(value=int(n)), asked)
        ):
            variables = {"VARIABLES": _variables(label)}
            if isinstance(asked, Property) and n == 0:
                head, *keys = asked.name.split(".")
                return _at(code(f"{op}(bound, VARIABLES, NAME)", NAME=ast.Constant(head), **variables), keys)
            value = code("lambda bound, row: VALUE", VALUE=args[2])
            return code(f"{op}_of(bound, VARIABLES, OFFSET, VALUE)", OFFSET=args[1], VALUE=value, **variables)
        case Call(op=op, args=(Literal(value=Label() as label), asked)) if op in AGGREGATES:
            variables = {"VARIABLES": _variables(label)}
            if isinstance(asked, Property):
                head, *keys = asked.name.split(".")
                asked_of = {"NAME": ast.Constant(head), "KEYS": _keys(keys)}
                found = code("values(bound, VARIABLES, NAME, KEYS)", **asked_of, **variables)
            else:
                value = code("lambda bound, row: VALUE", VALUE=args[1])
                found = code("values_of(bound, VARIABLES, VALUE)", VALUE=value, **variables)
            return code(f"{op}_of_all(FOUND)", FOUND=found)
        case Call(op="classifier"):
            return code("None if bound is None else (str(bound.variable) or None)")
        case Call(op="classifier_near", args=(Literal(value=int(offset)),)):
            column = ast.Constant(Neighbour("prev", offset, "").column)
            return code(f"variable_at(bound, {row}.values.get(NAME))", NAME=column)
        case Call(op="match_number"):
            return code("number")
        case Call(op="final"):
            return code("(lambda bound: VALUE)(whole)", VALUE=args[0])
        case Call(op=op) if op in scalar.CALLED:
            return ast.Call(ast.Name(scalar.CODE_NAMES[op], ast.Load()), list(args), [])
    start, end = args
    return code("seconds_between(START, END)", START=start, END=end)


def _variables(label: Label) -> Code:
    if label.variables is None:
        return code("EVERY")
    # a tuple of one is looked through faster than a set is asked
    return ast.Tuple([ast.Constant(name) for name in sorted(label.variables)], ast.Load())


def _at(found: Code, keys: Sequence[str]) -> Code:
    return code("json_at(VALUE, KEYS)", VALUE=found, KEYS=_keys(keys)) if keys else found


def _keys(keys: Sequence[str]) -> Code:
    return ast.Tuple([ast.Constant(key) for key in keys], ast.Load())


def _finite(value: Value) -> Value:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _refuse(part: Expression, message: str, remedy: str) -> NoReturn:
    raise InvalidInput(message, remedy, part.place)
