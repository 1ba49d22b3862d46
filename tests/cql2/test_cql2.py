"""CQL2 read from text and JSON: what it means, and what is wrong with what means nothing."""

from __future__ import annotations

import json
from contextlib import suppress
from datetime import UTC, datetime

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from semap.cql2 import (
    Array,
    Call,
    Expression,
    Instant,
    Interval,
    Kind,
    Literal,
    Property,
    Shape,
    check,
    parse,
    parts,
)
from semap.cql2.check import OPERATORS
from semap.errors import InvalidInput

KINDS: dict[str, Kind] = {
    "name": "text",
    "size": "number",
    "open": "boolean",
    "made": "instant",
    "place": "shape",
    "attributes": "any",
}
NAME, SIZE, MADE, PLACE = (Property(each) for each in ("name", "size", "made", "place"))
NOON = Instant(datetime(2026, 1, 31, 12, tzinfo=UTC))


@pytest.mark.parametrize(
    ("text", "means"),
    [
        ("name = 'it''s'", Call("=", (NAME, Literal("it's")))),
        ("size > 3 AND NOT open", Call("and", (Call(">", (SIZE, Literal(3))), Call("not", (Property("open"),))))),
        (
            "size=1 OR size=2 AND size=3",
            Call(
                "or",
                (
                    Call("=", (SIZE, Literal(1))),
                    Call("and", (Call("=", (SIZE, Literal(2))), Call("=", (SIZE, Literal(3))))),
                ),
            ),
        ),
        ("size + 2 * 3 = 4.5", Call("=", (Call("+", (SIZE, Call("*", (Literal(2), Literal(3))))), Literal(4.5)))),
        ("size NOT BETWEEN 1 AND 2", Call("not", (Call("between", (SIZE, Literal(1), Literal(2))),))),
        ("name IN ('a', 'b')", Call("in", (NAME, Array((Literal("a"), Literal("b")))))),
        ("name IS NOT NULL", Call("not", (Call("isNull", (NAME,)),))),
        ("CASEI(name) LIKE CASEI('r%')", Call("like", (Call("casei", (NAME,)), Call("casei", (Literal("r%"),))))),
        ("isa('Room')", Call("isA", (Literal("Room"),))),
        ("made > TIMESTAMP('2026-01-31T13:00:00+01:00')", Call(">", (MADE, NOON))),
        (
            "T_DURING(made, INTERVAL('2026-01-31T12:00:00Z', '..'))",
            Call("t_during", (MADE, Interval(NOON, None))),
        ),
        ("T_FINISHEDBY(made, DATE('2026-01-31'))", Call("t_finishedBy", (MADE, Instant(datetime(2026, 1, 31, tzinfo=UTC))))),
        ("S_WITHIN(place, BBOX(0, 1, 2, 3))", Call("s_within", (PLACE, Shape(shapely.box(0, 1, 2, 3))))),
        ("S_INTERSECTS(place, POINT Z (1 2 3))", Call("s_intersects", (PLACE, Shape(shapely.Point(1, 2))))),
        ('"attributes.my key" = 1', Call("=", (Property("attributes.my key"), Literal(1)))),
        ("A_CONTAINS(attributes.tags, ('a', 1))", Call("a_contains", (Property("attributes.tags"), Array((Literal("a"), Literal(1)))))),
        ("attributes.seats DIV 2 = 1", Call("=", (Call("div", (Property("attributes.seats"), Literal(2))), Literal(1)))),
    ],
)  # fmt: skip
def test_text_means_what_the_standard_says(text: str, means: Call) -> None:
    expression = parse(text)
    assert expression == means
    check(expression, KINDS)


COLLECTION = (
    "GEOMETRYCOLLECTION(POINT(1.9 2.00001), POINT(0 -2), LINESTRING(1 1, 2 2), POLYGON((0 0, 4 0, 4 4, 0 0)))"
)
INNER = [
    {"type": "Point", "coordinates": [1.9, 2.00001]},
    {"type": "Point", "coordinates": [0, -2]},
    {"type": "LineString", "coordinates": [[1, 1], [2, 2]]},
    {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 4], [0, 0]]]},
]


