"""A rule as boxes, one within or after the other: a drawing that a page or a terminal lays out as it likes.

Parts of one are read from the first to the last; `joint` says how one follows the one before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from semap.rules import pattern as p
from semap.rules.declaration import Declaration, Edges, IntervalPattern, RowPattern, TemporalFormula
from semap.rules.formula import (
    And,
    Atom,
    Constant,
    Exists,
    Formula,
    Not,
    Or,
    Since,
    Until,
)
from semap.rules.language.described import OUTCOMES, Rows, bounds_of, listed, window_of

PartKind: TypeAlias = Literal["step", "never", "event", "sequence", "choice", "all", "repeat"]
JOINTS = {"next": "directly", "relaxed": "later", "any": "each time later"}


@dataclass(frozen=True)
class Part:
    """One box.

    kind   step: a row; never: a row that must not come; event: what is made; the others hold parts: one after
           the other, one of them, all of them in any order, the same several times
    label  a variable, or an event
    text   in words: what a step is, how often a part is repeated, what holds of a sequence
    joint  how it follows the part before; of a sequence only
    """

    kind: PartKind
    label: str = ""
    text: str = ""
    joint: str = ""
    parts: tuple[Part, ...] = ()


def draw(declaration: Declaration) -> Part:
    """A rule from what it begins with to the events that it makes."""
    rows = Rows(declaration)
    each = listed(declaration.partition_by)
    within = window_of(declaration.within).removeprefix(", ")
    text = ", ".join(filter(None, (f"for each {each}" if each else "", within)))
    body = declaration.body
    if isinstance(body, Edges):
        made = tuple(
            Part("sequence", parts=(Part("step", text=rows.change(None, kind)), Part("event", event)))
            for kind, event in declaration.emit.items()
        )
        return made[0] if len(made) == 1 else Part("choice", text=text, parts=made)
    events = tuple(Part("event", event, OUTCOMES.get(kind, "")) for kind, event in declaration.emit.items())
    return Part("sequence", text=text, parts=(*_begin(declaration, rows), *events))


def _begin(declaration: Declaration, rows: Rows) -> Iterator[Part]:
    """What comes before the events."""
    match declaration.body:
        case RowPattern(node):
            whole = _of_pattern(node, rows)
            yield from whole.parts if whole.kind == "sequence" else (whole,)
        case IntervalPattern(left, relations, right):
            yield _step(left, rows)
            yield replace(_step(right, rows), joint=listed(sorted(relations), "or"))
        case TemporalFormula(formula, when):
            if when is not None:
                yield replace(_step(when, rows), text=f"asked when {_words(when, rows)}")
            yield replace(_of_formula(formula, rows), joint="from then")


def _words(name: str, rows: Rows) -> str:
    return rows.said(name).removesuffix(f" ({name})")


def _step(name: str, rows: Rows, kind: PartKind = "step") -> Part:
    return Part(kind, name, _words(name, rows))


def _of_pattern(node: p.Node, rows: Rows) -> Part:
    match node:
        case p.Variable(name, excluded):
            step = _step(name, rows)
            return replace(step, text=f"{step.text} (not shown)") if excluded else step
        case p.Absent(name):
            return _step(name, rows, "never")
        case p.Anchor(at):
            return Part("step", text=f"the {at} of the stream")
        case p.Sequence(elements):
            joined = (replace(_of_pattern(each.node, rows), joint=JOINTS[each.joint]) for each in elements)
            return Part("sequence", parts=tuple(joined))
        case p.Alternation(options):
            return Part("choice", parts=_all_of(options, rows))
        case p.Permutation(nodes, joint):
            return Part("all", text=f"in any order, each {JOINTS[joint]}", parts=_all_of(nodes, rows))
        case p.Repeat(inner):
            return Part("repeat", text=rows.times(node), parts=(_of_pattern(inner, rows),))


def _all_of(nodes: Sequence[p.Node], rows: Rows) -> tuple[Part, ...]:
    return tuple(_of_pattern(each, rows) for each in nodes)


def _of_formula(formula: Formula, rows: Rows) -> Part:
    match formula:
        case Atom(name):
            return Part("step", name, f"since {_words(name, rows)}")
        case Constant(value):
            return Part("step", text="always true" if value else "never true")
        case Not(Atom(name)):
            return Part("never", name, f"since {_words(name, rows)}")
        case Not(inner):
            return Part("all", text="not so", parts=(_of_formula(inner, rows),))
        case Exists(name, inner):
            return Part(
                "all", text=f"for some {name} since {_words(name, rows)}", parts=(_of_formula(inner, rows),)
            )
        case And(parts):
            return Part("all", text="at once", parts=tuple(_of_formula(each, rows) for each in parts))
        case Or(parts):
            return Part("choice", parts=tuple(_of_formula(each, rows) for each in parts))
        case Until(left, right) | Since(left, right):
            word = "until" if isinstance(formula, Until) else "since"
            both = _of_formula(left, rows), replace(_of_formula(right, rows), joint=word)
            return Part("sequence", text=bounds_of(formula), parts=both)
        case timed:
            return Part("repeat", text=rows.when(timed), parts=(_of_formula(timed.inner, rows),))
