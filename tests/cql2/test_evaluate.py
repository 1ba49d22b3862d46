"""CQL2 in memory: what it evaluates to is what PostGIS evaluates, over made expressions and things."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely.geometry import mapping
from sqlalchemy import Connection, literal_column, select, text

from semap.cql2 import Call, Kind, Literal, Property, check, check_parts, parse
from semap.cql2.check import TEMPORAL
from semap.cql2.evaluate import Subject, compile_expression, compile_filter
from semap.cql2.logic import code
from semap.cql2.value import instant_of, lower, without_accents
from semap.errors import InvalidInput
from semap.store.database.connection import one_transaction
from semap.store.database.cql2_sql import Thing, condition
from semap.timeline.stamp import to_datetime

KINDS: dict[str, Kind] = {
    "name": "text",
    "alias": "text",
    "size": "number",
    "count": "number",
    "open": "boolean",
    "made": "instant",
    "seen": "instant",
    "area": "shape",
    "place": "shape",
    "a": "any",
    "tags": "array",
}
TYPES: Mapping[Kind, str] = {
    "text": "text",
    "number": "float8",
    "boolean": "boolean",
    "instant": "timestamptz",
    "shape": "public.geometry",
    "any": "jsonb",
    "array": "jsonb",
}
START_US = 1_769_860_800_000_000
DAY_US = 86_400_000_000


SUBJECT = Subject(
    kinds=KINDS,
    parameters="thing",
    property_of=lambda name: code(f"thing.get({name!r})"),
    is_a=lambda concept: code(f"{concept!r} in thing['concepts']"),
)
SQL = Thing(
    kinds=KINDS,
    columns={name: literal_column(f"t.{name}") for name in KINDS},
    is_a=lambda concept: literal_column(f"('{concept}' = any (t.concepts))"),
)

JSON = st.recursive(
    st.sampled_from(
        [
            None,
            True,
            False,
            0,
            1,
            -2,
            4.5,
            "oak",
            "Öak",
            "1",
            "",
            "2026-02-01",
            "2026-02-02T12:00:00.5+01:00",
            "2026-02-30",
        ]
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.sampled_from(["x", "y", "0"]), inner, max_size=2)
    ),
    max_leaves=5,
)
WORDS = st.sampled_from(
    ["oak", "Öak", "thing 1", "thing_1", "10%", "a\\b", "ÉCOLE", "école", "it's", "", "x\ny"]
)
SHAPES = [
    shapely.box(0, 0, 4, 3),
    shapely.box(4, 0, 8, 3),
    shapely.box(1, 1, 3, 2),
    shapely.Point(4, 1),
    shapely.Point(2, 1.5),
    shapely.LineString([(0, 0), (4, 3)]),
    shapely.Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)]),
]
STAMPS_US = st.integers(-1, 5).map(lambda n: START_US + n * DAY_US)


def nullable(values: st.SearchStrategy) -> st.SearchStrategy:
    return st.one_of(st.none(), values, values)


THINGS = st.fixed_dictionaries(
    {
        "name": nullable(WORDS),
        "alias": nullable(WORDS),
        "size": nullable(st.sampled_from([-2, 0, 1, 2.5, 4])),
        "count": nullable(st.integers(-2, 3)),
        "open": nullable(st.booleans()),
        "made": nullable(STAMPS_US),
        "seen": nullable(STAMPS_US),
        "area": nullable(st.sampled_from(SHAPES)),
        "place": nullable(st.sampled_from(SHAPES)),
        "a": nullable(st.dictionaries(st.sampled_from(["x", "y", "z"]), JSON, max_size=3)),
        "tags": nullable(st.lists(JSON, max_size=3)),
        "concepts": st.lists(st.sampled_from(["Room", "Space", "Chair"]), unique=True),
    }
)


def call(op: str | Sequence[str], *args: st.SearchStrategy) -> st.SearchStrategy:
    ops = st.just(op) if isinstance(op, str) else st.sampled_from(op)
    return st.builds(lambda op, *args: {"op": op, "args": list(args)}, ops, *args)


def property_of(*names: str) -> st.SearchStrategy:
    return st.sampled_from(names).map(lambda name: {"property": name})


ANY = property_of("a.x", "a.y", "a.z", "a.x.y", "a.x.0", "a.y.-1", "a")
NUMBERS = st.recursive(
    st.one_of(st.sampled_from([-2, 0, 1, 2.5, 4]), property_of("size", "count"), ANY),
    lambda inner: call(["+", "-", "*", "/", "div", "%", "^"], inner, inner),
    max_leaves=3,
)
TEXTS = st.recursive(
    st.one_of(WORDS, property_of("name", "alias"), ANY),
    lambda inner: call(["casei", "accenti"], inner),
    max_leaves=2,
)
PATTERNS = st.recursive(
    st.sampled_from(["%", "thing _", "thing\\_1", "%A%", "É%", "10\\%", "a\\\\b", "", "_", "x%y", "\\oak"]),
    lambda inner: call(["casei", "accenti"], inner),
    max_leaves=2,
)
TIMES = STAMPS_US.map(lambda stamp_us: {"timestamp": to_datetime(stamp_us).isoformat()})
INSTANTS = st.one_of(TIMES, property_of("made", "seen"), ANY)
ENDS = st.one_of(st.just(".."), property_of("made", "seen"), ANY)
SPANS = st.one_of(
    INSTANTS,
    st.tuples(ENDS, ENDS).map(lambda ends: {"interval": list(ends)}),
    st.tuples(ENDS, TIMES).map(lambda ends: {"interval": list(ends)}),
    st.tuples(TIMES, ENDS).map(lambda ends: {"interval": list(ends)}),
)
PLACES = st.one_of(property_of("area", "place", "a.x"), st.sampled_from([mapping(each) for each in SHAPES]))
ITEMS = st.one_of(
    st.sampled_from(["oak", "1", 1, 0, True, False, 4.5]), ANY, property_of("name", "size", "open")
)
ARRAYS = st.one_of(property_of("tags", "a.x"), st.lists(ITEMS, max_size=3))
ORDERINGS = ["=", "<>", "<", "<=", ">", ">="]
FILTERS = st.recursive(
    st.one_of(
        *(call(ORDERINGS, each, each) for each in (NUMBERS, TEXTS, INSTANTS, ANY)),
        call("like", TEXTS, PATTERNS),
        *(call("between", each, each, each) for each in (NUMBERS, TEXTS, INSTANTS)),
        call("in", TEXTS, st.lists(TEXTS, max_size=3)),
        call("in", ANY, st.lists(ITEMS, max_size=3)),
        call("isNull", st.one_of(ANY, property_of("name", "size", "open", "made", "area"), NUMBERS, TEXTS)),
        call([f"s_{each}" for each in ("intersects", "equals", "disjoint", "touches", "within", "overlaps", "crosses", "contains")], PLACES, PLACES),
        call(TEMPORAL, SPANS, SPANS),
        call(["a_contains", "a_containedBy", "a_equals", "a_overlaps"], ARRAYS, ARRAYS),
        call("isA", st.sampled_from(["Room", "Space", "Chair"])),
        st.one_of(property_of("open"), ANY),
    ),
    lambda inner: st.one_of(
        call(["and", "or"], inner, inner),
        call(["and", "or"], inner, inner, inner),
        call("not", inner),
        call(["=", "<>"], inner, inner),
        call("isNull", inner),
        call("in", inner, st.lists(inner, min_size=1, max_size=2)),
    ),
    max_leaves=5,
)  # fmt: skip


@pytest.fixture(scope="module")
def postgis(cluster, template) -> Iterator[Connection]:
    from server import fresh_database  # noqa: PLC0415

    with fresh_database(cluster, template) as dsn, one_transaction(dsn, "semap_api") as connection:
        yield connection


def in_sql(connection: Connection, document: object, thing: Mapping[str, object]) -> bool | None:
    columns = ", ".join(f"cast(:{name} as {TYPES[kind]}) as {name}" for name, kind in KINDS.items())
    given = {name: _as_sql(kind, thing[name]) for name, kind in KINDS.items()}
    source = text(f"select {columns}, cast(:concepts as text[]) as concepts")
    from_ = source.bindparams(**given, concepts=thing["concepts"]).columns().subquery("t")
    return connection.scalar(select(condition(parse(document), SQL)).select_from(from_))


def _as_sql(kind: Kind, value: object) -> object:
    if value is None:
        return None
    match kind:
        case "instant":
            return to_datetime(value)
        case "shape":
            return shapely.to_wkb(value, hex=True)
        case "any" | "array":
            return json.dumps(value)
    return value


@settings(max_examples=500, deadline=None, suppress_health_check=list(HealthCheck))
@given(document=FILTERS, thing=THINGS)
def test_what_is_evaluated_is_what_postgis_evaluates(
    postgis: Connection, document: dict, thing: dict
) -> None:
    expression = parse(document)
    try:
        check(expression, KINDS)
    except InvalidInput:
        return
    found = in_sql(postgis, document, thing)
    twice = Call("and", (expression, expression))  # what is of the kind any becomes true, false or unknown
    assert compile_expression(twice, SUBJECT)(thing) is found
    assert compile_filter(expression, SUBJECT)(thing) is (found is True)


CHARACTERS = [chr(n) for n in range(1, 0x110000) if not 0xD800 <= n < 0xE000]
FOLDING = "select array_agg({} order by n) from unnest(cast(:all as text[])) with ordinality as t(c, n)"


@pytest.mark.parametrize(
    ("function", "sql", "last"),
    [
        (lower, "semap.lower_case(c)", "\U0010ffff"),
        (lower, 'semap.lower_case(c collate "C")', "\U0010ffff"),
        (without_accents, "semap.without_accents(c)", "\uffff"),
    ],
)
def test_characters_fold_as_in_postgis(
    postgis: Connection, function: Callable[[str], str], sql: str, last: str
) -> None:
    characters = [each for each in CHARACTERS if each <= last]
    found = postgis.scalar(text(FOLDING.format(sql)), {"all": characters})
    assert [
        three
        for three in zip(characters, found, map(function, characters), strict=True)
        if three[1] != three[2]
    ] == []


WORDS_TO_FOLD = st.text(
    st.sampled_from("aÉßẞΣσςİiIıЖǅÅ\u0307\u1c89\ua7cb\U00010400\U00010d50\U0001f600 .")
    | st.characters(exclude_categories=["Cs"]),
    max_size=12,
).filter(lambda each: "\0" not in each)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(said=WORDS_TO_FOLD)
def test_texts_fold_as_in_postgis(postgis: Connection, said: str) -> None:
    assert postgis.scalar(text("select semap.lower_case(:said)"), {"said": said}) == lower(said)


def test_letters_that_came_after_unicode_14_stay_as_they_are() -> None:
    """Else a rule would find what a Python or a server of another version does not."""
    newer = "\u1c89\ua7cb\ua7cc\ua7ce\ua7d2\ua7da\ua7dc\U00010d50\U00010d65"
    assert lower(newer) == newer
    assert (
        lower("ÉΣЖԱႠᲐẞ\u2c2f\ua7c9\ua7f5\U00010400\U00010570\U0001e921")
        == "éσжաⴀაß\u2c5f\ua7ca\ua7f6\U00010428\U00010597\U0001e943"
    )


CLOCKS = st.builds(
    "{}:{}:{}{}{}".format,
    *(st.sampled_from(["00", "07", "23", "24", "59", "60", "61"]) for _ in range(3)),
    st.sampled_from(["", ".5", ".1234565", ".9999999", "."]),
    st.sampled_from(["Z", "z", "", "+00:00", "-05:30", "+15:59", "+16:00", "+02:60", "+2"]),
)
STAMP_TEXTS = st.builds(
    lambda day, mark, clock: day + mark + (clock if mark else ""),
    st.sampled_from(
        ["2026-02-28", "2026-02-29", "2024-02-29", "0001-01-01", "0000-01-01", "2026-13-01", "x"]
    ),
    st.sampled_from(["", "T", "t", " "]),
    CLOCKS,
)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(said=STAMP_TEXTS)
def test_a_text_is_the_instant_that_postgis_reads(postgis: Connection, said: str) -> None:
    statement = text("select (extract(epoch from semap.instant_of(:said)) * 1000000)::int8")
    assert postgis.scalar(statement, {"said": said}) == instant_of(said)


def evaluated(source: object, **thing: object) -> object:
    expression = parse(source)
    check_parts(expression, KINDS)
    return compile_expression(expression, SUBJECT)(thing)


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("size * 2", 5.0),
        ("1e308 * 10", None),
        ("size ^ 1e9", None),
        ("size", 2.5),
        ("a.list.1.deep", "x"),
        ("made", START_US),
        ("(name, made, a.list, nothing)", ["it's", "2026-01-31T12:00:00.000000Z", [1, {"deep": "x"}], None]),
        ("place", shapely.Point(1, 2)),
        ("CASEI(name)", "it's"),
        ("TIMESTAMP('2026-01-31T12:00:00.000001Z')", START_US + 1),
        ("9007199254740993 = 9007199254740992", True),
    ],
)
def test_an_expression_has_a_value_of_any_kind(source: str, value: object) -> None:
    source = source.replace("nothing", "alias")
    thing = {"size": 2.5, "name": "it's", "made": START_US, "a": {"list": [1, {"deep": "x"}]}}
    assert evaluated(source, **thing, place=shapely.Point(1, 2)) == value


def test_an_open_end_is_further_than_any_time() -> None:
    for source in (
        "T_STARTS(INTERVAL('..', made), INTERVAL('..', seen))",
        "T_DURING(made, INTERVAL('..', '..'))",
    ):
        assert evaluated(source, made=START_US, seen=START_US + 1) is True


@pytest.mark.parametrize(
    ("first", "nest"),
    [
        ("open", lambda inner: {"op": "not", "args": [{"op": "not", "args": [inner]}]}),
        ("open", lambda inner: {"op": "=", "args": [inner, True]}),
        ("open", lambda inner: {"op": "in", "args": [inner, [True, {"property": "open"}]]}),
        ("open", lambda inner: {"op": "or", "args": [{"op": "isNull", "args": [inner]}, {"property": "open"}]}),
        ("open", lambda inner: {"op": "a_overlaps", "args": [[inner], [True]]}),
        ("open", lambda inner: {"op": "a_equals", "args": [[inner], [True]]}),
        ("size", lambda inner: {"op": "%", "args": [inner, 5]}),
        ("size", lambda inner: {"op": "^", "args": [inner, 1]}),
    ],
)  # fmt: skip
def test_neither_code_nor_sql_grows_faster_than_the_filter(
    postgis: Connection, first: str, nest: Callable[[object], object]
) -> None:
    """What is nested as deep as can be read is evaluated at once, and is true of what is true."""
    nested: object = {"property": first}
    for _ in range(28):
        nested = nest(nested)
    document = nested if first == "open" else {"op": "=", "args": [nested, 1]}
    thing = {**dict.fromkeys(KINDS), "open": True, "size": 1, "concepts": []}
    assert evaluated(document, **thing) is True
    assert in_sql(postgis, document, thing) is True


def test_a_filter_may_be_wide() -> None:
    wide = {"op": "or", "args": [{"op": "=", "args": [{"property": "size"}, n]} for n in range(600)]}
    assert evaluated(wide, size=599) is True
    assert evaluated(wide, size=600) is False
    assert evaluated(wide, size=None) is None


@pytest.mark.parametrize("name", ["') or __import__('os')", "a\\", "x'y", "\n", "thing"])
def test_names_and_values_never_become_code(name: str) -> None:
    subject = replace(
        SUBJECT,
        kinds={name: "text"},
        property_of=lambda asked: code("thing.get(NAME)", NAME=ast.Constant(asked)),
    )
    asked = compile_filter(Call("=", (Property(name), Literal(name))), subject)
    assert asked({name: name})
    assert not asked({})
