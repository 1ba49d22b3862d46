"""Conditions in the database: they take, and mean, what CQL2 in memory takes and means."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

import psycopg
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from server import ask_in_parallel, fresh_database

from semap.cql2 import Call, Kind, check, parse
from semap.cql2.check import TEMPORAL
from semap.cql2.evaluate import Subject, compile_expression, compile_filter
from semap.cql2.logic import code
from semap.errors import InvalidInput
from semap.store.database import connect

KINDS: dict[str, Kind] = dict.fromkeys(("name", "size", "open", "seen", "attributes", "dotted.name"), "any")
NAMES = [
    "name",
    "size",
    "open",
    "seen",
    "attributes",
    "dotted.name",
    "attributes.x",
    "attributes.y",
    "attributes.x.y",
    "attributes.x.0",
    "attributes.y.-1",
    "size.x",
]
SUBJECT = Subject(
    kinds=KINDS,
    parameters="thing",
    property_of=lambda name: code(f"thing.get({name!r})"),
    is_a=lambda _: code("None"),
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
VALUES = st.dictionaries(st.sampled_from(sorted(KINDS)), JSON, max_size=len(KINDS))


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
ANYTHING = st.recursive(
    st.one_of(JSON, *KINDS_OF_PARTS, SPANS, st.just({"bbox": [0, 0, 1, 1]}), st.just({"property": ""})),
    lambda inner: call(
        [*ORDERINGS, "and", "not", "+", "like", "casei", "between", "in", "isNull", "t_after", "isA", "s_within", "x"],
        *[inner] * 2,
    )
    | call(["not", "isNull", "casei", "and"], inner)
    | call(["between", "or", "="], inner, inner, inner)
    | st.lists(inner, max_size=3)
    | st.tuples(inner, inner).map(lambda ends: {"interval": list(ends)}),
    max_leaves=6,
)  # fmt: skip


@pytest.fixture(scope="module")
def postgis(cluster, template) -> Iterator[psycopg.Connection]:
    with fresh_database(cluster, template) as dsn, connect(dsn) as connection:
        yield connection


def ask(connection: psycopg.Connection, statement: str, *parameters: object) -> object:
    found = connection.execute(statement, parameters).fetchone()
    assert found is not None
    return found[0]


def is_taken(connection: psycopg.Connection, document: object) -> bool:
    try:
        connection.execute("select semap.check_condition(%s, %s)", (json.dumps(document), list(KINDS)))
    except psycopg.errors.InvalidParameterValue:
        return False
    return True


def is_filter(document: object) -> bool:
    try:
        check(parse(document), KINDS)
    except InvalidInput:
        return False
    return True


def in_sql(connection: psycopg.Connection, document: object, values: object) -> tuple[bool | None, bool]:
    """Whether it is true, false or unknown, and whether it holds."""
    found = connection.execute(
        "select semap.condition_truth(c, v), semap.condition_holds(c, v) from (values (%s::jsonb, %s::jsonb)) t (c, v)",
        (json.dumps(document), json.dumps(values)),
    ).fetchone()
    assert found is not None
    return found


@settings(max_examples=600, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=CONDITIONS, values=VALUES)
@example({"op": "=", "args": [{"property": "size"}, 9007199254740992]}, {"size": 9007199254740993})
@example(
    {"op": "=", "args": [{"property": "size"}, {"property": "open"}]}, {"size": 2**53 + 1, "open": 2**53}
)
@example({"op": "<", "args": [{"property": "size"}, {"property": "open"}]}, {"size": 1, "open": 10**400})
@example({"op": "in", "args": [{"property": "gone"}, []]}, {})
@example({"op": "=", "args": [{"property": "dotted.name"}, 1]}, {"dotted.name": 1, "dotted": {"name": 2}})
def test_a_condition_holds_where_cql2_in_memory_says_so(
    postgis: psycopg.Connection, document: dict, values: dict
) -> None:
    taken = is_filter(document)
    assert is_taken(postgis, document) is taken
    if taken:
        expression = parse(document)
        twice = Call(
            "and", (expression, expression)
        )  # what is of the kind any becomes true, false or unknown
        known = compile_expression(twice, SUBJECT)(values)
        assert in_sql(postgis, document, values) == (known, compile_filter(expression, SUBJECT)(values))


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=ANYTHING)
def test_what_is_taken_is_a_filter(postgis: psycopg.Connection, document: object) -> None:
    """All other things are refused with a reason; the two agree on what is one."""
    if not isinstance(document, str):  # which would be CQL2 text
        beyond = any(f'"{word}' in json.dumps(document) for word in ("bbox", "s_within", "isA"))
        assert is_taken(postgis, document) is (is_filter(document) and not beyond)


@pytest.mark.parametrize("a", [0, 1, -1, -2, 2.5, 1e154, -1e200, 1.69e308, -1.69e308, 9e307, 1e-160, 5e-324])
def test_arithmetic_of_any_size_gives_a_number_or_nothing(postgis: psycopg.Connection, a: float) -> None:
    """It never fails, since it runs in triggers."""
    sizes = [0, 1, -1, -2, 2.5, 1e154, -1e200, 1.69e308, -1.69e308, 9e307, 1e-160, 5e-324, -3e-310, 1e17]
    for op in ("+", "-", "*", "/", "div", "%", "^"):
        for b in sizes:
            expression = parse({"op": op, "args": [a, b]})
            expected = compile_expression(expression, SUBJECT)({})
            assert ask(postgis, "select semap.real_arithmetic(%s, %s, %s)", op, a, b) == expected, (a, op, b)


@pytest.mark.parametrize("size", ["1e-400", "-1e-400", "1e-310", "1e400", "1e130000"])
def test_a_number_that_no_float_holds_does_no_harm(postgis: psycopg.Connection, size: str) -> None:
    condition = '{"op": "<", "args": [{"op": "+", "args": [{"property": "size"}, 0]}, 1]}'
    statement = "select semap.condition_truth(%s, jsonb_build_object('size', %s::numeric))"
    assert ask(postgis, statement, condition, size) is (None if float(size) > 1 else True)


@pytest.mark.parametrize(
    ("document", "message", "hint"),
    [
        ({"op": "s_within", "args": [1, 2]}, "condition: a condition cannot ask for s_within", "predicate of the query"),
        ({"op": "a_overlaps", "args": [[1], [2]]}, "a condition cannot ask for a_overlaps", "There are and, or"),
        ({"op": "not", "args": [{"op": "isA", "args": ["Room"]}]}, "condition.args[0]: a condition cannot", "its side"),
        ({"op": "=", "args": [{"property": "nme"}, 1]}, "condition.args[0]: there is no property nme", "There are name, size"),
        ({"op": "=", "args": [{"property": "name"}]}, "= of 1 parts", "Give it 2."),
        ({"op": "=", "args": ["a", 1]}, "= of a number and a text", "like with like"),
        ({"op": "<", "args": [True, {"property": "name"}]}, "< of a boolean", "Use it for number, text, instant."),
        ({"op": "=", "args": [{"property": "name"}, None]}, "a comparison with null is never true", "isNull"),
        ({"op": "in", "args": [{"property": "name"}, [[1]]]}, "condition.args[1][0]: a list of other things", "Leave"),
        ({"op": "+", "args": [1, 2]}, "condition: it is neither true nor false", "Compare it"),
        ({"op": "=", "args": [{"bbox": [0, 0, 1, 1]}, 1]}, "it is none of op, property", "21-065r2"),
        ({"op": "=", "args": [{"property": "seen"}, {"timestamp": "2026-02-30T00:00:00Z"}]}, "2026-02-30T00:00:00Z is no time", "Write 2026-01-31"),
        ({"op": "=", "args": [{"property": "seen"}, {"timestamp": "0001-01-01T00:00:00+01:00"}]}, "is no time", "Write"),
        ({"op": "=", "args": [{"property": "size"}, 10**400]}, "too large for a float", "Give a number"),
    ],
)  # fmt: skip
def test_what_is_refused_is_told_with_its_place(
    postgis: psycopg.Connection, document: object, message: str, hint: str
) -> None:
    with pytest.raises(psycopg.errors.InvalidParameterValue) as told:
        postgis.execute("select semap.check_condition(%s, %s)", (json.dumps(document), list(KINDS)))
    assert message in str(told.value.diag.message_primary)
    assert hint in str(told.value.diag.message_hint)


def nested(levels: int) -> dict:
    document: dict = {"property": "open"}
    for _ in range(levels):
        document = {"op": "not", "args": [document]}
    return document


def test_depth_and_length_are_limited(postgis: psycopg.Connection) -> None:
    assert is_taken(postgis, nested(50))
    assert in_sql(postgis, nested(50), {"open": True}) == (True, True)
    assert not is_taken(postgis, nested(51))
    assert not is_taken(postgis, nested(400))
    wide = {"op": "in", "args": [{"property": "name"}, ["x" * 94] * 1000]}
    assert is_taken(postgis, wide)
    assert not is_taken(postgis, {"op": "in", "args": [{"property": "name"}, ["x" * 100] * 1000]})


def test_without_a_condition_all_is_well(postgis: psycopg.Connection) -> None:
    assert ask(postgis, "select semap.check_condition(null)") == ""
    assert ask(postgis, "select semap.condition_holds(null, '{}')") is True
    assert ask(postgis, """select semap.condition_holds('{"property": "open"}', null)""") is False


def test_an_operator_that_is_not_known_is_not_passed_over(postgis: psycopg.Connection) -> None:
    for op in ("s_within", "t_never", "drop table"):
        with pytest.raises(psycopg.errors.InvalidParameterValue, match="cannot ask for"):
            in_sql(postgis, {"op": op, "args": [1, 2]}, {})


def test_conditions_are_asked_in_parallel_plans(postgis: psycopg.Connection) -> None:
    """What is said to be safe there runs there, instants and arithmetic, too."""
    condition = {"op": "and", "args": [
        {"op": "t_after", "args": [{"property": "seen"}, {"date": "2026-01-01"}]},
        {"op": "=", "args": [{"op": "*", "args": [{"property": "size"}, 1e300]}, 1e300]},
    ]}  # fmt: skip
    with postgis.transaction(force_rollback=True):
        postgis.execute(
            "create table public.thing as select n, '2026-02-01' as seen from generate_series(1, 5) n"
        )
        ask_in_parallel(postgis)
        statement = (
            "select array_agg(n order by n) from public.thing"
            " where semap.condition_holds(%s, jsonb_build_object('size', n, 'seen', seen))"
        )
        assert ask(postgis, statement, json.dumps(condition)) == [1]
