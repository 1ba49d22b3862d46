"""What conditions and measures ask of variables, as it is written, and the one form that is made of it.

    A.x, last(A.x)          last(A, 0, x)
    first(A.x + A.y, 2)     first(A, 2, x + y)
    sum(A.x)                sum(A, x)
    prev(A.x, 2)            last(A, 0, prev(2, x))
    prev(first(A.x, 1), 2)  first(A, 1, prev(2, x))
    prev(x)                 prev(1, x)
    classifier(A)           last(A, 0, classifier())

Within the last part of each of them a property is of each of the variable's rows.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping
from typing import NoReturn, TypeAlias

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
    parts,
)
from semap.errors import InvalidInput
from semap.rules import scalar
from semap.rules.row import PROPERTIES

Subsets: TypeAlias = Mapping[str, frozenset[str]]

VARIABLE: tuple[Kind, ...] = ("text",)
NUMBER: tuple[Kind, ...] = ("number",)
ANY_KIND: tuple[Kind, ...] = ("boolean", "number", "text", "instant", "shape", "array", "any")
NAVIGATION = ("first", "last")
AGGREGATES = ("count", "sum", "avg", "min", "max", "array", "distinct", "count_distinct")
OF_BOUND = (*NAVIGATION, *AGGREGATES)
SHIFTS = ("prev", "next")
FUNCTIONS: Functions = {
    **dict.fromkeys(NAVIGATION, Function((VARIABLE, NUMBER, ANY_KIND))),
    **dict.fromkeys(("count", "count_distinct"), Function((VARIABLE, ANY_KIND), "number")),
    **dict.fromkeys(("sum", "avg"), Function((VARIABLE, NUMBER), "number")),
    **dict.fromkeys(("min", "max"), Function((VARIABLE, ("number", "text", "instant")))),
    **dict.fromkeys(("array", "distinct"), Function((VARIABLE, ANY_KIND), "array")),
    **dict.fromkeys(SHIFTS, Function((NUMBER, ANY_KIND))),
    "classifier": Function((), "text"),
    "classifier_near": Function((NUMBER,), "text"),
    "match_number": Function((), "number"),
    "final": Function((ANY_KIND,)),
    "running": Function((ANY_KIND,)),
    "seconds_between": Function((("instant",), ("instant",)), "number"),
    **scalar.FUNCTIONS,
}
OF_STAMP = ("first", "last", "count")
"""Those that may be given a variable alone."""

FARTHEST = 1_000
"""Of offsets."""


class Label(str):
    """A variable, a name for several, or none for all; `variables`: which rows it is of (None: all)."""

    variables: frozenset[str] | None

    @staticmethod
    def of(name: str, variables: frozenset[str] | None) -> Label:
        label = Label(name)
        label.variables = variables
        return label


class Naming:
    """Makes one form of what asks of variables.

    subsets  names for several of them
    """

    def __init__(self, variables: frozenset[str], subsets: Subsets) -> None:
        self.subsets = subsets
        self.variables = variables | subsets.keys()

    def named(self, part: Expression) -> Expression:
        match part:
            case Property():
                return self.property(part)
            case Call(op="last" | "first"):
                return self.navigated(part)
            case Call(op=op) if op in AGGREGATES:
                return self.aggregated(part)
            case Call(op="prev" | "next"):
                return self.shifted(part)
            case Call(op="classifier", args=(Property(name=name),)) if name in self.variables:
                return self.of_label("last", name, 0, Call("classifier", (), part.place), part.place)
            case Call(op="classifier_near"):
                _refuse(part, "there is no function classifier_near", "Write prev(classifier()).")
            case Call(op="running", args=(inner,)):
                return self.named(inner)
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
            return self.of_label("last", head, 0, Property(rest, asked.place), asked.place)
        if head not in PROPERTIES:
            what = "neither a property nor a variable" if rest else "no property"
            _refuse(asked, f"there is {what} {head}", self.hint(head, PROPERTIES))
        return asked

    def navigated(self, part: Call) -> Call:
        """first or last, with or without an offset."""
        asked, offset = self.with_offset(part, f"Write {part.op}(A.stamp), or {part.op}(A.stamp, 1).", 0)
        label, inner = self.of_one(part, asked)
        return self.of_label(part.op, label, offset, inner, part.place)

    def aggregated(self, part: Call) -> Call:
        if part.op == "count" and not part.args and self.variables:
            asked: Expression = Property("stamp", part.place)
            return Call("count", (self.label("", part.place), asked), part.place)
        if len(part.args) != 1:
            _refuse(part, f"{part.op} of something else than a variable", f"Write {part.op}(A.stamp).")
        label, inner = self.of_one(part, part.args[0])
        return Call(part.op, (self.label(label, part.place), inner), part.place)

    def shifted(self, part: Call) -> Expression:
        """Of the row so many away from the one that is asked about, or that something in it names."""
        op = part.op
        asked, offset = self.with_offset(
            part, f"Write {op}(type), {op}(A.type, 2) or {op}(first(A.type)).", 1
        )
        match asked:
            case Call(op="first" | "last"):
                found = self.navigated(asked)
                label, at, inner = found.args
                return Call(found.op, (label, at, self.moved(part, inner, offset)), part.place)
        variables = {self.variable(each) for each in parts(asked) if isinstance(each, Property)} - {""}
        if not variables:
            return self.moved(part, self.named(asked), offset)
        label_name, inner = self.of_one(part, asked)
        return self.of_label("last", label_name, 0, self.moved(part, inner, offset), part.place)

    def moved(self, part: Call, inner: Expression, offset: int) -> Expression:
        """What is asked of a row, asked of one that is so far away."""
        if offset == 0:
            return inner

        def moved(each: Expression) -> Expression:
            match each:
                case Property():
                    return Call(part.op, (Literal(offset, part.place), each), each.place)
                case Call(op="classifier") if part.op == "prev":
                    return Call("classifier_near", (Literal(offset, part.place),), each.place)
                case Call(op=op) if op in (*OF_BOUND, *SHIFTS, "isA", "classifier", "match_number", "final"):
                    _refuse(
                        part, f"{part.op} of {op}", f"Write {part.op}(first(A.type, 1), 2), or of a property."
                    )
            return _rebuilt(each, moved)

        return moved(inner)

    def with_offset(self, part: Call, remedy: str, usual: int) -> tuple[Expression, int]:
        match part.args:
            case (asked,):
                return asked, usual
            case (asked, Literal(value=int(offset))) if offset is not True and 0 <= offset <= FARTHEST:
                return asked, offset
            case (_, at):
                _refuse(at, f"an offset that is no whole number from 0 to {FARTHEST}", remedy)
        raise InvalidInput(f"{part.op} of {len(part.args)} parts", remedy, part.place)

    def of_one(self, part: Call, asked: Expression) -> tuple[str, Expression]:
        """The one variable that is asked of (none: of all), and what is asked of each of its rows."""
        heads = set(self.heads(part, asked))
        if len(heads) > 1:
            _refuse(part, f"{part.op} of the rows of more than one variable", "Name them by a subset.")
        if not self.variables:
            _refuse(part, f"{part.op} of something else than a variable", f"Write {part.op}(A.stamp).")
        label = heads.pop() if heads else ""

        def bare(each: Expression) -> Expression:
            match each:
                case Property(name=name) if label:
                    rest = name.partition(".")[2]
                    return Property(rest or "stamp", each.place)
                case Call(op="classifier", args=(Property(),)):
                    return Call("classifier", (), each.place)
            return _rebuilt(each, bare)

        return label, bare(asked)

    def heads(self, part: Call, asked: Expression) -> Iterator[str]:
        match asked:
            case Property(name=name):
                yield self.head_of(part, asked, name)
            case Call(op="classifier", args=(Property(name=name),)) if name in self.variables:
                yield name
            case Call(op=op) if op in (*OF_BOUND, *SHIFTS, "match_number", "final", "running"):
                remedy = f"Write {part.op}(A.stamp)."
                _refuse(part, f"{part.op} of something else than a variable", remedy)
            case Call(args=inner) | Array(items=inner):
                for each in inner:
                    yield from self.heads(part, each)

    def head_of(self, part: Call, asked: Property, name: str) -> str:
        head, _, rest = name.partition(".")
        if self.variable(asked):
            if not rest and part.op not in OF_STAMP:
                _refuse(asked, f"{part.op} of no property", f"Name one: {part.op}({head}.duration_s).")
            return head
        if head not in PROPERTIES:
            _refuse(asked, f"there is no variable {head}", self.hint(head, {}))
        return ""

    def of_label(self, op: str, name: str, offset: int, inner: Expression, place: str) -> Call:
        return Call(op, (self.label(name, place), Literal(offset, place), inner), place)

    def label(self, name: str, place: str) -> Literal:
        variables = None if not name else self.subsets.get(name, frozenset({name}))
        return Literal(Label.of(name, variables), place)

    def hint(self, name: str, kinds: Kinds) -> str:
        """What may have been meant, and what there is."""
        known = [*sorted(self.variables), *kinds]
        near = difflib.get_close_matches(name, known, n=1)
        meant = f"Did you mean {near[0]}? " if near else ""
        variables = ", ".join(sorted(self.variables)) or "none"
        properties = f"; the properties are {', '.join(kinds)}" if kinds else ""
        return f"{meant}The variables are {variables}{properties}."


def _rebuilt(part: Expression, made: Callable[[Expression], Expression]) -> Expression:
    """The same with other parts."""
    match part:
        case Call(op=op, args=args):
            return Call(op, tuple(map(made, args)), part.place)
        case Array(items=items):
            return Array(tuple(map(made, items)), part.place)
    return part


def _refuse(part: Expression, message: str, remedy: str) -> NoReturn:
    raise InvalidInput(message, remedy, part.place)