@pytest.mark.parametrize("op", ["s_intersects", "s_disjoint"])
def test_a_collection_of_shapes_is_a_literal(op: str) -> None:
    as_text = parse(f"{op}(place, {COLLECTION})")
    check(as_text, KINDS)
    document = {
        "op": op,
        "args": [{"property": "place"}, {"type": "GeometryCollection", "geometries": INNER}],
    }
    assert parse(document) == as_text
    assert as_text == Call(op, (PLACE, Shape(shapely.from_wkt(COLLECTION))))


def test_a_collection_of_like_shapes_is_one_shape_of_any_relation() -> None:
    text = "GEOMETRYCOLLECTION(POINT(1 1), GEOMETRYCOLLECTION(MULTIPOINT(2 2, 3 3)))"
    expression = parse(f"S_WITHIN(place, {text})")
    check(expression, KINDS)
    assert expression == Call("s_within", (PLACE, Shape(shapely.MultiPoint([(1, 1), (2, 2), (3, 3)]))))


def test_a_box_in_degrees_may_cross_the_antimeridian() -> None:
    expression = parse("S_INTERSECTS(place, BBOX(170, -10, -170, 10))", degrees=True)
    (shape,) = (part for part in parts(expression) if isinstance(part, Shape))
    for longitude in range(-180, 181):
        wanted = longitude >= 170 or longitude <= -170
        assert shape.geometry.intersects(shapely.Point(longitude, 0)) is wanted


LEAVES = st.one_of(
    st.sampled_from(
        [*({"property": name} for name in KINDS), {"property": "attributes.seats"}, {"property": "no"}]
    ),
    st.sampled_from([{"date": "2026-01-31"}, {"bbox": [0, 0, 1, 1]}, {"interval": ["..", "2026-01-31"]}]),
    st.one_of(st.text(max_size=5), st.integers(-5, 5), st.floats(), st.booleans(), st.none()),
    st.dictionaries(st.sampled_from(["op", "args", "type", "bbox", "date"]), st.text(max_size=3), max_size=3),
)
ANYTHING = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.builds(
            lambda op, args: {"op": op, "args": args}, st.sampled_from(OPERATORS), st.lists(inner, max_size=3)
        ),
        st.builds(lambda items: {"interval": items}, st.lists(inner, max_size=2)),
        st.builds(lambda items: {"type": "Polygon", "coordinates": items}, st.lists(inner, max_size=2)),
    ),
    max_leaves=8,
)


@given(ANYTHING)
def test_any_json_is_a_filter_or_refused_with_its_place(document: object) -> None:
    expression = told_or_checked({"op": "not", "args": [document]})
    if expression is not None:
        assert all(
            isinstance(each, Call | Property | Literal | Array | Instant | Interval | Shape)
            for each in parts(expression)
        )


@given(st.one_of(st.text(), st.text(alphabet="()'\" =<>ANDORnotin.,0123456789-+*/^%abs_TIMEBOX")))
def test_any_text_is_a_filter_or_refused(text: str) -> None:
    told_or_checked(text)


def told_or_checked(source: str | dict) -> Expression | None:
    """The tree of a filter; None where it was refused with its place and what to do."""
    told = None
    try:
        expression = parse(source)
        check(expression, KINDS)
    except InvalidInput as error:
        told = error
    if told is None:
        return expression
    assert told.where.startswith("filter")
    assert told.remedy
    return None


@pytest.mark.parametrize("unit", ["(", "NOT ", "-", "size < ", "size ^ ", "casei(", "'", "\"", "size + ", "name = 'a' AND ", "POLYGON((", "isA(", "(1,"])  # fmt: skip
@pytest.mark.parametrize("count", [20, 59, 500, 100_000])
def test_no_length_or_depth_ends_the_process(unit: str, count: int) -> None:
    for closing in ("", ")" * count):
        with suppress(InvalidInput):
            parse(unit * count + "name" + closing)


