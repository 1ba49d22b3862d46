"""Whatever the text is, it becomes a declaration or is refused with a place within it."""

from __future__ import annotations

import random
import re

from corpus import ACCEPTED, CONCEPTS, REFUSED
from hypothesis import example, given, settings
from hypothesis import strategies as st

from semap.cql2 import check, parse
from semap.errors import InvalidInput
from semap.model.continuous_query import Declaration
from semap.query_text import declaration_of
from semap.query_text.condition import KINDS

WORDS = sorted({
    word for text in [each.sql for each in ACCEPTED] + [sql for _, sql, _ in REFUSED if len(sql) < 1000]
    for word in re.findall(r"\w+|'[^']*'|[^\w\s]+", text)
})  # fmt: skip


def survives(sql: str) -> bool:
    """Whether it is understood; fails for whatever is neither that nor a refusal."""
    made = declared(sql)
    if isinstance(made, InvalidInput):
        assert made.remedy, str(made)
        assert str(made).strip()
        if made.where:
            line, column = map(int, re.findall(r"\d+", made.where))
            lines = sql.split("\n")
            assert 1 <= line <= len(lines)
            assert 1 <= column <= len(lines[line - 1]) + 1
        return False
    for side in (made.subject, made.object):
        if side.where is not None:
            check(parse(side.where), KINDS[side.kind])
    return True


def declared(sql: str) -> Declaration | InvalidInput:
    try:
        return declaration_of("q", sql, CONCEPTS)
    except InvalidInput as refused:
        return refused


@settings(max_examples=400)
@given(
    st.text(max_size=60) | st.binary(max_size=60).map(lambda each: each.decode("utf-8", "surrogateescape"))
)
@example("select " + "(" * 19_000)
@example("select " + "-" * 19_000 + "1")
@example("select 1" + "+1" * 9_000)
@example("select " + "a." * 9_000 + "b from track t, room r")
@example("select 1 from " + "track," * 3_000 + "room")
@example("select 1 from track t, room r where " + "r.name = 'x' or " * 1_100 + "true")
@example("select 1 from track t, room r where r.attributes" + "->'a'" * 3_000 + " is null")
@example("select 1 from track t, room r where r.attributes @> '" + '{"a":' * 3_000 + "1" + "}" * 3_000 + "'")
@example("select 1 from track t, room r where r.name like '" + "%_" * 9_000 + "'")
@example("select 1 from " + "lateral (select * from " * 700 + "room" + ") a" * 700)
@example("select 1 from " + "(" * 2_000 + "track" + " join room on true)" * 1_000)
def test_any_text(sql: str) -> None:
    survives(sql)


@settings(max_examples=1500)
@given(st.lists(st.sampled_from(WORDS), max_size=30).map(" ".join))
def test_words_of_sql_in_any_order(words: str) -> None:
    survives(words)
    survives(f"select t.name, r.name from track t, room r where {words}")


@settings(max_examples=1500)
@given(st.integers(0, len(ACCEPTED) - 1), st.integers(0, 2**32))
def test_texts_with_something_changed(which: int, seed: int) -> None:
    """Words of a good text left out, doubled, put elsewhere, or others instead."""
    chance = random.Random(seed)
    words = re.findall(r"\w+|'[^']*'|[^\w\s]+|\s+", ACCEPTED[which].sql)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(words))
        match chance.randrange(4):
            case 0:
                words[at] = ""
            case 1:
                words.insert(at, f" {chance.choice(WORDS)} ")
            case 2:
                words[at] = chance.choice(WORDS)
            case _:
                other = chance.randrange(len(words))
                words[at], words[other] = words[other], words[at]
    survives("".join(words))


CONDITIONS = st.recursive(
    st.sampled_from([
        "ST_Contains(r.footprint, t.position)", "r.name = 'x'", "t.name <> 'y'", "is_in(t, r)", "true",
        "ST_Distance(t.position, r.footprint) < 2", "t.speed_mps > 1", "t.name = r.name", "now() > t.stamp",
    ]),
    lambda inner: inner.map(lambda each: f"not ({each})")
    | st.tuples(inner, st.sampled_from(["and", "or", "=", "is distinct from"]), inner).map(
        lambda three: f"({' '.join(three)})"
    ),
    max_leaves=8,
)  # fmt: skip


@settings(max_examples=500)
@given(CONDITIONS)
def test_a_relation_is_kept_only_where_it_stands_by_itself(condition: str) -> None:
    """A text is understood only if it is a conjunction in which one relation stands once."""
    understood = survives(f"select t.name, r.name from track t, room r where {condition}")
    relations = len(re.findall(r"ST_|is_in", condition))
    if understood:
        assert relations == 1
        assert not re.search(r"speed|now|distinct|t\.name = r", condition)
