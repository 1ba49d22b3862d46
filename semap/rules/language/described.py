"""A rule said in one plain sentence, from what it was read as: so that its author sees what it will do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TypeAlias

from semap.cql2 import Array, Call, Expression, Literal, Property
from semap.rules import pattern as p
from semap.rules.condition_text import write
from semap.rules.declaration import AfterMatch, Declaration, Edges, IntervalPattern, RowPattern, Windows
from semap.rules.formula import (
    Always,
    And,
    Atom,
    Constant,
    Eventually,
    Exists,
    Formula,
    Future,
    Historically,
    Not,
    Once,
    Or,
    Past,
    Previous,
    Since,
    Until,
)
from semap.rules.language.duration import write_duration
from semap.rules.temporal.metric import atom_names

Timed: TypeAlias = Always | Eventually | Historically | Once | Previous
"""What asks one formula at moments of a window."""

VERBS: Mapping[str, str] = {"began": "begins", "ended": "ends", "crossed": "is crossed"}
OUTCOMES: Mapping[str, str] = {
    "timeout": "where a window ends before that is complete",
    "empty": "where it is found with no row",
    "unmatched": "for each row that is in none",
    "fails": "where that is false",
}
TIMES: Mapping[tuple[int, int | None], str] = {
    (0, 1): "or nothing",
    (0, None): "any number of times",
    (1, None): "once or more",
}
BETWEEN: Mapping[str, str] = {"next": "", "relaxed": " with anything between", "any": " in every way"}
SKIPS: Mapping[str, str] = {
    "none": "every way to find it counts",
    "clear": "every way to find it counts, and what ends together ends all that had begun",
    "to next": "the next one may begin at the row after the first",
}


def describe(declaration: Declaration) -> str:
    """What a rule does, in one sentence."""
    rows = Rows(declaration)
    each = listed(declaration.partition_by)
    begin = f"For each {each}, it" if each else "It"
    parts = [f"{begin} makes {rows.found()}"]
    others = [
        (name, event)
        for name, event in declaration.emit.items()
        if name in OUTCOMES and len(declaration.emit) > 1
    ]
    parts += [
        f"and {event} {OUTCOMES[name]}" for name, event in others if not isinstance(declaration.body, Edges)
    ]
    if declaration.where is not None:
        parts.append(f"reading only rows with {write(declaration.where)}")
    if declaration.confidence is not None:
        first, last = declaration.confidence.first, declaration.confidence.last
        parts.append(f"the less sure the longer it is from {first} to {last}")
    if isinstance(declaration.body, RowPattern):
        parts += _afterwards(declaration.after_match, declaration.each_row)
    return ", ".join(parts) + "."


def _afterwards(after: AfterMatch, each_row: bool) -> Iterator[str]:
    if each_row:
        yield "one event for each row of it"
    if after.skip in SKIPS:
        yield SKIPS[after.skip]
    elif after.skip != "past last":
        end = after.skip.removeprefix("to ")
        yield f"the next one may begin at the {end} row of {listed(sorted(after.variables), 'or')}"


class Rows:
    """Rows by the words of their rule's conditions."""

    def __init__(self, declaration: Declaration) -> None:
        self.rule = declaration
        self.kinds = {item.name: item.kind for item in declaration.inputs}

    def found(self) -> str:
        """The events of what is found, and what that is."""
        emit = self.rule.emit
        match self.rule.body:
            case Edges():
                makes = [f"{event} when {self.change(None, kind)}" for kind, event in emit.items()]
                return listed(makes)
            case RowPattern(node):
                return f"{self.named('match')} when {self.pattern(node)}{window_of(self.rule.within)}"
            case IntervalPattern(left, relations, right):
                how = listed(sorted(relations), "or")
                said = (
                    f"{self.said(left)} lasts in the relation {how} to that in which {self.said(right)} lasts"
                )
                return f"{self.named('match')} where the time in which {said}{window_of(self.rule.within)}"
            case body:
                atoms = [f"{name} from when {self.said(name)}" for name in atom_names(body.formula)]
                lasts = f", where what lasts is {listed(atoms)}" if atoms else ""
                when = f", asked whenever {self.said(body.when)}" if body.when else ""
                outcome = "holds" if "holds" in emit else "fails"
                truth = "where" if outcome == "holds" else "where it is false that"
                return f"{emit[outcome]} {truth} {self.formula(body.formula)}{when}{lasts}"

    def named(self, outcome: str) -> str:
        return self.rule.emit.get(outcome) or next(iter(self.rule.emit.values()))

    def pattern(self, node: p.Node) -> str:
        match node:
            case p.Variable(name, excluded):
                return self.said(name) + (" (not shown)" if excluded else "")
            case p.Absent(name):
                return self.said(name)
            case p.Anchor(at):
                return "the begin of the stream" if at == "begin" else "the end of the stream"
            case p.Sequence(()):
                return "nothing"
            case p.Sequence(elements):
                return "".join(self.joined(elements, place) for place in range(len(elements)))
            case p.Alternation(options):
                return f"either {listed([self.pattern(each) for each in options], 'or')}"
            case p.Permutation(nodes, joint):
                return f"{listed([self.pattern(each) for each in nodes])} in any order{BETWEEN[joint]}"
            case p.Repeat():
                return self.repeated(node)

    def joined(self, elements: Sequence[p.Element], place: int) -> str:
        element = elements[place]
        said = self.pattern(element.node)
        if isinstance(element.node, p.Absent):
            if element.joint == "next":
                return f", and it is not so that directly after it {said}"
            until = "before what follows" if place + 1 < len(elements) else "until the window ends"
            return f", and it is never so that {said} {until}"
        if place == 0:
            return said
        words = {
            "next": "directly after it",
            "relaxed": "later",
            "any": "at each time later at which that is so",
        }
        return f", {words[element.joint]} {said}"

    def repeated(self, node: p.Repeat) -> str:
        inner = self.pattern(node.node)
        return f"{inner if isinstance(node.node, p.Variable) else f'({inner})'} {self.times(node)}"

    def times(self, node: p.Repeat) -> str:
        """How often, and until when."""
        counts = TIMES.get((node.least, node.most))
        if counts is None:
            counts = (
                f"{node.least} times" if node.most == node.least else f"{node.least} to {node.most} times"
            )
            counts = f"{node.least} times or more" if node.most is None else counts
        few = "" if node.greedy else ", as seldom as can be"
        until = f", until {self.said(node.until)}" if node.until is not None else ""
        return f"{counts}{BETWEEN[node.joint]}{few}{until}"

    def said(self, name: str) -> str:
        """What satisfies a variable."""
        condition = self.rule.define.get(name)
        return f"{'any row comes' if condition is None else self.change(condition)} ({name})"

    def change(self, condition: Expression | None, kind: str | None = None) -> str:
        """A row in words: which input changes how, and what else is asked of it."""
        if isinstance(condition, Call) and condition.op == "or":
            return " or ".join(self.change(each) for each in condition.args)
        source, left = next(iter(self.kinds)) if len(self.kinds) == 1 else None, []
        kinds = [kind] if kind is not None else []
        for part in _conjuncts(condition):
            match part:
                case Call("=", (Property("input"), Literal(str(value)))):
                    source = value
                case Call("=", (Property("type"), Literal(str(value)))):
                    kinds = [value]
                case Call("in", (Property("type"), Array(items))) if all(
                    isinstance(each, Literal) for each in items
                ):
                    kinds = [str(each.value) for each in items if isinstance(each, Literal)]
                case _:
                    left.append(write(part))
        return self.changed(source, kinds) + (f" with {' and '.join(left)}" if left else "")

    def changed(self, source: str | None, kinds: Sequence[str]) -> str:
        if self.kinds.get(source or "") == "map":
            return f"something of the map is {listed(kinds, 'or')}" if kinds else "the map changes"
        if not kinds:
            return f"{source or 'anything'} changes"
        return (
            f"{source or 'something'} {listed([VERBS.get(kind, f'becomes {kind}') for kind in kinds], 'or')}"
        )

    def formula(self, formula: Formula) -> str:
        match formula:
            case Atom(name):
                return f"{name} lasts"
            case Constant(value):
                return "true" if value else "false"
            case Not(Exists(name, Not(inner))):
                return f"for each {name} that lasts {self.inner(inner)}"
            case Not(inner):
                return f"not {self.inner(inner)}"
            case Exists(name, inner):
                return f"for some {name} that lasts {self.inner(inner)}"
            case And(parts):
                return " and ".join(map(self.inner, parts))
            case Or(parts):
                return " or ".join(map(self.inner, parts))
            case Until(left, right):
                return f"{self.inner(left)} until {self.inner(right)}, {bounds_of(formula)}"
            case Since(left, right):
                return f"{self.inner(left)} since {self.inner(right)}, {bounds_of(formula)}"
            case timed:
                return f"{self.when(timed)} {self.inner(timed.inner)}"

    def when(self, formula: Timed) -> str:
        """The moments at which what is in it is asked."""
        match formula:
            case Always() | Historically():
                return f"at every moment {bounds_of(formula)}"
            case Eventually() | Once():
                return f"at some moment {bounds_of(formula)}"
            case Previous():
                return f"at the row before, {bounds_of(formula)},"

    def inner(self, formula: Formula) -> str:
        said = self.formula(formula)
        return said if isinstance(formula, Atom | Constant) else f"({said})"


def _conjuncts(condition: Expression | None) -> Iterable[Expression]:
    match condition:
        case None:
            return ()
        case Call("and", args):
            return args
    return (condition,)


def bounds_of(formula: Future | Past) -> str:
    side = "from then" if isinstance(formula, Always | Eventually | Until) else "before then"
    if formula.to_us is None:
        return f"{side}" if formula.from_us == 0 else f"{write_duration(formula.from_us)} or more {side}"
    return f"{write_duration(formula.from_us)} to {write_duration(formula.to_us)} {side}"


def window_of(within: Windows) -> str:
    found = []
    if within.match_us is not None:
        found.append(f"all in less than {write_duration(within.match_us)}")
    if within.step_us is not None:
        found.append(f"each less than {write_duration(within.step_us)} after the one before")
    found += [f"{name} less than {write_duration(us)} after it" for name, us in within.variables.items()]
    return "".join(f", {each}" for each in found)


def listed(words: Sequence[str], last: str = "and") -> str:
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))
