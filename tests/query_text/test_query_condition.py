"""Conditions on one side: the CQL2 that they become is true just where PostgreSQL finds the SQL true."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

import psycopg
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from world import World

from semap.cql2 import parse
from semap.cql2.evaluate import Subject, compile_filter
from semap.cql2.logic import code
from semap.query_text import declaration_of
from semap.query_text.condition import KINDS
from semap.store.database.connection import connect

TEXTS = ["oak", "Oak", "öak", "", "2", "-1.5", "true", "a%b", "null"]
NUMBERS = [0, 2, -1.5, 10, 0.1, 1234567]
KEYS = ("t", "n", "b", "m", "size")
"""Attributes: texts, numbers, truth values, a mixture of all, and an object."""

VALUES = {
    "t": st.sampled_from([*TEXTS, None]),
    "n": st.sampled_from(NUMBERS),  # of null in JSON plain SQL makes no number, and fails
    "b": st.sampled_from([True, False]),
    "m": st.sampled_from([*TEXTS, *NUMBERS, True, False, None, ["oak"], {"u": 1}]),
    "size": st.fixed_dictionaries({}, optional={"u": st.sampled_from(TEXTS), "v": st.sampled_from(NUMBERS)}),
}
ATTRIBUTES = st.fixed_dictionaries({}, optional=VALUES)
COLUMNS = ("r.name", "r.alias", "r.storey")


def quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


TEXT = st.sampled_from(TEXTS).map(quoted)
NUMBER = st.sampled_from(NUMBERS).map(str)
MIXED = st.sampled_from(["r.attributes->>'m'", "r.attributes->'size'->>'u'", "r.attributes->'size'->>'v'",
                         "r.attributes->>'none'", *(f"r.attributes->>'{key}'" for key in ("t", "n", "b"))])  # fmt: skip
FLOAT = st.sampled_from([
    "(r.attributes->>'n')::float", "(r.attributes->'n')::float", "(r.attributes->>'n')::numeric",
    "cast(r.attributes->'size'->>'v' as double precision)",
])  # fmt: skip
TEXT_OF = st.sampled_from([*COLUMNS, "r.attributes->>'t'", "r.attributes->'size'->>'u'"])
BOOLEAN = st.sampled_from(["(r.attributes->>'b')::boolean", "(r.attributes->'b')::boolean"])
PATTERN = st.text(st.sampled_from("oaOk%_ö2"), max_size=4).map(quoted)
ORDER = st.sampled_from(["=", "<>", "<", "<=", ">", ">=", "!="])
NOT = st.sampled_from(["", "not "])


def listed(values: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.lists(values, min_size=1, max_size=3).map(lambda items: f"({', '.join(items)})")


CONTAINED = st.fixed_dictionaries(
    {}, optional={"t": st.sampled_from(TEXTS), "n": st.sampled_from(NUMBERS), "m": st.sampled_from([*TEXTS, *NUMBERS, True]),
                  "size": st.just({"u": "oak"})},
).filter(bool)  # fmt: skip
LEAF = st.one_of(
    st.tuples(MIXED | st.sampled_from(COLUMNS), st.sampled_from(["=", "<>"]), TEXT).map(" ".join),
    st.tuples(TEXT, st.sampled_from(["=", "!="]), MIXED).map(" ".join),
    st.tuples(FLOAT, ORDER, NUMBER).map(" ".join),
    st.tuples(NUMBER, ORDER, FLOAT).map(" ".join),
    st.tuples(st.sampled_from(COLUMNS), st.just('collate "C"'), ORDER, TEXT).map(" ".join),
    st.tuples(TEXT_OF, NOT, st.sampled_from(["like", "ilike"]), PATTERN).map(" ".join),
    st.tuples(MIXED | st.sampled_from(COLUMNS), NOT, st.just("in"), listed(TEXT)).map(" ".join),
    st.tuples(FLOAT, NOT, st.just("in"), listed(NUMBER)).map(" ".join),
    st.tuples(FLOAT, NOT, st.just("between"), NUMBER, st.just("and"), NUMBER).map(" ".join),
    st.tuples(MIXED | FLOAT | st.sampled_from(COLUMNS), st.just("is"), NOT, st.just("null")).map(" ".join),
    st.tuples(BOOLEAN, st.sampled_from(["", "= true", "<> true", "= false"])).map(" ".join),
    st.sampled_from(["r.name = r.alias", "r.name <> r.alias", "semap.is_a(r.concept, 'Room')",
                     "semap.is_a(r.concept, 'Space')", "r.concept = 'Room'", "semap.is_a(r.concept, 'Door')"]),
    CONTAINED.map(lambda value: f"r.attributes @> {quoted(json.dumps(value))}"),
)  # fmt: skip
CONDITION = st.recursive(
    LEAF,
    lambda inner: (
        inner.map(lambda each: f"not ({each})")
        | st.tuples(inner, st.sampled_from(["and", "or"]), inner).map(lambda three: f"({' '.join(three)})")
    ),
    max_leaves=6,
)
THING = st.fixed_dictionaries({
    "name": st.sampled_from([text for text in TEXTS if text]), "alias": st.sampled_from([*TEXTS, None]),
    "attributes": ATTRIBUTES,
})  # fmt: skip

SUBJECT = Subject(
    kinds=KINDS["instance"],
    parameters="thing",
    property_of=lambda name: code(f"thing.get({name!r})"),
    is_a=lambda concept: code(f"{concept!r} in ('Room', 'Space', 'Thing')"),
)


@pytest.fixture
def connection(world: World) -> Iterator[psycopg.Connection]:
    world.add_room("one", shapely.box(0, 0, 1, 1))
    with connect(world.dsn) as found, found.transaction():
        found.execute("set local search_path = semap_query, public")
        yield found


def test_what_postgresql_finds_true_cql2_finds_true(connection: psycopg.Connection) -> None:
    @settings(max_examples=600, suppress_health_check=list(HealthCheck))
    @given(CONDITION, THING)
    def same(condition: str, thing: dict[str, object]) -> None:
        found = filtered(condition)({**thing, "concept": "Room"})
        connection.execute(
            "update semap.instance set name = %s, alias = %s, attributes = %s",
            [thing["name"], thing["alias"], json.dumps(thing["attributes"])],
        )
        (count,) = connection.execute(
            f"select count(*) from room r where {condition}".encode()
        ).fetchone() or (0,)
        assert (count == 1) == found

    same()


ATTRIBUTE = [*TEXTS, *NUMBERS, True, False, None, ["oak"], {"u": 1}, "false", "0.10"]
ASKING = [
    "r.attributes->>'m' {0} {1}",
    "not (r.attributes->>'m' {0} {1})",
    "r.attributes->>'m' {0} {1} or r.attributes->>'m' is null",
]


@pytest.mark.parametrize("operator", ["=", "<>", "in", "not in"])
def test_each_attribute_against_each_text(connection: psycopg.Connection, operator: str) -> None:
    things: list[dict[str, object]] = [{"m": value} for value in ATTRIBUTE] + [{}]
    for text in [*TEXTS, "false", "0.10", "10"]:
        for asking in ASKING:
            other = f"({quoted(text)}, 'elm')" if operator.endswith("in") else quoted(text)
            condition = asking.format(operator, other)
            found = [filtered(condition)({"attributes": each}) for each in things]
            asked = condition.replace("%", "%%")
            rows = connection.execute(
                f"select ({asked}) is true from unnest(%s::jsonb[]) with ordinality r (attributes, n) order by n".encode(),
                [[json.dumps(each) for each in things]],
            ).fetchall()
            # a number counts by its value
            same = [each != {"m": 0.1} or text != "0.10" for each in things]
            assert [each for each, is_same in zip(found, same, strict=True) if is_same] == [
                each for (each,), is_same in zip(rows, same, strict=True) if is_same
            ], condition


def filtered(condition: str) -> Callable[..., bool]:
    """The condition as CQL2, evaluated in memory."""
    text = f"select r.name from track t, room r where ({condition}) and ST_Covers(r.footprint, t.position)"
    declared = declaration_of("q", text, ("Room",)).object
    if declared.where is None:  # a room, and nothing else of it: the side's concept says so
        return lambda thing: thing["concept"] == declared.concept
    return compile_filter(parse(declared.where), SUBJECT)


def test_where_plain_sql_fails_or_casts_cql2_asks_for_the_kind() -> None:
    """The documented differences."""

    def finds(condition: str, attributes: dict[str, object]) -> bool:
        return filtered(condition)({"attributes": attributes})

    assert finds("r.attributes->>'n' = '2'", {"n": 2.0})
    assert not finds("r.attributes->>'n' like '2%'", {"n": 23})
    assert not finds("(r.attributes->>'n')::float > 1", {"n": "2"})
    assert not finds("(r.attributes->>'n')::float > 1", {"n": "oak"})
