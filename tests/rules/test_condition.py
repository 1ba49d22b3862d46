"""Conditions and measures over rows bound so far: what lists of rows say in plain Python."""

from __future__ import annotations

import json
import math
import operator
from collections.abc import Callable

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from semap.errors import InvalidInput
from semap.rules.bound import Bound
from semap.rules.condition import (
    compile_condition,
    compile_measure,
    neighbours_in,
    read_condition,
    read_measure,
    reads,
)
from semap.rules.matching.neighbours import Neighbours
from semap.rules.row import Row

VARIABLES = frozenset("ABC")
COMPARE: dict[str, Callable[[object, object], bool]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
Chain = list[tuple[str, Row]]
"""Rows bound, the earliest first."""


def row(stamp_us: int = 0, concepts: tuple[str, ...] = (), **values: object) -> Row:
    return Row(stamp_us, 0, str(stamp_us), "relation", {"stamp": stamp_us, **values}, concepts)


def bound(chain: Chain) -> Bound | None:
    found = None
    for variable, each in chain:
        found = Bound(variable, each, found)
    return found


def condition(text: str):
    return compile_condition(read_condition(text, "define.C", VARIABLES))


def read_expression(text: str):
    return read_condition(text, "define.C", VARIABLES)


def measure(text: str):
    return compile_measure(read_measure(text, "measures.m", VARIABLES))


ROWS = st.builds(
    lambda stamp_us, values: row(stamp_us, **{k: v for k, v in values.items() if v is not None}),
    st.integers(0, 9).map(lambda n: n * 1_500_000),
    st.fixed_dictionaries(
        {
            "track": st.sampled_from([None, "ann", "bob"]),
            "occupants": st.sampled_from([None, 0, 1, 2, 5]),
            "duration_s": st.sampled_from([None, 0.25, 2, 1e308]),
            "attributes": st.sampled_from([None, {"n": 3}, {"n": "x"}, {"n": 1.5}, {"n": None}, {}]),
        }
    ),
)
CHAINS = st.lists(st.tuples(st.sampled_from("ABC"), ROWS), min_size=1, max_size=6)
PROPERTIES = st.sampled_from(["track", "occupants", "duration_s", "attributes.n", "stamp"])


def at(each: Row, name: str) -> object:
    head, _, key = name.partition(".")
    value = each.values.get(head)
    return value.get(key) if key and value is not None else value


def known(chain: Chain, variable: str, name: str) -> list:
    """Of the rows of a variable, the earliest first, what is not null."""
    found = [at(each, name) for bound_to, each in chain if bound_to == variable]
    return [value for value in found if value is not None]


def numbers(values: list) -> list:
    return [value for value in values if isinstance(value, int | float)]


def summed(values: list) -> float | None:
    exact = sum(int(value) * 4 + int(value % 1 * 4) for value in values)  # all are quarters
    return exact / 4 if values and exact / 4 < 1.7e308 else None


def navigated(function: str, chain: Chain, variable: str, name: str) -> object:
    rows = [each for bound_to, each in chain if bound_to == variable]
    if function in ("first", "last"):
        return at(rows[0 if function == "first" else -1], name) if rows else None
    values = known(chain, variable, name)
    if function == "count":
        return len(values)
    if function in ("sum", "avg"):
        found = summed(numbers(values))
        return found if function == "sum" or found is None else found / len(numbers(values))
    ordered = numbers(values) or values
    return (min if function == "min" else max)(ordered) if ordered else None


TERMS = st.tuples(
    st.sampled_from(["first", "last", "count", "sum", "avg", "min", "max"]),
    st.sampled_from("ABC"),
    PROPERTIES,
).filter(lambda term: not (term[0] in ("sum", "avg") and term[2] in ("track", "stamp")))


@given(CHAINS, TERMS)
def test_functions_are_of_the_rows_bound_to_a_variable(chain: Chain, term: tuple[str, str, str]) -> None:
    function, variable, name = term
    expected = navigated(function, chain, variable, name)
    if name == "stamp" and function != "count" and expected is not None:
        expected = f"1970-01-01T00:00:{expected / 1e6:09.6f}Z"
    whole = bound(chain)
    assert whole is not None
    assert measure(f"{function}({variable}.{name})")(whole, whole, 0) == expected


@given(CHAINS, ROWS, st.sampled_from(list(COMPARE)), TERMS, st.sampled_from(["occupants", "duration_s"]))
def test_a_condition_compares_a_row_with_those_bound(
    chain: Chain, asked: Row, op: str, term: tuple[str, str, str], name: str
) -> None:
    function, variable, of = term
    if of in ("track", "stamp") and function != "count":
        of = "occupants"
    left, right = at(asked, name), navigated(function, chain, variable, of)
    comparable = left is not None and isinstance(right, int | float)
    text = f"{name} {op} {function}({variable}.{of})"
    assert condition(text).test_bound(asked, bound(chain)) is (comparable and COMPARE[op](left, right))
    negated = condition(f"NOT {text}").test_bound(asked, bound(chain))
    assert negated is (comparable and not COMPARE[op](left, right))


ALLEN: dict[str, Callable[[int, int, int, int], bool]] = {
    "t_before": lambda a, b, c, d: b < c,
    "t_after": lambda a, b, c, d: a > d,
    "t_meets": lambda a, b, c, d: b == c,
    "t_metBy": lambda a, b, c, d: a == d,
    "t_overlaps": lambda a, b, c, d: a < c < b < d,
    "t_overlappedBy": lambda a, b, c, d: c < a < d < b,
    "t_starts": lambda a, b, c, d: a == c and b < d,
    "t_startedBy": lambda a, b, c, d: a == c and b > d,
    "t_during": lambda a, b, c, d: c < a and b < d,
    "t_contains": lambda a, b, c, d: a < c and d < b,
    "t_finishes": lambda a, b, c, d: c < a and b == d,
    "t_finishedBy": lambda a, b, c, d: a < c and b == d,
    "t_equals": lambda a, b, c, d: a == c and b == d,
}


@pytest.mark.parametrize("relation", ALLEN)
def test_each_of_allens_relations_is_a_condition(relation: str) -> None:
    holds = condition(f"{relation}(INTERVAL(first(A.stamp), last(A)), INTERVAL(since, stamp))").test_bound
    for begins in range(4):
        for ends in range(begins + 1, 5):
            chain = bound([("A", row(begins)), ("B", row(9)), ("A", row(ends))])
            for since in range(4):
                for stamp in range(since + 1, 5):
                    expected = ALLEN[relation](begins, ends, since, stamp)
                    assert holds(row(stamp, since=since), chain) is expected
    assert holds(row(5, since=1), None) is False


def test_the_row_that_is_being_bound_is_the_last_one() -> None:
    asked = row(3, track="ann", occupants=2)
    chain = Bound("B", asked, Bound("B", row(2, track="bob", occupants=1), Bound("A", row(1, track="ann"))))
    for text in (
        "track = B.track",
        "track = last(B.track)",
        "first(B.track) = 'bob'",
        "count(B) = 2",
        "sum(B.occupants) = 3",
        "A.track = track",
        "count(C) = 0",
        "C.track IS NULL",
        "stamp > first(A)",
    ):
        assert condition(text).test_bound(asked, chain) is True, text
        assert condition(text).test is None


@pytest.mark.parametrize("direction", ["prev", "next"])
def test_the_rows_around_a_row_are_known_by_the_row_alone(direction: str) -> None:
    asked = condition(f"{direction}(attributes.n) = 1 and {direction}(type, 2) <> type")
    rows = [
        row(n, type=kind, attributes={"n": n % 3}) for n, kind in enumerate(("a", "b", "c", "d", "d", "d"))
    ]
    told = [
        *Neighbours(
            neighbours_in(read_expression(f"{direction}(attributes.n) = 1 and {direction}(type, 2) <> type"))
        ).all_told(rows)
    ]
    assert asked.test is not None
    away = -1 if direction == "prev" else 1
    for place, each in enumerate(told):
        near, far = place + away, place + 2 * away
        known = 0 <= near < len(rows) and 0 <= far < len(rows)
        wanted = known and near % 3 == 1 and rows[far].values["type"] != each.values["type"]
        assert asked.test(each) is wanted, place
    assert condition(f"{direction}(type) IS NULL").test_bound(row(2), None) is True


def test_a_row_outside_the_window_says_nothing() -> None:
    wanted = neighbours_in(read_expression("prev(type) = 'a'"))
    for away_us, found in ((4, "a"), (5, None)):
        _, told = Neighbours(wanted, window_us=5).all_told([row(0, type="a"), row(away_us, type="b")])
        assert told.values.get("prev 1 type") == found


CHAIN = [("A", 1, "x"), ("B", 2, "y"), ("A", 3, "x"), ("B", 4, "z"), ("A", 5, "x")]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("first(occupants)", 1),
        ("last(occupants, 1)", 4),
        ("last(occupants, 5)", None),
        ("first(A.occupants, 1)", 3),
        ("last(A.occupants, 2)", 1),
        ("last(A.occupants, 3)", None),
        ("last(B.occupants + B.occupants * 2, 1)", 6),
        ("prev(last(A.occupants, 1))", 2),
        ("prev(A.occupants, 3)", 2),
        ("next(first(B.occupants), 2)", 4),
        ("next(A.occupants)", None),
        ("prev(occupants, 0)", 5),
        ("prev(B.occupants + 1, 2)", 3),
        ("first(S.occupants, 4)", 5),
        ("classifier()", "A"),
        ("classifier(B)", "B"),
        ("classifier(S)", "A"),
        ("last(classifier(), 1)", "B"),
        ("prev(classifier())", "B"),
        ("prev(classifier(B), 1)", "A"),
        ("array(classifier())", ["A", "B", "A", "B", "A"]),
        ("array(classifier(B))", ["B", "B"]),
        ("array(A.occupants)", [1, 3, 5]),
        ("array(B.track)", ["y", "z"]),
        ("array(C.track)", None),
        ("distinct(track)", ["x", "y", "z"]),
        ("distinct(A.track)", ["x"]),
        ("count_distinct(S.track)", 3),
        ("count()", 5),
        ("count(S)", 5),
        ("count(C)", 0),
        ("sum(S.occupants)", 15),
        ("sum(A.occupants * A.occupants)", 35),
        ("avg(occupants)", 3),
        ("max(B.track || '!')", "z!"),
        ("array(A.stamp)", ["1970-01-01T00:00:00.000000Z", "1970-01-01T00:00:00.000002Z", "1970-01-01T00:00:00.000004Z"]),
        ("match_number()", 7),
        ("abs(0 - 2.5) + floor(2.7) + ceil(2.1) + round(2.5) + length('abc')", 13.5),
        ("lower('ÄB') || upper('c') || 'x'", "äbCx"),
        ("abs(C.occupants)", None),
    ],
)  # fmt: skip
def test_what_is_asked_of_the_rows_of_a_match(text: str, value: object) -> None:
    """Worked out by hand from SQL:2016, row pattern navigation and aggregation."""
    expression = read_measure(text, "m", VARIABLES, {"S": frozenset("AB")})
    rows = [row(place, occupants=n, track=track) for place, (_, n, track) in enumerate(CHAIN)]
    told = Neighbours(neighbours_in(expression)).all_told(rows)
    found = bound([(variable, each) for (variable, _, _), each in zip(CHAIN, told, strict=True)])
    assert found is not None
    assert compile_measure(expression)(found, found, 7) == value