@pytest.mark.parametrize(
    ("source", "where", "match", "remedy"),
    [
        ("nam = 'x'", "filter.args[0]", "no property nam", "Did you mean name"),
        ("name.x = 'x'", "filter.args[0]", "no property name.x", "attributes.<key>"),
        ("size = 1 AND name = 3", "filter.args[1]", "number and a text", "like with like"),
        ("made = '2026-01-31'", "filter", "instant and a text", "TIMESTAMP"),
        ("name = NULL", "filter", "null", "IS NULL"),
        ("size", "filter", "neither true nor false", "Compare"),
        ("NOT size", "filter.args[0]", "not of a number", "boolean"),
        ("open < true", "filter", "< of a boolean", "number"),
        ("name LIKE name", "filter.args[1]", "no pattern", "%"),
        ("lik(name, 'x')", "filter", "no operator or function lik", "Did you mean like"),
        ("S_INTERSECTS(place, name)", "filter.args[1]", "s_intersects of a text", "shape"),
        ("S_INTERSECTS(place, POLYGON((0 0,2 2,0 2,2 0,0 0)))", "filter.args[1]", "crosses itself", "valid"),
        ("S_INTERSECTS(place, BBOX(3,0,0,1))", "filter.args[1]", "without an area", "lower corner"),
        ("made > TIMESTAMP('noon')", "filter.args[1]", "noon is no time", "2026"),
        ("made > TIMESTAMP('2026-01-31T12:00:00')", "filter.args[1]", "no time zone", "Z"),
        ("T_AFTER(made, INTERVAL('2026-02-01','2026-01-01'))", "filter.args[1]", "ends before", "earlier"),
        ("isA(name)", "filter.args[0]", "no name", "Room"),
        (f"size < {10**400}", "filter.args[1]", "not finite", "number"),
        ("size < " + "9" * 5_000, "filter.args[1]", "not finite", "number"),
        ("name = 'a' AND", "filter, line 1, character 15", "no CQL2 text: a value", "OGC"),
        ({"op": "=", "args": [{"property": "name"}]}, "filter", "= of 1 parts", "2"),
        ({"op": "=", "args": [{"property": "name"}, {"evil": 1}]}, "filter.args[1]", "none of", "JSON"),
        ({"op": "in", "args": [{"property": "size"}, [1, "a"]]}, "filter.args[1][1]", "number and a text", "like"),
        ({"op": "like", "args": [{"property": "name"}, "a\\"]}, "filter.args[1]", "ends with", "backslash"),
        ({"op": "=", "args": [{"property": "size"}, float("inf")]}, "filter.args[1]", "finite", "number"),
        ("S_WITHIN(place, POINT(1e400 0))", "filter.args[1]", "finite", "numbers"),
        ("S_INTERSECTS(place, GEOMETRYCOLLECTION EMPTY)", "filter.args[1]", "empty or crosses", "valid"),
        ("S_INTERSECTS(place, BBOX(179,0,-179,1))", "filter.args[1]", "without an area", "lower corner"),
        (
            "S_WITHIN(place, GEOMETRYCOLLECTION(POINT(1 1), LINESTRING(0 0, 1 1)))",
            "filter.args[1]",
            "points, lines and areas",
            "each of its shapes",
        ),
        (
            {"op": "s_within", "args": [{"property": "place"}, {"type": "GeometryCollection", "coordinates": []}]},
            "filter.args[1]",
            "none of property",
            "CQL2 JSON",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(
    source: str | dict, where: str, match: str, remedy: str
) -> None:
    with pytest.raises(InvalidInput, match=match) as told:
        check(parse(source), KINDS)
    assert told.value.where == where
    assert remedy in told.value.remedy


def test_too_deep_or_too_long_is_refused() -> None:
    deep: object = True
    for _ in range(100):
        deep = {"op": "not", "args": [deep]}
    wide = {"op": "in", "args": [{"property": "size"}, list(range(3_000))]}
    for document in (deep, wide):
        with pytest.raises(InvalidInput, match="more than"):
            parse(json.loads(json.dumps(document)))
