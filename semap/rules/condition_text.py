"""Conditions written as text, as they are, or with what their parts come to for a row."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from semap.cql2 import Array, Call, Expression, Instant, Interval, Literal, Property, Shape
from semap.rules.naming import OF_BOUND, Label

INFIX = frozenset({"=", "<>", "<", "<=", ">", ">=", "+", "-", "*", "/", "%", "div", "^", "like", "||"})
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
        case Call(op=op, args=(Literal(value=Label() as label), *offset, asked)) if op in OF_BOUND:
            return _of_label(op, label, offset, asked)
        case Call(op="prev" | "next" as op, args=(Literal(value=offset), asked)):
            return f"{op}({written(asked)}{_offset(offset, 1)})"
        case Call(op="classifier_near", args=(Literal(value=offset),)):
            return f"prev(classifier(){_offset(offset, 1)})"
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


def _of_label(op: str, label: Label, offset: Sequence[Expression], asked: Expression) -> str:
    """What is asked of the rows of a variable, as a person would write it."""
    after = "".join(_offset(each.value, 0) for each in offset if isinstance(each, Literal))
    match asked:
        case Call(op="prev" | "next" as shift, args=(Literal(value=far), inner)):
            return f"{shift}({op}({_qualified(inner, label)}{after}){_offset(far, 1)})"
        case Call(op="classifier_near", args=(Literal(value=far),)):
            return f"prev({op}(classifier({label}){after}){_offset(far, 1)})"
    return f"{op}({_qualified(asked, label)}{after})"


def _qualified(asked: Expression, label: Label) -> str:
    """The expression with each property as one of the variable's rows."""
    match asked:
        case Property(name=name):
            return f"{label}.{name}" if label else name
        case Call(op="classifier"):
            return f"classifier({label})"
        case Call():
            return write_call(asked, lambda part: _qualified(part, label))
    return write(asked)


def _offset(offset: object, usual: int) -> str:
    return "" if offset == usual else f", {offset}"


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