def test_a_measure_runs_with_the_rows_unless_it_is_final() -> None:
    rows = [row(place, occupants=n) for place, (_, n, _) in enumerate(CHAIN)]
    whole = bound([(variable, each) for (variable, _, _), each in zip(CHAIN, rows, strict=True)])
    assert whole is not None
    upto = [*whole.latest_first()][3]

    def found(text: str) -> object:
        return compile_measure(read_measure(text, "m", VARIABLES))(upto, whole, 0)

    assert found("sum(occupants)") == found("running(sum(occupants))") == 3
    assert found("final(sum(occupants))") == 15
    assert found("final(last(A.occupants)) - last(A.occupants)") == 4
    assert found("final(count(A))") == 3


def test_what_a_row_alone_decides_is_asked_of_it_alone() -> None:
    asked = condition(
        "isA('Room') and 'hall' in (room, 'x') and A_CONTAINS(neighbours, ('bath')) and attributes.seats > 2"
        " and S_WITHIN(position, BBOX(0, 0, 2, 2)) and seconds_between(since, stamp) = 1.5"
    )
    told = {
        "room": "hall",
        "neighbours": ["bath", "hall"],
        "attributes": {"seats": 3},
        "position": shapely.Point(1, 1),
        "since": 500_000,
    }
    assert asked.test is not None
    for test in (asked.test, lambda each: asked.test_bound(each, None)):
        assert test(row(2_000_000, ("Room", "Space"), **told)) is True
        assert test(row(2_000_000, ("Space",), **told)) is False
        for name in told:
            assert test(row(2_000_000, ("Room", "Space"), **{**told, name: None})) is False
    assert asked.reads == {"concept", *told, "stamp"}


