"""What a stranger may write as a rule: it is read or refused, soon, and with nothing but InvalidInput."""

from __future__ import annotations

import contextlib
import json
import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from semap.cql2.value import like
from semap.errors import InvalidInput
from semap.rules.language.reading import ALL_CLAUSES, parse_declaration, read_declaration

"""Far above what any rule takes, and far below what a bomb takes."""

PATTERN = {"input": "q", "pattern": "A followed by B", "within": "6 s", "emit": "ab"}
WORDS = (
    "A", "B", "q", "door", "map", "room", "track", "attributes.x", "began", "6 s", "1e300", "all", "no skip",
    "skip to last A", "A B+ followed by (C | D)?", "A not followed by N", "permute(A, B)", "P during D",
    "eventually[0 s, 6 s] A", "A until B", "type = 'open'", "count(A) > 1", "last(A.stamp)", "lognormal", "\0",
    "\ud800", "\u0663 s", "A{99999999}", "((((", "S_WITHIN(position, POINT(1 2))", "attributes.a.b like '%a_'",
)  # fmt: skip
KEYS = st.sampled_from([
    *ALL_CLAUSES, "match", "timeout", "holds", "fails", "step", "A", "B", "query", "object_state", "rule", "map",
    "actor_within_m", "gap", "distribution", "median_s", "sigma", "at_least",
])  # fmt: skip
LEAVES = (
    st.sampled_from(WORDS) | st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(KEYS | st.text(max_size=3), inner, max_size=4)
    ),
    max_leaves=8,
)
CLAUSES = st.sampled_from(ALL_CLAUSES)


def read_or_refused(document: object) -> None:
    try:
        declared = parse_declaration(document, "r")
    except InvalidInput as error:
        assert len(str(error)) < 20_000  # noqa: PT017
        return
    stored = json.loads(json.dumps(declared.as_json(), allow_nan=False))
    assert parse_declaration(stored, declared.name) == declared


@settings(max_examples=400)
@given(st.dictionaries(CLAUSES, VALUES, max_size=8))
def test_values_of_any_kind(document: dict) -> None:
    read_or_refused(document)


@settings(max_examples=600)
@example("subset", {"name": [[]]})
@given(CLAUSES, VALUES)
def test_a_good_rule_with_one_bad_clause(clause: str, value: object) -> None:
    read_or_refused({**PATTERN, clause: value})


@given(VALUES | st.binary(max_size=4) | st.dictionaries(st.integers() | st.none(), LEAVES, max_size=2))
def test_no_rule_at_all(document: object) -> None:
    read_or_refused(document)


@settings(max_examples=300)
@given(st.text(alphabet="inputemi: qab[]{}&*!|>%@'\"\\-#,?\n\t\r\0\ud800\u0085\ufeff", max_size=60))
def test_any_text(text: str) -> None:
    with contextlib.suppress(InvalidInput):
        read_declaration(text, "r")


def pattern(text: str, **clauses: object) -> dict:
    return {"input": "q", "emit": "e", "within": "6 s", "pattern": text, **clauses}


NAMES = [f"V{n}" for n in range(300)]
BOMBS = {
    "optional": pattern(" ".join(f"{name}?" for name in NAMES[:299]) + " Z"),
    "rounds": pattern("(" * 35 + "A" + "*)" * 35 + " B"),
    "orders": pattern(f"permute({', '.join(NAMES)})"),
    "orders in orders": pattern("permute(" * 30 + "A, B" + ", C)" * 30),
    "counts": pattern("((A{999999}){999999}){999999}"),
    "parentheses": pattern("(" * 3_900),
    "every condition": pattern(
        " ".join(NAMES),
        define={name: " and ".join(f"count({each}) < 3" for each in NAMES) for name in NAMES},
    ),
    "long number": pattern("A B", within=10**5000),
    "infinite": pattern("A B", within=math.inf),
    "no number": pattern("A B", within={"match": math.nan}),
    "long duration": pattern("A B", within=1e300),
    "many events": {"input": "q", "emit": {f"s{n}": "e" for n in range(100_000)}},
    "long key": {"input": {"object_state": "door"}, "emit": {"x" * 1_000_000: "e"}},
    "long clause": {"x" * 1_000_000: 1},
    "long property": pattern("A", partition_by="attributes." + "x" * 1_000_000),
    "long word": pattern("A", after_match="skip to first " + "X" * 100_000),
    "deep": pattern("A", measures=json.loads('{"a":' * 500 + "1" + "}" * 500)),
    "no character": pattern("A", define={"A": "type = '\0'"}),
    "half a character": pattern("A", measures={"m": "'\ud800'"}),
    "deep condition": pattern("A", define={"A": "not " * 1900 + "true"}),
    "powers": pattern("A", define={"A": "duration_s = 9^9^9^9^9^9"}),
    "bounds": {
        "input": "q", "formula": "eventually[36525 d, 36525 d] " * 38 + "P", "define": {"P": "true"},
        "emit": {"fails": "e"},
    },
}  # fmt: skip
MAY_BE_READ = {"optional", "rounds", "powers", "bounds"}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs(name: str) -> None:
    if name in MAY_BE_READ:
        read_or_refused(BOMBS[name])
    else:
        with pytest.raises(InvalidInput) as refused:
            parse_declaration(BOMBS[name], "r")
        assert len(str(refused.value)) < 1_000


@pytest.mark.parametrize(
    "text", ["input: \ud800", "input: " + "[" * 100_000, "a" * 200_001, "!!python/name:a b"]
)
def test_texts_that_are_none(text: str) -> None:
    with pytest.raises(InvalidInput):
        read_declaration(text, "r")


def test_a_pattern_of_like_takes_no_longer_than_its_length() -> None:
    assert like("%a" * 12 + "%b")("a" * 200) is False
    assert like("%a" * 1000 + "%")("a" * 100_000) is True
    assert like("%" * 8_000)("a" * 100_000) is True


@settings(max_examples=500)
@given(st.text(alphabet="ab%_\\", max_size=8), st.text(alphabet="ab%", max_size=8))
def test_like_is_what_sql_says(pattern: str, text: str) -> None:
    assert like(pattern)(text) is fits(pattern, text)


def fits(pattern: str, text: str) -> bool:
    """By the definition: % is any characters, _ one; a backslash at the end stands for nothing."""
    if not pattern:
        return not text
    if pattern[0] == "%":
        return any(fits(pattern[1:], text[n:]) for n in range(len(text) + 1))
    if pattern[0] == "\\":
        if len(pattern) == 1:
            return not text
        return text[:1] == pattern[1] and fits(pattern[2:], text[1:])
    return bool(text) and pattern[0] in ("_", text[0]) and fits(pattern[1:], text[1:])
