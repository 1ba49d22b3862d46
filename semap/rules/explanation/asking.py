"""A condition asked of a row, part by part: what each says, and what it comes to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from semap.cql2 import Call, Expression, Interval, Literal, Shape
from semap.rules.bound import Bound
from semap.rules.condition import compile_condition, compile_measure
from semap.rules.condition_text import LOGIC, write, write_call, write_value
from semap.rules.row import Row, Value


@dataclass(frozen=True)
class Part:
    """What a condition says that is no more put together of and, or, not.

    said   for example: track = first(O.actor)
    found  the same with values: 'ann' = 'bob'; empty where there are none to give
    """

    said: str
    found: str
    holds: bool


@dataclass(frozen=True)
class Asked:
    """The condition of a variable, asked of a row."""

    variable: str
    row: Row
    parts: tuple[Part, ...]
    holds: bool

    @property
    def failed(self) -> int:
        """How many parts do not hold."""
        return sum(not part.holds for part in self.parts)


def ask(variable: str, condition: Expression | None, row: Row, bound: Bound | None) -> Asked:
    """Ask whether a row can be bound to the variable after those that are.

    condition  of the variable; None is true of any row
    """
    if condition is None:
        return Asked(variable, row, (), True)
    chain = Bound(variable, row, bound)
    found = tuple(
        Part(write(leaf), _with_values(leaf, chain), _holds(leaf, chain)) for leaf in _leaves(condition)
    )
    return Asked(variable, row, found, _holds(condition, chain))


def _leaves(expression: Expression) -> Iterator[Expression]:
    match expression:
        case Call(op=op, args=args) if op in LOGIC:
            for inner in args:
                yield from _leaves(inner)
        case _:
            yield expression


def _holds(expression: Expression, chain: Bound) -> bool:
    return compile_condition(expression).test_bound(chain.row, chain)


def _with_values(leaf: Expression, chain: Bound) -> str:
    if not isinstance(leaf, Call) or leaf.op == "isA":
        return ""
    return write_call(leaf, lambda operand: _come_to(operand, chain))


def _come_to(operand: Expression, chain: Bound) -> str:
    """What an operand comes to; as it is written where that is no plain value."""
    match operand:
        case Literal() | Shape() | Interval():
            return write(operand)
    value: Value = compile_measure(operand)(chain, chain, 0)
    return write_value(value)