def test_what_is_read_of_any_row_is_known() -> None:
    assert condition("A.actor = first(B.attributes.x) and prev(occupants) > 1 and count(C) = 1").reads == {
        "actor",
        "attributes",
        "occupants",
        "stamp",
    }
    assert reads(read_measure("(last(A.position) IS NULL, measures.x)", "m", VARIABLES)) == {
        "position",
        "measures",
    }


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("seconds_between(first(A), last(B.stamp))", 2.5),
        ("last(B.track)", "ann"),
        ("track", "ann"),
        ("first(A)", "1970-01-01T00:00:00.500000Z"),
        ("count(A) + count(B)", 2.0),
        ("(first(A), B.track, C.track, 1)", ["1970-01-01T00:00:00.500000Z", "ann", None, 1]),
        ("neighbours", ["bath"]),
        ("attributes", {"n": [1, None]}),
        ("A.duration_s", None),
        ("B.duration_s", None),
        ("1e308 * 10", None),
        ("isA('Room')", True),
        ("B.track = 'bob'", False),
        ("C.track = 'bob'", None),
    ],
)
def test_a_measure_is_json(text: str, value: object) -> None:
    last = row(
        3_000_000,
        ("Room",),
        track="ann",
        neighbours=("bath",),
        attributes={"n": [1, None]},
        duration_s=math.inf,
    )
    chain = Bound("B", last, Bound("A", row(500_000, duration_s=math.nan)))
    found = measure(text)(chain, chain, 0)
    assert found == value
    assert json.loads(json.dumps(found, allow_nan=False)) == value


