"""Conditions as Flink takes them: SQL for MATCH_RECOGNIZE, and trees for FlinkCondition.java."""

from __future__ import annotations

from semap.cql2 import Array, Call, Expression, Literal, Property

COLUMNS = ("type", "occupants")
COMPARISONS = ("=", "<>", "<", "<=", ">", ">=")
AGGREGATES = ("count", "sum", "avg", "min", "max")
OF_BOUND = ("first", "last", *AGGREGATES)
Tree = list[object]


class Unsaid(Exception):
    """Flink has no words for it; the message says for what."""


def tree(condition: Expression) -> Tree:
    """As FlinkCondition.java reads it."""
    match condition:
        case Literal(value):
            return ["value", value]
        case Property(name) if name in COLUMNS:
            return ["property", name]
        case Call(op, (Literal(str(variable)), *offset, Property(name))) if _is_plain(op, variable, offset):
            return [op, variable, _column(op, name)]
        case Call(op, args) if op in (*COMPARISONS, "and", "or", "not", "+", "-", "*"):
            return [op, *map(tree, args)]
        case Call() if (simpler := _simpler(condition)) is not None:
            return tree(simpler)
    raise Unsaid(f"a condition with {_name(condition)}")


def sql(condition: Expression, variable: str) -> str:
    """As it stands under DEFINE for this variable."""
    match condition:
        case Literal(str(text)):
            return "'" + text.replace("'", "''") + "'"
        case Literal(bool(value)):
            return str(value).upper()
        case Literal(float(number) | int(number)):
            return f"CAST({number} AS DOUBLE)"
        case Property(name) if name in COLUMNS:
            return f"{variable}.`{name}`"
        case Call("count", (Literal(str(other)), Property())) if other:
            return f"COUNT({other}.`number`)"
        case Call(op, (Literal(str(other)), *offset, Property(name))) if _is_plain(op, other, offset):
            return f"{op.upper()}({other}.`{_column(op, name)}`)"
        case Call("not", (part,)):
            return f"NOT ({sql(part, variable)})"
        case Call(op, args) if op in (*COMPARISONS, "and", "or", "+", "-", "*"):
            return "(" + f" {op.upper()} ".join(sql(each, variable) for each in args) + ")"
        case Call() if (simpler := _simpler(condition)) is not None:
            return sql(simpler, variable)
    raise Unsaid(f"a condition with {_name(condition)}")


def _is_plain(op: str, variable: str, offset: list[Expression]) -> bool:
    """Of one variable, without an offset."""
    return op in OF_BOUND and bool(variable) and offset in ([], [Literal(0)])


def _simpler(call: Call) -> Expression | None:
    """`in` and `between` by comparisons."""
    match call:
        case Call("in", (asked, Array(items))):
            equal = tuple(Call("=", (asked, item)) for item in items)
            return equal[0] if len(equal) == 1 else Call("or", equal)
        case Call("between", (asked, low, high)):
            return Call("and", (Call(">=", (asked, low)), Call("<=", (asked, high))))
    return None


def _column(op: str, name: str) -> str:
    if op != "count" and name not in COLUMNS:
        raise Unsaid(f"a condition with {name}")
    return name


def _name(condition: Expression) -> str:
    match condition:
        case Call(op):
            return op
        case Property(name):
            return name
    return type(condition).__name__
