"""CQL2 asked of things in memory: an expression becomes a Python function.

It means what `semap.store.cql2_sql` has PostGIS make of it, with three-valued logic. Instants are ints
[us since 1970]. What the function is given, and how it finds properties in that, the subject says.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import shapely

from semap.cql2.check import (
    ARITHMETIC,
    ARRAYS,
    COMPARISONS,
    SPATIAL,
    TEMPORAL,
    TEMPORAL_PARTS,
    Functions,
    Kind,
    Kinds,
    kind_of,
)
from semap.cql2.expression import Array, Call, Expression, Instant, Interval, Literal, Property, Shape
from semap.cql2.logic import Code, Comparison, Junction, Logic, Namespace, Negation, Operand, Plain, code
from semap.cql2.value import ARITHMETIC as ARITHMETIC_OF
from semap.cql2.value import ARRAYS as ARRAYS_OF
from semap.cql2.value import SPATIAL as SPATIAL_OF
from semap.cql2.value import instant_text, json_at, like, lower, without_accents
from semap.timeline.stamp import to_us


@dataclass(frozen=True)
class Subject:
    """What an expression is asked of: how a compiled function finds things in what it is given.

    kinds        of its properties
    parameters   of the compiled function, as in a `def`
    property_of  code that gives a property of `kinds`, None where it is missing
    is_a         code that gives whether it is of a concept, or of one below it
    functions    that it has beside CQL2's own
    function_of  code that gives what one of these does, with that of its parts
    names        what all this code may use beside the parameters
    """

    kinds: Kinds
    parameters: str
    property_of: Callable[[str], Code]
    is_a: Callable[[str], Code]
    functions: Functions = field(default_factory=dict)
    function_of: Callable[[Call, Sequence[Code]], Code] | None = None
    names: Mapping[str, object] = field(default_factory=dict)


def compile_filter(expression: Expression, subject: Subject) -> Callable[..., bool]:
    """Whether an expression, checked to be a filter, is known to be true."""
    translation = _Translation(subject)
    return translation.function(translation.names.known(translation.logic(expression)))


def compile_expression(expression: Expression, subject: Subject) -> Callable[..., Any]:
    """The value of an expression whose parts are checked; None is unknown."""
    translation = _Translation(subject)
    return translation.function(translation.value(expression))


class _Translation:
    """One expression becoming code."""

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self.names = Namespace(subject.names)

    def function(self, body: Code) -> Callable[..., Any]:
        made = ast.parse(f"lambda {self.subject.parameters}: None", mode="eval")
        assert isinstance(made.body, ast.Lambda)  # noqa: S101  (written above)
        made.body.body = body
        for node in ast.walk(made):
            if isinstance(node, ast.expr | ast.arg):
                node.lineno = node.end_lineno = 1
                node.col_offset = node.end_col_offset = 0
        compiled: Callable[..., Any] = eval(  # noqa: S307  (made of our own templates)
            compile(made, "<CQL2>", "eval"), self.names.names
        )
        return compiled

    def kind(self, part: Expression) -> Kind:
        return kind_of(part, self.subject.kinds, self.subject.functions)

    def operand(self, part: Expression) -> Operand:
        constant = isinstance(part, Instant) or (isinstance(part, Literal) and part.value is not None)
        return Operand(self.value(part), self.kind(part), constant)

    def of_kind(self, part: Expression, kind: Kind) -> Code:
        return self.names.of_kind(self.operand(part), kind).code

    def applied(self, function: object, *args: Code) -> Code:
        return ast.Call(self.names.constant(function), list(args), [])

    def value(self, part: Expression) -> Code:
        """Code that gives the value of a part; of an array, a list as JSON."""
        match part:
            case Property(name=name):
                return self.property(name)
            case Literal(value=int(large)) if abs(large) >= 2**53:
                return self.names.constant(float(large))
            case Literal(value=value):
                return self.names.constant(value)
            case Instant(stamp=stamp):
                return self.names.constant(to_us(stamp))
            case Shape(geometry=geometry):
                shapely.prepare(geometry)
                return self.names.constant(geometry)
            case Array(items=items):
                return ast.List([self.json(each) for each in items], ast.Load())
            case Call(op=op) if op in self.subject.functions and self.subject.function_of is not None:
                return self.subject.function_of(part, self.arguments(part))
            case Call(op=op, args=(a, b)) if op in ARITHMETIC:
                return self.applied(ARITHMETIC_OF[op], self.of_kind(a, "number"), self.of_kind(b, "number"))
            case Call(op="casei", args=(inner,)):
                return self.applied(lower, self.of_kind(inner, "text"))
            case Call(op="accenti", args=(inner,)):
                return self.applied(without_accents, self.of_kind(inner, "text"))
            case Call():
                return self.names.value(self.logic(part))
        raise AssertionError(f"{part} has no value of its own")

    def property(self, name: str) -> Code:
        if name in self.subject.kinds:
            return self.subject.property_of(name)
        head, *keys = name.split(".")
        return self.applied(json_at, self.subject.property_of(head), self.names.constant(tuple(keys)))

    def arguments(self, call: Call) -> list[Code]:
        """Of a function; where it takes one kind only, of that kind."""
        takes = self.subject.functions[call.op].takes
        return [
            self.of_kind(each, kinds[0]) if len(kinds) == 1 else self.value(each)
            for each, kinds in zip(call.args, takes, strict=True)
        ]

    def json(self, part: Expression) -> Code:
        made = self.value(part)
        return self.applied(instant_text, made) if self.kind(part) == "instant" else made

    def logic(self, part: Expression) -> Logic:
        """What is true or false, or unknown."""
        match part:
            case Call(op="and" | "or" as op, args=args):
                return Junction(op == "and", tuple(self.logic(each) for each in args))
            case Call(op="not", args=(inner,)):
                return Negation(self.logic(inner))
            case Call(op="between", args=(inner, low, high)):
                first, kept = self.names.captured(self.operand(inner))
                bounds = ((">=", first, low), ("<=", kept, high))
                return Junction(True, tuple(self.compared(op, a, self.operand(b)) for op, a, b in bounds))
            case Call(op="in", args=(inner, Array(items=items))):
                first, kept = self.names.captured(self.operand(inner))
                sides = ((kept if n else first, self.operand(each)) for n, each in enumerate(items))
                return Junction(False, tuple(self.compared("=", a, b) for a, b in sides))
            case Call(op=op, args=(a, b)) if op in COMPARISONS:
                return self.compared(op, self.operand(a), self.operand(b))
            case Call(op=op, args=(a, b)) if op in TEMPORAL:
                return self.temporal(op, a, b)
            case Call(op=op) if op not in self.subject.functions:
                return Plain(self.predicate(part))
        return Plain(self.of_kind(part, "boolean"))

    def compared(self, op: str, a: Operand, b: Operand) -> Comparison:
        kind: Kind = next((each.kind for each in (a, b) if each.kind != "any"), "any")
        return Comparison(op, self.names.of_kind(a, kind), self.names.of_kind(b, kind))

    def predicate(self, call: Call) -> Code:
        match call:
            case Call(op="isNull", args=(inner,)):
                asked = self.operand(inner)
                return ast.Constant(False) if asked.constant else code("VALUE is None", VALUE=asked.code)
            case Call(op="isA", args=(Literal(value=str(concept)),)):
                return self.subject.is_a(concept)
            case Call(op="like", args=(inner, pattern)):
                return self.applied(like(_folded(pattern)), self.of_kind(inner, "text"))
            case Call(op=op, args=(a, b)) if op in SPATIAL:
                return self.applied(SPATIAL_OF[op], self.of_kind(a, "shape"), self.of_kind(b, "shape"))
            case Call(op=op, args=(a, b)) if op in ARRAYS:
                return self.applied(ARRAYS_OF[op], self.value(a), self.value(b))
        raise AssertionError(f"{call.op} is no predicate")

    def temporal(self, op: str, a: Expression, b: Expression) -> Logic:
        spans = {"a": self.span(a), "b": self.span(b)}
        found = []
        for part in TEMPORAL_PARTS[op]:
            left, comparison, right = part.split()
            sides = (spans[side[0]][side[2:]] for side in (left, right))
            found.append(Comparison(comparison, *sides))
        return Junction(op != "t_disjoint", tuple(found))

    def span(self, part: Expression) -> Mapping[str, Operand]:
        """From a moment to a moment; an instant is both."""
        ends = (part.start, part.end) if isinstance(part, Interval) else (part, part)
        return {
            name: self.names.of_kind(self.operand(end), "instant")
            if end is not None
            else Operand(self.names.constant(beyond), "instant", constant=True)
            for name, end, beyond in zip(("start", "end"), ends, (-math.inf, math.inf), strict=True)
        }


def _folded(pattern: Expression) -> str:
    """What a pattern says, its cases and accents folded as it asks."""
    match pattern:
        case Literal(value=str(value)):
            return value
        case Call(op="casei" | "accenti" as op, args=(inner,)):
            return (lower if op == "casei" else without_accents)(_folded(inner)) or ""
    raise AssertionError(f"{pattern} is no pattern")