@pytest.mark.parametrize(
    ("text", "where", "match", "remedy"),
    [
        ("typ = 'a'", ", line 1, character 1", "no property typ", "Did you mean type"),
        ("A.typ = 'a'", ", line 1, character 1", "no property typ", "Did you mean type"),
        ("type = 'a' AND\n  D.type = 'x'", ", line 2, character 3", "variable D", "variables are A, B, C"),
        ("1 = 1 and 1 < count(typ)", ", line 1, character 21", "no variable typ", "variables are A, B, C"),
        ("A = 3", ", line 1, character 1", "A is a variable", "A.stamp"),
        ("sum(A) > 1", ", line 1, character 5", "sum of no property", "sum(A."),
        ("sum(A.type) > 1", ", line 1, character 5", "sum of a text", "number"),
        ("min(A.position) > 1", ", line 1, character 5", "min of a shape", "number or text"),
        ("first(count(A)) = 1", ", line 1, character 1", "something else than a variable", "first(A.stamp)"),
        ("last() = 1", ", line 1, character 1", "last of 0 parts", "last(A.stamp)"),
        ("sum(A.occupants + B.occupants) > 1", ", line 1, character 1", "more than one variable", "subset"),
        ("prev(count(A)) = 1", ", line 1, character 1", "something else than a variable", "prev(A.stamp)"),
        ("prev(type, -1) = 'x'", ", line 1, character 1", "whole number from 0", "prev(type)"),
        ("next(classifier()) = 'A'", ", line 1, character 1", "next of classifier", "next(first(A.type"),
        ("match_number() = 1", ", line 1, character 1", "match_number in a condition", "measures"),
        ("final(count(A)) = 1", ", line 1, character 1", "final in a condition", "measures"),
        (
            "classifier_near(1) = 'A'",
            ", line 1, character 1",
            "no function classifier_near",
            "prev(classifier",
        ),
        ("seconds_between(A.type, stamp) > 1", ", line 1, character 17", "of a text", "instant"),
        ("seconds_between(stamp) > 1", ", line 1, character 1", "of 1 parts", "2"),
        ("frist(A.stamp) = stamp", ", line 1, character 1", "no operator or function frist", "mean first"),
        ("stamp = type", "", "instant and a text", "TIMESTAMP"),
        ("T_DURING(stamp, INTERVAL(A.type, '..'))", ", line 1, character 26", "no time", "Give a time"),
        ("T_DURING(stamp, INTERVAL(casei(A.type), '..'))", ", line 1, character 26", "no end", "Give a time"),
        ("stamp", "", "neither true nor false", "Compare"),
        ("type =", ", line 1, character 7", "a value is missing", "OGC"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(text: str, where: str, match: str, remedy: str) -> None:
    with pytest.raises(InvalidInput, match=match) as told:
        read_condition(text, "define.C", VARIABLES)
    assert told.value.where == f"define.C{where}"
    assert remedy in told.value.remedy


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("A.position", "a measure that is a shape"),
        ("INTERVAL(A.stamp, B.stamp)", "a measure that is a interval"),
        ("avg(A.track)", "avg of a text"),
    ],
)
def test_what_cannot_be_measured_is_refused(text: str, match: str) -> None:
    with pytest.raises(InvalidInput, match=match):
        read_measure(text, "measures.m", VARIABLES)


def test_before_rows_are_partitioned_there_are_no_variables() -> None:
    with pytest.raises(InvalidInput, match="there is no variable A") as told:
        read_condition("count(A) = 1", "where", frozenset())
    assert "The variables are none" in told.value.remedy


@given(st.text(alphabet="ABfirstlastcountprev(),. ='<>stamptype123INTERVAL_DURINGand", max_size=40))
def test_any_text_is_a_condition_or_refused(text: str) -> None:
    for read in (read_condition, read_measure):
        try:
            read(text, "define.C", VARIABLES)
        except InvalidInput as error:
            assert error.where.startswith("define.C")  # noqa: PT017  (either is right)
            assert error.remedy  # noqa: PT017
