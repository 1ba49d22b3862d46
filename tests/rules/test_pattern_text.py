"""The text of patterns: each form says what it should, every pattern has a text, and mistakes are placed."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semap.errors import InvalidInput
from semap.rules.declaration import IntervalPattern, RowPattern
from semap.rules.interval.allen import INTERSECTS, RELATIONS
from semap.rules.language import pattern_text
from semap.rules.language.words import RESERVED, is_relation
from semap.rules.pattern import (
    Absent,
    Alternation,
    Element,
    Joint,
    Node,
    Permutation,
    Repeat,
    Sequence,
    Variable,
)

A, B, C = Variable("A"), Variable("B"), Variable("C")


def row(*parts: Node | Joint) -> Sequence:
    """A sequence as it is written: a node, a joint, a node, ..."""
    joints = ["next", *parts[1::2]]
    return Sequence(tuple(Element(j, n) for j, n in zip(joints, parts[::2], strict=True)))  # type: ignore[arg-type]


SAID = {
    "A": A,
    "((A))": A,
    "A B": row(A, "next", B),
    "A next B": row(A, "next", B),
    "A followed by B": row(A, "relaxed", B),
    "A\n  followed  by any B": row(A, "any", B),
    "A not next N B": row(A, "next", Absent("N"), "next", B),
    "A not next N followed by B": row(A, "next", Absent("N"), "relaxed", B),
    "A not followed by N": row(A, "relaxed", Absent("N")),
    "A not followed by N not followed by M followed by any B": row(
        A, "relaxed", Absent("N"), "relaxed", Absent("M"), "any", B
    ),
    "A? B*": row(Repeat(A, 0, 1), "next", Repeat(B, 0, None)),
    "A+?": Repeat(A, 1, None, greedy=False),
    "A??": Repeat(A, 0, 1, greedy=False),
    "A{2}": Repeat(A, 2, 2),
    "A{2,}": Repeat(A, 2, None),
    "A{2,5}": Repeat(A, 2, 5),
    "A{,5}": Repeat(A, 0, 5),
    "A{0,5}": Repeat(A, 0, 5),
    "A { 2 , 5 } ?": Repeat(A, 2, 5, greedy=False),
    "A+ relaxed": Repeat(A, 1, None, joint="relaxed"),
    "A+ any until U": Repeat(A, 1, None, joint="any", until="U"),
    "A+? relaxed until U followed by B": row(
        Repeat(A, 1, None, greedy=False, joint="relaxed", until="U"), "relaxed", B
    ),
    "A | B C | A": Alternation((A, row(B, "next", C), A)),
    "A (B | C)": row(A, "next", Alternation((B, C))),
    "A | (B | C)": Alternation((A, Alternation((B, C)))),
    "(A B) C": row(row(A, "next", B), "next", C),
    "(A B)+ followed by C": row(Repeat(row(A, "next", B), 1, None), "relaxed", C),
    "(A?)*": Repeat(Repeat(A, 0, 1), 0, None),
    "permute(A, B | C, A B)": Permutation((A, Alternation((B, C)), row(A, "next", B))),
    "permute(A, B) relaxed": Permutation((A, B), "relaxed"),
    "permute(A, B) any{2}": Repeat(Permutation((A, B), "any"), 2, 2),
    "(permute(A, B))+ relaxed": Repeat(Permutation((A, B)), 1, None, joint="relaxed"),
    "Next followed by BY": row(Variable("Next"), "relaxed", Variable("BY")),
}


@pytest.mark.parametrize(("text", "node"), SAID.items())
def test_each_form_says_what_it_should(text: str, node: Node) -> None:
    assert pattern_text.read(text) == RowPattern(node)


names = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,3}", fullmatch=True).filter(
    lambda name: name not in RESERVED and not is_relation(name)
)
joints = st.sampled_from(["next", "relaxed", "any"])


def larger(inner: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    element = st.builds(Element, joints, inner) | st.builds(
        Element, st.sampled_from(["next", "relaxed"]), st.builds(Absent, names)
    )
    sequence = st.builds(
        lambda first, others: Sequence((Element("next", first), *others)),
        inner,
        st.lists(element, min_size=1, max_size=3),
    )
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    counts = st.tuples(st.integers(0, 4), st.none() | st.integers(1, 5)).filter(
        lambda pair: pair[1] is None or pair[0] <= pair[1]
    )
    repeat = st.builds(
        lambda node, pair, *others: Repeat(node, *pair, *others),
        inner,
        counts,
        st.booleans(),
        joints,
        st.none() | names,
    )
    return (
        sequence
        | several.map(Alternation)
        | st.builds(Permutation, several, joints)
        | st.builds(Permutation, inner.map(lambda node: (node,)), joints)
        | repeat
    )


nodes = st.recursive(st.builds(Variable, names), larger, max_leaves=8)


def written_out(node: Node) -> int:
    """The positions of the pattern with its counts written out (a permutation has 2^(n-1) of each node's)."""
    match node:
        case Variable() | Absent():
            return 1
        case Sequence(elements):
            return sum(written_out(element.node) for element in elements)
        case Alternation(options):
            return sum(written_out(option) for option in options)
        case Permutation(parts):
            return sum(written_out(part) for part in parts) * 2 ** (len(parts) - 1)
        case Repeat():
            return written_out(node.node) * max(node.least, node.most or 1)


@settings(max_examples=300)
@given(nodes)
def test_what_is_written_is_read_as_the_same(node: Node) -> None:
    text = pattern_text.write(node)
    if written_out(node) > 300:
        with pytest.raises(InvalidInput, match="more than 300 positions"):
            pattern_text.read(text)
    else:
        assert pattern_text.read(text) == RowPattern(node)


WORDS = [*"AB(),|?*+U", "next", "followed", "by", "any", "not", "permute", "{2,3}", "{,2}", "until"]


@settings(max_examples=300)
@given(st.lists(st.sampled_from(WORDS)))
def test_any_words_are_a_pattern_or_refused_at_their_place(words: list[str]) -> None:
    text = " ".join(words)
    wrong = None
    try:
        found = pattern_text.read(text, "pattern")
    except InvalidInput as error:
        wrong = error
    if wrong:
        assert 1 <= int(wrong.where.removeprefix("pattern, line 1, character ")) <= len(text) + 1
        assert wrong.remedy
    else:
        assert isinstance(found, RowPattern)
        assert pattern_text.read(pattern_text.write(found.node)) == found


@pytest.mark.parametrize(
    ("text", "relations"),
    [
        ("P during D", {"during"}),
        ("P DURING D", {"during"}),
        ("P metby | startedBy D", {"metBy", "startedBy"}),
        ("P intersects D", INTERSECTS),
        ("P intersects|before D", INTERSECTS | {"before"}),
        ("P " + "|".join(RELATIONS) + " D", RELATIONS),
    ],
)
def test_a_relation_between_two_names_is_a_pattern_of_intervals(text: str, relations: set[str]) -> None:
    found = pattern_text.read(text)
    assert found == IntervalPattern("P", frozenset(relations), "D")
    assert pattern_text.read(pattern_text.write_intervals(found)) == found


@pytest.mark.parametrize(
    ("text", "character", "message"),
    [
        ("", 1, "a variable is missing"),
        ("A followed B", 12, "by is missing"),
        ("A not B", 7, "followed is missing"),
        ("A followed by", 14, "a variable is missing"),
        ("not next A", 1, "nothing stands before it"),
        ("A (not next B)", 4, "nothing stands before it"),
        ("A not next (B)", 12, "a variable is missing"),
        ("(A B", 5, ") is missing"),
        ("A B)", 4, "')' is left over"),
        ("A, B", 2, "',' is left over"),
        ("A++", 3, "a quantifier after a quantifier"),
        ("A{2}{3}", 5, "a quantifier after a quantifier"),
        ("A{0}", 2, "a quantifier of no rounds"),
        ("A{3,2}", 2, "a quantifier of no rounds"),
        ("A{}", 2, "a quantifier of no rounds"),
        ("A{1.5}", 3, "1.5 is no count"),
        ("A{2", 4, "} is missing"),
        ("A B; C", 4, "';' means nothing here"),
        ("A stamp", 3, "the word stamp means something already"),
        ("A eventually", 3, "the word eventually means something already"),
        ("A match", 3, "the word match means something already"),
        ("A until B", 3, "a variable is missing"),
        ("permute()", 9, "a variable is missing"),
        ("(" * 99 + "A", 41, "more than 40 levels"),
        ("A{301}", 1, "more than 300 positions"),
        ("((A{999999}){999999}){999999}", 1, "more than 300 positions"),
        ("P during", 9, "a variable is missing"),
        ("during D", 1, "the word during means something already"),
        ("P during D E", 12, "'E' is left over"),
        ("P E during D", 3, "a relation of two intervals is missing"),
        ("P during P", 1, "P stands on both sides"),
    ],
)
def test_a_mistake_is_refused_where_it_is(text: str, character: int, message: str) -> None:
    with pytest.raises(InvalidInput) as wrong:
        pattern_text.read(text, "pattern")
    assert str(wrong.value).startswith(f"pattern, line 1, character {character}: {message}")
    assert wrong.value.remedy


def test_lines_are_counted() -> None:
    with pytest.raises(InvalidInput) as wrong:
        pattern_text.read("A\n  followed B", "pattern")
    assert wrong.value.where == "pattern, line 2, character 12"


@pytest.mark.parametrize("value", [None, 3, ["A"], "A " * 3000])
def test_a_pattern_is_a_text_of_some_length(value: object) -> None:
    with pytest.raises(InvalidInput):
        pattern_text.read(value)
