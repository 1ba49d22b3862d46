"""The enumerator against tables worked out by hand, from the definitions of SQL:2016 and of contiguity."""

from __future__ import annotations

import pytest
from rules.enumerator import enumerate_matches

from semap.rules import pattern as p
from semap.rules.bound import Condition
from semap.rules.declaration import AfterMatch, Windows
from semap.rules.row import Row

A, B, C = p.Variable("A"), p.Variable("B"), p.Variable("C")


def alone(letters: str) -> Condition:
    return Condition(None, lambda row, _bound: str(row.values["type"]) in letters)


CONDITIONS = {"A": alone("a"), "B": alone("b"), "C": alone("c"), "X": alone("ab")}


def then(first: p.Node, *rest: tuple[p.Joint, p.Node]) -> p.Node:
    return p.Sequence((p.Element("next", first), *(p.Element(joint, node) for joint, node in rest)))


def lines(
    node: p.Node,
    text: str,
    after: AfterMatch | None = None,
    windows: Windows | None = None,
    *,
    times_out: bool = False,
) -> list[str]:
    """Each match as "A0 B1", with its stamp where that is not its last row's; rows are a second apart."""
    rows = [Row(place, 2, f"{place:02}", "relation", {"type": letter}) for place, letter in enumerate(text)]
    found = enumerate_matches(
        node, CONDITIONS, windows or Windows(), after or NO_SKIP, rows, times_out=times_out
    )
    return [
        " ".join(f"{variable}{place}" for variable, place in each.rows)
        + ("" if each.stamp_us == each.rows[-1][1] else f" @{each.stamp_us}")
        + ("" if each.kind == "match" else f" {each.kind}")
        for each in found
    ]


NO_SKIP = AfterMatch("none")
PAST_LAST = AfterMatch()
SOME_A = p.Repeat(A, 1, None)


@pytest.mark.parametrize(
    ("joint", "wanted"),
    [("next", []), ("relaxed", ["A0 B2"]), ("any", ["A0 B2", "A0 B3"])],
)
def test_contiguity(joint: p.Joint, wanted: list[str]) -> None:
    assert lines(then(A, (joint, B)), "acbb") == wanted


@pytest.mark.parametrize(
    ("joint", "wanted"),
    [
        ("next", ["A0 B2 B3 B4 C5", "A0 B2 B3 C5", "A0 B2 C5"]),
        ("relaxed", ["A0 B2 B3 B4 C5", "A0 B2 B3 C5", "A0 B2 C5"]),
        ("any", ["A0 B2 B3 B4 C5", "A0 B2 B3 C5", "A0 B2 B4 C5", "A0 B2 C5"]),
    ],
)
def test_contiguity_between_rounds(joint: p.Joint, wanted: list[str]) -> None:
    node = then(A, ("relaxed", p.Repeat(B, 1, None, joint=joint)), ("relaxed", C))
    assert lines(node, "acbbbc") == wanted


@pytest.mark.parametrize(
    ("skip", "wanted"),
    [
        (AfterMatch("none"), ["A0 B1", "A0 B1 B2", "A3 B4"]),
        (AfterMatch("to next"), ["A0 B1 B2", "A3 B4"]),
        (AfterMatch("past last"), ["A0 B1 B2", "A3 B4"]),
    ],
)
def test_after_match(skip: AfterMatch, wanted: list[str]) -> None:
    assert lines(then(A, ("next", p.Repeat(B, 1, None))), "abbab", skip) == wanted


@pytest.mark.parametrize(
    ("skip", "wanted"),
    [
        (AfterMatch("past last"), ["X0 X1 X2"]),
        (AfterMatch("to next"), ["X0 X1 X2", "X1 X2 X3", "X2 X3 X4"]),
        (AfterMatch("to last", "X"), ["X0 X1 X2", "X2 X3 X4"]),
        (AfterMatch("to first", "X"), ["X0 X1 X2", "X1 X2 X3", "X2 X3 X4"]),
        (AfterMatch("to last", "B"), ["X0 X1 X2", "X1 X2 X3", "X2 X3 X4"]),
    ],
)
def test_where_the_next_match_begins(skip: AfterMatch, wanted: list[str]) -> None:
    assert lines(p.Repeat(p.Variable("X"), 3, 3), "abbab", skip) == wanted


