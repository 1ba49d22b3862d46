"""Random patterns, conditions, windows and streams, for the automaton and the enumerator alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hypothesis import strategies as st

from semap.rules import pattern as p
from semap.rules.bound import Asked, Bound, Condition
from semap.rules.declaration import AfterMatch, Windows
from semap.rules.matching.neighbours import Neighbour, Neighbours
from semap.rules.matching.sharing import compile_program
from semap.rules.matching.telling import Emits, Telling
from semap.rules.program import LossyProgram
from semap.rules.row import Row

LETTERS = "abc"


def alone(letters: str) -> Condition:
    return Condition(
        lambda row: str(row.values["type"]) in letters,
        lambda row, _bound: str(row.values["type"]) in letters,
    )


def rising(row: Row, bound: Bound | None) -> bool:
    """The number is greater than that of the row bound before."""
    assert bound is not None
    before = bound.before
    return before is None or row.values["n"] > before.row.values["n"]  # type: ignore[operator]


def at_most_two(_row: Row, bound: Bound | None) -> bool:
    """count(this variable) <= 2"""
    assert bound is not None
    return sum(1 for each in bound.latest_first() if each.variable == bound.variable) <= 2


def as_first(row: Row, bound: Bound | None) -> bool:
    """The type is that of the first row bound."""
    assert bound is not None
    first = list(bound.latest_first())[-1]
    return bool(row.values["type"] == first.row.values["type"])


CHANGED = Neighbours(frozenset({Neighbour("prev", 1, "type")}), begins=True)


def changed(row: Row) -> bool:
    """The type is not that of the row before."""
    return row.values.get("prev 1 type") != row.values["type"]


ITERATIVE = (
    Condition(None, rising, asked=frozenset({Asked("last", None, 0)})),
    Condition(None, at_most_two),
    Condition(None, as_first, asked=frozenset({Asked("first", None, 0)})),
    Condition(changed, lambda row, _bound: changed(row)),
)

variables = st.sampled_from("ABC").map(p.Variable)
joints = st.sampled_from(("next", "relaxed", "any"))


@st.composite
def sequences(draw: st.DrawFn, nodes: st.SearchStrategy[p.Node]) -> p.Node:
    elements = [p.Element("next", draw(nodes))]
    for _ in range(draw(st.integers(1, 2))):
        if draw(st.integers(0, 3)) == 0:
            elements.append(
                p.Element(draw(st.sampled_from(("next", "relaxed"))), p.Absent(draw(st.sampled_from("NM"))))
            )
        elements.append(p.Element(draw(joints), draw(nodes)))
    if draw(st.integers(0, 5)) == 0:
        elements.append(
            p.Element(draw(st.sampled_from(("next", "relaxed"))), p.Absent(draw(st.sampled_from("NM"))))
        )
    return p.Sequence(tuple(elements))


@st.composite
def repeats(draw: st.DrawFn, nodes: st.SearchStrategy[p.Node]) -> p.Node:
    least = draw(st.integers(0, 2))
    most = draw(st.one_of(st.none(), st.integers(max(least, 1), 3)))
    return p.Repeat(
        draw(nodes), least, most, draw(st.booleans()), draw(joints), draw(st.sampled_from((None, None, "U")))
    )


def composed(nodes: st.SearchStrategy[p.Node]) -> st.SearchStrategy[p.Node]:
    return st.one_of(
        sequences(nodes),
        repeats(nodes),
        st.lists(nodes, min_size=2, max_size=3).map(lambda options: p.Alternation(tuple(options))),
        st.builds(p.Permutation, st.lists(nodes, min_size=2, max_size=3).map(tuple), joints),
    )


leaves = st.one_of(
    variables, variables, variables, st.sampled_from((p.Sequence(()), p.Anchor("begin"), p.Anchor("end")))
)
patterns = st.recursive(leaves, composed, max_leaves=5)
simple_condition = st.sampled_from(("a", "b", "ab", "bc", "abc")).map(alone)
one_condition = st.one_of(simple_condition, st.sampled_from(ITERATIVE))


@st.composite
def condition_sets(draw: st.DrawFn) -> dict[str, Condition]:
    kind = simple_condition if draw(st.booleans()) else one_condition
    conditions = {name: draw(kind) for name in "ABCNMU"}
    if draw(st.integers(0, 4)) == 0:
        del conditions[draw(st.sampled_from("ABC"))]
    return conditions


window_sets = st.builds(
    Windows,
    st.one_of(st.none(), st.integers(3, 9)),
    st.one_of(st.none(), st.none(), st.integers(1, 5)),
    st.dictionaries(st.sampled_from("ABCN"), st.integers(1, 5), max_size=1),
)
after_matches = st.one_of(
    st.sampled_from(("none", "to next", "past last")).map(AfterMatch),
    st.builds(
        AfterMatch,
        st.sampled_from(("to first", "to last")),
        st.frozensets(st.sampled_from("ABC"), min_size=1),
    ),
)


@st.composite
def streams(draw: st.DrawFn, most: int = 6) -> list[Row]:
    rows = []
    stamp_us = 0
    for place in range(draw(st.integers(min(3, most), most))):
        stamp_us += draw(st.sampled_from((0, 1, 1, 2, 3)))
        values = {"type": draw(st.sampled_from(LETTERS)), "n": draw(st.integers(0, 3))}
        rows.append(Row(stamp_us, 2, f"{place:04}", "relation", values))
    return [*CHANGED.all_told(rows)]


@dataclass(frozen=True)
class Case:
    node: p.Node
    conditions: Mapping[str, Condition]
    windows: Windows
    after: AfterMatch
    rows: list[Row]
    times_out: bool = True

    def program(self) -> LossyProgram:
        return program_of(self.node, self.conditions, self.windows, self.after, times_out=self.times_out)


def program_of(
    node: p.Node,
    conditions: Mapping[str, Condition],
    windows: Windows,
    after: AfterMatch,
    *,
    times_out: bool = False,
) -> LossyProgram:
    telling = Telling(
        Emits("match", "timeout" if times_out else None, "empty"),
        lambda _bound, _stamp, _whole=None, _number=0: ({}, None),
    )
    return compile_program(node, conditions, windows, after, telling, times_out=times_out)


cases = st.builds(Case, patterns, condition_sets(), window_sets, after_matches, streams(), st.booleans())
remembered_cases = st.builds(
    Case,
    patterns,
    st.fixed_dictionaries(dict.fromkeys("ABCNMU", simple_condition)),
    st.builds(Windows, st.one_of(st.none(), st.integers(3, 9))),
    st.sampled_from(("to next", "past last")).map(AfterMatch),
    streams(),
    st.booleans(),
)
"""Of which the program remembers what steps did."""
