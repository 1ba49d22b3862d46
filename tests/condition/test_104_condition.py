"""Conditions of continuous queries: compiled, they mean what CQL2 in memory means, and so do filters of REST."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from server import ask_in_parallel, fresh_database
from sqlalchemy import Connection, literal_column, null, select, text

from semap.cql2 import Call, check, parse
from semap.cql2.check import TEMPORAL
from semap.cql2.evaluate import Subject, compile_expression, compile_filter
from semap.cql2.logic import code
from semap.cql2.text import DEEPEST
from semap.errors import InvalidInput
from semap.store.conditions import ASKED_OF, compiled, keep_condition
from semap.store.cql2_sql import Thing, condition
from semap.store.database import connect, one_transaction

KINDS = ASKED_OF["track"]
NAMES = [
    "name",
    "source",
    "attributes",
    "attributes.x",
    "attributes.y",
    "attributes.z",
    "attributes.x.y",
    "attributes.x.0",
    "attributes.y.-1",
]
SUBJECT = Subject(
    kinds=KINDS,
    parameters="thing",
    property_of=lambda name: code(f"thing.get({name!r})"),
    is_a=lambda _: code("None"),
)
FILTERED = Thing(
    KINDS, {name: literal_column(f"t.{name}") for name in ("name", "source", "attributes")}, lambda _: null()
)
WORDS = ["oak", "Öak", "thing 1", "thing_1", "10%", "a\\b", "ÉCOLE", "école", "it's", "", "x\ny", "1"]
NUMBERS = [-2, 0, 1, 2.5, 4, 9007199254740993, 9007199254740992, 1e200, -1e200, 1e-200, 5e-324, 1.69e308]
TIMES = [
    "2026-02-01",
    "2026-02-02T12:00:00.5+01:00",
    "2026-02-02T11:00:00.500000Z",
    "2024-02-29T00:00:00Z",
    "2026-03-01",
]
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.sampled_from([*WORDS, *NUMBERS, *TIMES, "2026-02-30", 10**400])),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.sampled_from(["x", "y", "0"]), inner, max_size=2)
    ),
    max_leaves=5,
)
VALUES = st.fixed_dictionaries(
    {
        "name": st.one_of(st.none(), st.sampled_from([*WORDS, *TIMES])),
        "source": st.one_of(st.none(), st.sampled_from([*WORDS, *TIMES])),
        "attributes": st.dictionaries(st.sampled_from(["x", "y", "z"]), JSON, max_size=3),
    }
)


def call(ops: str | Sequence[str], *args: st.SearchStrategy) -> st.SearchStrategy:
    op = st.just(ops) if isinstance(ops, str) else st.sampled_from(ops)
    return st.builds(lambda op, *args: {"op": op, "args": list(args)}, op, *args)


PROPERTIES = st.sampled_from(NAMES).map(lambda name: {"property": name})
REALS = st.recursive(
    st.one_of(PROPERTIES, st.sampled_from(NUMBERS)),
    lambda inner: call(["+", "-", "*", "/", "div", "%", "^", "DIV"], inner, inner),
    max_leaves=3,
)
TEXTS = st.recursive(
    st.one_of(PROPERTIES, st.sampled_from(WORDS)),
    lambda inner: call(["casei", "accenti", "CASEI"], inner),
    max_leaves=2,
)
PATTERNS = st.recursive(
    st.sampled_from(
        ["%", "thing _", "thing\\_1", "%A%", "É%", "10\\%", "a\\\\b", "", "_", "x%y", "\\o%", "\\"]
    ),
    lambda inner: call(["casei", "accenti"], inner),
    max_leaves=2,
)
MOMENTS = st.sampled_from(TIMES).map(lambda text: {"date" if len(text) == 10 else "timestamp": text})
INSTANTS = st.one_of(PROPERTIES, MOMENTS)
ENDS = st.one_of(st.just(".."), INSTANTS, st.sampled_from(TIMES))
SPANS = st.one_of(INSTANTS, st.tuples(ENDS, ENDS).map(lambda ends: {"interval": list(ends)}))
ITEMS = st.one_of(PROPERTIES, st.sampled_from(["oak", "1", 1, 0, True, False, 4.5]))
ORDERINGS = ["=", "<>", "<", "<=", ">", ">="]
KINDS_OF_PARTS = (REALS, TEXTS, INSTANTS, PROPERTIES)
CONDITIONS = st.recursive(
    st.one_of(
        *(call(ORDERINGS, each, each) for each in KINDS_OF_PARTS),
        *(call("between", each, each, each) for each in KINDS_OF_PARTS),
        *(call("in", each, st.lists(each, max_size=3)) for each in KINDS_OF_PARTS),
        call("in", PROPERTIES, st.lists(ITEMS, max_size=3)),
        call("like", TEXTS, PATTERNS),
        *(call("isNull", each) for each in KINDS_OF_PARTS),
        call([*TEMPORAL, "T_AFTER"], SPANS, SPANS),
        PROPERTIES,
    ),
    lambda inner: st.one_of(
        call(["and", "or", "And"], inner, inner),
        call(["and", "or"], inner, inner, inner),
        call(["not", "isNull"], inner),
        call(["=", "<>"], inner, inner),
        call("in", inner, st.lists(inner, max_size=2)),
    ),
    max_leaves=5,
)


@pytest.fixture(scope="module")
def postgis(cluster, template) -> Iterator[Connection]:
    with fresh_database(cluster, template) as dsn, one_transaction(dsn) as connection:
        yield connection


@pytest.fixture(scope="module")
def map_id(postgis: Connection) -> int:
    made = text("insert into semap.map (name, uid) values ('office', gen_random_uuid()) returning map_id")
    return postgis.execute(made).scalar_one()


def as_values(values: Mapping[str, object]) -> dict[str, object]:
    return {**values, "attributes": json.dumps(values["attributes"])}


def in_a_trigger(
    connection: Connection, map_id: int, document: Mapping[str, object], values: Mapping[str, object]
) -> tuple[bool | None, bool]:
    """Whether what was compiled is true, false or unknown, and whether it holds."""
    keep_condition(connection, map_id, "track", document)
    asked = {**as_values(values), "condition": json.dumps(document)}
    kept = "from semap.condition c where c.condition = cast(:condition as jsonb)"
    number = connection.execute(text(f"select c.condition_id {kept}"), asked).scalar_one()
    parts = ":name, :source, cast(:attributes as jsonb)"
    found = connection.execute(
        text(
            f"select semap.condition_{number}({parts}, c.said),"
            f" semap.condition_holds(c.condition_id, c.said, {parts}) {kept}"
        ),
        asked,
    ).one()
    return found[0], found[1]


def in_a_filter(
    connection: Connection, document: Mapping[str, object], values: Mapping[str, object]
) -> bool | None:
    thing = text(
        "select cast(:name as text) as name, cast(:source as text) as source,"
        " cast(:attributes as jsonb) as attributes"
    )
    rows = thing.bindparams(**as_values(values)).columns().subquery("t")
    return connection.scalar(select(condition(parse(document), FILTERED)).select_from(rows))


def is_filter(document: object) -> bool:
    try:
        check(parse(document), KINDS)
    except InvalidInput:
        return False
    return True


def x(value: object) -> dict[str, object]:
    return {"name": "a", "source": "b", "attributes": {"x": value}}


AT_X = {"property": "attributes.x"}


@settings(max_examples=600, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=CONDITIONS, values=VALUES)
@example({"op": "=", "args": [AT_X, 9007199254740992]}, x(9007199254740993))
@example(
    {"op": "=", "args": [AT_X, {"property": "attributes.y"}]},
    {**x(0), "attributes": {"x": 2**53 + 1, "y": 2**53}},
)
@example(
    {"op": "<", "args": [AT_X, {"property": "attributes.y"}]}, {**x(0), "attributes": {"x": 1, "y": 10**400}}
)
@example({"op": "in", "args": [{"property": "attributes.z"}, []]}, x(1))
@example({"op": "in", "args": [AT_X, ["oak", 1, True, {"date": "2026-02-01"}]]}, x("2026-02-01"))
@example(
    {"op": "a_contains", "args": [AT_X, [{"timestamp": "2026-02-01T00:00:00Z"}]]},
    x(["2026-02-01T00:00:00.000000Z"]),
)
@example({"op": ">", "args": [{"op": "*", "args": [AT_X, 1e200]}, 0]}, x(1e200))
@example({"op": "=", "args": [{"op": "/", "args": [AT_X, 1e200]}, 0]}, x(1e-200))
@example(
    {"op": "like", "args": [{"op": "casei", "args": [AT_X]}, {"op": "casei", "args": ["%'; --\\%%"]}]},
    x("'; --%"),
)
def test_a_condition_means_what_cql2_in_memory_means(
    postgis: Connection, map_id: int, document: dict, values: dict
) -> None:  # fmt: skip
    if not is_filter(document):
        with pytest.raises(InvalidInput):
            compiled(document, "track")
        return
    expression = parse(document)
    twice = Call("and", (expression, expression))  # what is of the kind any is true, false or unknown
    known = compile_expression(twice, SUBJECT)(values)
    holds = compile_filter(expression, SUBJECT)(values)
    with postgis.begin_nested() as kept:
        found = in_a_trigger(postgis, map_id, document, values)
        kept.rollback()
    assert found == (known, holds)
    assert in_a_filter(postgis, document, values) is known


@pytest.mark.parametrize("a", [0, 1, -1, -2, 2.5, 1e154, -1e200, 1.69e308, -1.69e308, 9e307, 1e-160, 5e-324])
def test_arithmetic_of_any_size_gives_a_number_or_nothing(postgis: Connection, a: float) -> None:
    """It never fails, since it runs in triggers."""
    sizes = [0, 1, -1, -2, 2.5, 1e154, -1e200, 1.69e308, -1.69e308, 9e307, 1e-160, 5e-324, -3e-310, 1e17]
    for op in ("+", "-", "*", "/", "div", "%", "^"):
        for b in sizes:
            expected = compile_expression(parse({"op": op, "args": [a, b]}), SUBJECT)({})
            found = postgis.scalar(
                text("select semap.real_arithmetic(:op, :a, :b)"), {"op": op, "a": float(a), "b": float(b)}
            )
            assert found == expected, (a, op, b)


@pytest.mark.parametrize("size", ["1e-400", "-1e-400", "1e-310", "1e400", "1e130000"])
def test_a_number_that_no_float_holds_does_no_harm(postgis: Connection, map_id: int, size: str) -> None:
    document = {"op": "<", "args": [{"op": "+", "args": [AT_X, 0]}, 1]}
    made = compiled(document, "track").sql
    asked = made.replace("p_attributes", f"jsonb_build_object('x', {size}::numeric)")
    for n, said in enumerate(compiled(document, "track").said, 1):
        asked = asked.replace(f"p_said[{n}]", f"'{said}'")
    assert postgis.scalar(text(f"select {asked}")) is (None if float(size) > 1 else True)


@pytest.mark.parametrize(
    ("document", "message", "hint"),
    [
        ({"op": "s_within", "args": [AT_X, AT_X]}, "where: a condition cannot ask for s_within", "predicate of the query"),
        ({"op": "=", "args": [{"property": "name"}, {"bbox": [0, 0, 1, 1]}]}, "= of a shape and a text", "like with like"),
        ({"op": "not", "args": [{"op": "isA", "args": ["Room"]}]}, "where.args[0]: a condition cannot ask for isA", "its side"),
        ({"op": "=", "args": [{"property": "nme"}, 1]}, "where.args[0]: there is no property nme", "There are name, source"),
        ({"op": "=", "args": [{"property": "name"}]}, "= of 1 parts", "Give it 2."),
        ({"op": "=", "args": [{"property": "name"}, 1]}, "= of a number and a text", "like with like"),
        ({"op": "<", "args": [True, AT_X]}, "< of a boolean", "Use it for number, text, instant."),
        ({"op": "=", "args": [{"property": "name"}, None]}, "a comparison with null is never true", "isNull"),
        ({"op": "in", "args": [{"property": "name"}, [[1]]]}, "where.args[1][0]: a list of other things", "Leave"),
        ({"op": "+", "args": [1, 2]}, "where: it is neither true nor false", "Compare it"),
        ({"op": "=", "args": [AT_X, {"timestamp": "2026-02-30T00:00:00Z"}]}, "2026-02-30T00:00:00Z is no time", "Write 2026-01-31"),
        ({"op": "=", "args": [AT_X, 10**400]}, "too large for a float", "Give a number"),
        ({"op": "in", "args": [{"property": "name"}, ["x" * 100] * 1000]}, "more than 100000 characters", "Ask for less"),
    ],
)  # fmt: skip
def test_what_is_refused_is_told_with_its_place(document: dict, message: str, hint: str) -> None:
    with pytest.raises(InvalidInput) as told:
        compiled(document, "track")
    assert message in str(told.value)
    assert hint in told.value.remedy


def nested(levels: int) -> dict:
    document: dict = AT_X
    for _ in range(levels):
        document = {"op": "not", "args": [document]}
    return document


def test_the_deepest_and_the_widest_are_asked(postgis: Connection, map_id: int) -> None:
    assert in_a_trigger(postgis, map_id, nested(DEEPEST), x(True)) == (True, True)
    assert not is_filter(nested(DEEPEST + 1))
    wide = {"op": "in", "args": [AT_X, [*range(1900), "oak"]]}
    assert in_a_trigger(postgis, map_id, wide, x("oak")) == (True, True)
    assert in_a_trigger(postgis, map_id, wide, x("elm")) == (None, False)


@settings(max_examples=200, deadline=None)
@given(
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1),
    st.floats(-1e300, 1e300),
)
def test_nothing_that_is_said_is_in_the_sql(word: str, number: float) -> None:
    """So that no way of quoting has to be right."""

    def sql(word: str, number: float, stamp: str) -> str:
        document = {"op": "and", "args": [
            {"op": "like", "args": [{"property": f"attributes.{word}"}, word.replace("\\", "")]},
            {"op": "in", "args": [AT_X, [word, number, {"timestamp": stamp}]]},
        ]}  # fmt: skip
        return compiled(document, "instance").sql

    plain = sql(".".join("a" for _ in word.split(".")), 1, "2026-01-31T12:00:00Z")
    assert sql(word, number, "2027-02-28T13:14:15.5+01:00") == plain


def test_conditions_are_asked_in_parallel_plans(cluster, template) -> None:
    """What is said to be safe there runs there, instants and arithmetic, too."""
    document = {"op": "and", "args": [
        {"op": "t_after", "args": [{"property": "attributes.seen"}, {"date": "2026-01-01"}]},
        {"op": "=", "args": [{"op": "*", "args": [{"property": "attributes.size"}, 1e300]}, 1e300]},
    ]}  # fmt: skip
    with fresh_database(cluster, template) as dsn:
        with one_transaction(dsn) as made:
            map_id = made.scalar(
                text("insert into semap.map (name, uid) values ('a', gen_random_uuid()) returning map_id")
            )
            keep_condition(made, map_id, "track", document)
        with connect(dsn) as connection, connection.transaction():
            connection.execute(
                "create table public.thing as"
                " select n, jsonb_build_object('seen', '2026-02-01', 'size', n) as a from generate_series(1, 5) n"
            )
            ask_in_parallel(connection)
            found = connection.execute(
                "select array_agg(n order by n) from public.thing, semap.condition c"
                " where semap.condition_holds(c.condition_id, c.said, null, null, a)"
            )
            assert found.fetchone() == ([1],)
