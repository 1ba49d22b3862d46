"""Conditions written as text, as they are, or with what their parts come to for a row."""

from __future__ import annotations

from collections.abc import Callable

from semap.cql2 import Array, Call, Expression, Instant, Interval, Literal, Property, Shape
from semap.rules.condition import OF_BOUND

INFIX = frozenset({"=", "<>", "<", "<=", ">", ">=", "+", "-", "*", "/", "%", "div", "^", "like"})
LOGIC = ("and", "or", "not")

Writer = Callable[[Expression], str]


def write(expression: Expression) -> str:
    """The expression as CQL2 text; the parts of an operator stand in parentheses if they are operators."""
    match expression:
        case Literal(value=value):
            return write_value(value)
        case Property(name=name):
            return name
        case Instant(stamp=stamp):
            return f"TIMESTAMP('{stamp.isoformat().replace('+00:00', 'Z')}')"
        case Shape(geometry=geometry):
            return str(geometry.wkt)
        case Array(items=items):
            return f"({', '.join(map(write, items))})"
        case Interval(start=start, end=end):
            return f"INTERVAL({_end(start)}, {_end(end)})"
        case Call():
            return write_call(expression, _nested)


def write_call(call: Call, written: Writer) -> str:
    """A call, with its parts written as `written` does."""
    match call:
        case Call(op=op, args=(Literal(value=variable), Property(name=name))) if op in OF_BOUND:
            return f"{op}({variable}.{name})"
        case Call(op="and" | "or" as op, args=args):
            return f" {op} ".join(map(written, args))
        case Call(op="not", args=(inner,)):
            return f"not {written(inner)}"
        case Call(op="isNull", args=(asked,)):
            return f"{written(asked)} is null"
        case Call(op="between", args=(asked, least, most)):
            return f"{written(asked)} between {written(least)} and {written(most)}"
        case Call(op="in", args=(asked, listed)):
            return f"{written(asked)} in {written(listed)}"
        case Call(op=op, args=(left, right)) if op in INFIX:
            return f"{written(left)} {op} {written(right)}"
    return f"{call.op}({', '.join(map(written, call.args))})"


def write_value(value: object) -> str:
    """A value as it would be written in a condition."""
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case str():
            return "'" + value.replace("'", "''") + "'"
        case list() | tuple():
            return f"({', '.join(map(write_value, value))})"
    return str(value)


def _nested(expression: Expression) -> str:
    text = write(expression)
    match expression:
        case Call(op=op) if op in INFIX or op in (*LOGIC, "between", "in", "isNull"):
            return f"({text})"
    return text


def _end(end: Expression | None) -> str:
    return "'..'" if end is None else write(end)
