"""Allen's relations: the table against their definitions, and what is possible against all futures."""

from itertools import product

import pytest

from semap.errors import InvalidInput
from semap.rules.interval.allen import INTERSECTS, RELATIONS, Span, possible, relations_named

DEFINITIONS = {
    "before": lambda a, b, c, d: b < c,
    "meets": lambda a, b, c, d: b == c,
    "overlaps": lambda a, b, c, d: a < c < b < d,
    "starts": lambda a, b, c, d: a == c and b < d,
    "during": lambda a, b, c, d: c < a and b < d,
    "finishes": lambda a, b, c, d: b == d and c < a,
    "equals": lambda a, b, c, d: a == c and b == d,
    "after": lambda a, b, c, d: d < a,
    "metBy": lambda a, b, c, d: d == a,
    "overlappedBy": lambda a, b, c, d: c < a < d < b,
    "startedBy": lambda a, b, c, d: a == c and d < b,
    "contains": lambda a, b, c, d: a < c and d < b,
    "finishedBy": lambda a, b, c, d: b == d and a < c,
}
"""Of [a, b) to [c, d), as Allen wrote them."""

INTERVALS = [(start, end) for start, end in product(range(7), repeat=2) if start < end]


def relations_of(one, other):
    return {name for name, holds in DEFINITIONS.items() if holds(*one, *other)}


def known(interval, at):
    start, end = interval
    return Span(start if start <= at else None, end if end <= at else None)


def test_each_pair_of_intervals_is_in_exactly_one_relation():
    for one, other in product(INTERVALS, repeat=2):
        found = possible(Span(*one), Span(*other))
        assert found == relations_of(one, other)
        assert len(found) == 1
    assert set(DEFINITIONS) == RELATIONS


@pytest.mark.parametrize("at", range(-1, 3))
def test_possible_is_what_some_future_makes_true(at):
    futures = {}
    for one, other in product(INTERVALS, repeat=2):
        futures.setdefault((known(one, at), known(other, at)), set()).update(relations_of(one, other))
    for (one, other), relations in futures.items():
        assert possible(one, other) == relations, (at, one, other)


def test_intersects_is_having_a_moment_in_common():
    for one, other in product(INTERVALS, repeat=2):
        shared = set(range(*one)) & set(range(*other))
        assert (relations_of(one, other) <= INTERSECTS) == bool(shared)


def test_names_are_read_in_any_case_and_intersects_stands_for_nine():
    assert relations_named(["METBY", "during"]) == {"metBy", "during"}
    assert relations_named(["intersects"]) == INTERSECTS
    assert len(INTERSECTS) == 9
    with pytest.raises(InvalidInput, match="'near' is no relation of two intervals") as caught:
        relations_named(["near"])
    assert "overlappedBy" in caught.value.remedy
