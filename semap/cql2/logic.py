"""Three-valued logic as Python code: True, False, and None for what is unknown, as in SQL.

What is asked of a filter is whether it is known to be true. That question goes inwards: a conjunction is true
where each part is, and false where any is; a comparison is false where its opposite is true. So most of a
filter becomes plain Python with `and` and `or`, and None is carried only where a truth value is itself
compared. Every part is translated once, so that the code is no longer than the filter.

Code is made of templates: expressions in which names stand for parts. Values from outside never become text.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from typing import TypeAlias

from semap.cql2.check import Kind
from semap.cql2.value import JSON_COMPARISONS, OF_KIND

Code = ast.expr
OPPOSITES = {"=": "<>", "<>": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
PYTHON = {"=": "==", "<>": "!="}


def code(template: str, **parts: Code) -> Code:
    """A Python expression with parts in the place of names."""
    made: Code = _Filling(parts).visit(ast.parse(template, mode="eval").body)
    return made


class _Filling(ast.NodeTransformer):
    def __init__(self, parts: Mapping[str, Code]) -> None:
        self.parts = parts

    def visit_Name(self, node: ast.Name) -> Code:
        part = self.parts.get(node.id, node)
        return ast.Name(part.id, node.ctx) if isinstance(part, ast.Name) else part


@dataclass(frozen=True)
class Operand:
    """A value in code; constant: one that is known already, and is not None."""

    code: Code
    kind: Kind
    constant: bool = False


@dataclass(frozen=True)
class Plain:
    """Code that gives True, False or None."""

    code: Code


@dataclass(frozen=True)
class Negation:
    part: Logic


@dataclass(frozen=True)
class Junction:
    """All of the parts, or any."""

    every: bool
    parts: tuple[Logic, ...]


@dataclass(frozen=True)
class Comparison:
    """By CQL2's name of it; both of one kind. The left one is always worked out, and first."""

    op: str
    left: Operand
    right: Operand


Logic: TypeAlias = Plain | Negation | Junction | Comparison


class Namespace:
    """Names that code may use: of objects from outside, and of values that it has worked out."""

    def __init__(self, names: Mapping[str, object]) -> None:
        self.names = dict(names)
        self._numbers = count()

    def constant(self, value: object) -> Code:
        if value is None or isinstance(value, bool | int | float | str):
            return ast.Constant(value)
        name = f"constant_{next(self._numbers)}"
        self.names[name] = value
        return ast.Name(name, ast.Load())

    def variable(self) -> Code:
        return ast.Name(f"value_{next(self._numbers)}", ast.Load())

    def of_kind(self, operand: Operand, kind: Kind) -> Operand:
        """None where it is of another kind."""
        if operand.kind != "any" or kind == "any":
            return operand
        made = code("OF(VALUE)", OF=self.constant(OF_KIND[kind]), VALUE=operand.code)
        return Operand(made, kind)

    def captured(self, operand: Operand) -> tuple[Operand, Operand]:
        """What works it out and keeps it, and then what was kept."""
        if operand.constant:
            return operand, operand
        kept = self.variable()
        first = code("(KEPT := VALUE)", KEPT=kept, VALUE=operand.code)
        return Operand(first, operand.kind), Operand(kept, operand.kind)

    def known(self, part: Logic, wanted: bool = True) -> Code:
        """Code that gives whether a part is known to be true, or to be false."""
        match part:
            case Plain(code=inner):
                return code("VALUE is WANTED", VALUE=inner, WANTED=ast.Constant(wanted))
            case Negation(part=inner):
                return self.known(inner, not wanted)
            case Junction(every=every, parts=parts):
                return _joined(every == wanted, [self.known(each, wanted) for each in parts])
            case Comparison(op=op, left=left, right=right) if left.kind == "any":
                return code("VALUE is WANTED", VALUE=self.value(part), WANTED=ast.Constant(wanted))
            case Comparison(op=op, left=left, right=right):
                asked = op if wanted else OPPOSITES[op]
                if asked == "=" and (left.constant or right.constant):
                    # None equals nothing that is known
                    return code("A == B", A=left.code, B=right.code)
                guards, compared = self._compared(asked, left, right)
                return _joined(True, [*guards, compared])

    def value(self, part: Logic) -> Code:
        """Code that gives True, False or None."""
        match part:
            case Plain(code=inner):
                return inner
            case Negation(part=inner):
                return code(
                    "None if (X := VALUE) is None else not X", X=self.variable(), VALUE=self.value(inner)
                )
            case Junction(every=every, parts=parts):
                return self._junction(every, parts)
            case Comparison(op=op, left=left, right=right) if left.kind == "any":
                compare = self.constant(JSON_COMPARISONS[op])
                return code("COMPARE(A, B)", COMPARE=compare, A=left.code, B=right.code)
            case Comparison(op=op, left=left, right=right):
                guards, compared = self._compared(op, left, right)
                if not guards:
                    return compared
                return code("FOUND if KNOWN else None", FOUND=compared, KNOWN=_joined(True, guards))

    def _junction(self, every: bool, parts: tuple[Logic, ...]) -> Code:
        if not parts:
            return ast.Constant(every)
        names = [self.variable() for _ in parts]
        decided = [
            code("(X := VALUE) is DECIDES", X=name, VALUE=self.value(each), DECIDES=ast.Constant(not every))
            for name, each in zip(names, parts, strict=True)
        ]
        return code(
            "DECISION if DECIDED else None if UNKNOWN else OTHERWISE",
            DECISION=ast.Constant(not every),
            DECIDED=_joined(False, decided),
            UNKNOWN=_joined(False, [code("X is None", X=name) for name in names]),
            OTHERWISE=ast.Constant(every),
        )

    def _compared(self, op: str, left: Operand, right: Operand) -> tuple[list[Code], Code]:
        """What must hold for it to be known, and the comparison itself."""
        guards, sides = [], []
        for side in (left, right):
            if side.constant:
                sides.append(side.code)
            else:
                name = self.variable()
                guards.append(code("(X := VALUE) is not None", X=name, VALUE=side.code))
                sides.append(name)
        return guards, code(f"A {PYTHON.get(op, op)} B", A=sides[0], B=sides[1])


def _joined(every: bool, parts: list[Code]) -> Code:
    if len(parts) < 2:
        return parts[0] if parts else ast.Constant(every)
    return ast.BoolOp(ast.And() if every else ast.Or(), parts)