@pytest.mark.parametrize(
    ("node", "text", "wanted"),
    [
        pytest.param(SOME_A, "aab", ["A0 A1"], id="greedy"),
        pytest.param(p.Repeat(A, 1, None, greedy=False), "aab", ["A0", "A1"], id="reluctant"),
        pytest.param(p.Alternation((B, p.Variable("X"))), "ab", ["X0", "B1"], id="earlier option"),
        pytest.param(
            p.Alternation((A, then(A, ("next", B)))), "ab", ["A0"], id="earlier option, though shorter"
        ),
        pytest.param(p.Alternation((then(A, ("next", B)), A)), "ab", ["A0 B1"], id="earlier option, longer"),
        pytest.param(
            then(p.Repeat(p.Variable("X"), 0, None), ("next", B)), "abb", ["X0 X1 B2"], id="gives back"
        ),
        pytest.param(p.Permutation((A, B, p.Variable("X"))), "aba", ["A0 B1 X2"], id="the order written"),
        pytest.param(p.Permutation((A, B, C)), "cab", ["C0 A1 B2"], id="any order"),
        pytest.param(
            then(A, ("relaxed", p.Repeat(B, 0, 1))), "acb", ["A0"], id="ended beats passing over a row"
        ),
        pytest.param(
            then(A, ("relaxed", p.Repeat(B, 0, 1))), "ab", ["A0 B1"], id="taking beats having ended"
        ),
    ],
)
def test_preference(node: p.Node, text: str, wanted: list[str]) -> None:
    assert lines(node, text, PAST_LAST) == wanted


@pytest.mark.parametrize(
    ("joint", "then_joint", "text", "wanted"),
    [
        ("relaxed", "relaxed", "accb", []),
        ("relaxed", "relaxed", "aab", ["A0 B2", "A1 B2"]),
        ("relaxed", "relaxed", "acb", []),
        ("next", "relaxed", "aacb", ["A0 B3"]),
        ("next", "next", "ab", ["A0 B1"]),
    ],
)
def test_absence_between(joint: p.Joint, then_joint: p.Joint, text: str, wanted: list[str]) -> None:
    assert lines(then(A, (joint, p.Absent("C")), (then_joint, B)), text) == wanted


@pytest.mark.parametrize(
    ("windows", "wanted"),
    [
        (Windows(3), ["A3 @6"]),
        (Windows(2), ["A0 @2", "A3 @5"]),
        (Windows(9, variables={"B": 3}), ["A3 @6"]),
        (Windows(9, variables={"B": 2}), ["A0 @2", "A3 @5"]),
    ],
)
def test_absence_at_the_end(windows: Windows, wanted: list[str]) -> None:
    assert lines(then(A, ("relaxed", p.Absent("B"))), "acba", None, windows) == wanted


@pytest.mark.parametrize(
    ("windows", "wanted"),
    [
        (Windows(3), ["A0 C2"]),
        (Windows(2), []),
        (Windows(9, step_us=2), []),
        (Windows(9, step_us=3), ["A0 C2"]),
        (Windows(9, variables={"C": 2}), []),
        (Windows(9, variables={"A": 1}), ["A0 C2"]),
    ],
)
def test_windows_are_exclusive(windows: Windows, wanted: list[str]) -> None:
    assert lines(then(A, ("relaxed", C)), "abc", None, windows) == wanted


def test_until_ends_the_rounds_and_what_lies_between_them() -> None:
    node = then(p.Repeat(A, 1, None, joint="relaxed", until="B"), ("relaxed", C))
    assert lines(node, "aabac", AfterMatch("to next")) == ["A0 A1 C4", "A1 C4", "A3 C4"]


@pytest.mark.parametrize(
    ("node", "text", "windows", "wanted"),
    [
        pytest.param(then(A, ("relaxed", B)), "ac", Windows(5), ["A0 @5 timeout"], id="match window"),
        pytest.param(
            then(A, ("relaxed", B)), "ac", Windows(9, step_us=3), ["A0 @3 timeout"], id="smaller window"
        ),
        pytest.param(then(A, ("next", B)), "ac", Windows(5), [], id="ended by a row"),
        pytest.param(then(A, ("relaxed", B)), "ab", Windows(5), ["A0 B1"], id="matched"),
        pytest.param(
            then(A, ("relaxed", B), ("relaxed", C)),
            "abb",
            Windows(5),
            ["A0 B1 @5 timeout"],
            id="most rows, preferred",
        ),
        pytest.param(then(A, ("relaxed", B)), "ac", Windows(), [], id="no window"),
    ],
)
def test_timing_out(node: p.Node, text: str, windows: Windows, wanted: list[str]) -> None:
    assert lines(node, text, PAST_LAST, windows, times_out=True) == wanted
