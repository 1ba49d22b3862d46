"""What conditions and measures ask of the rows bound so far; null where a variable has bound none."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from typing import Any

from semap.cql2.value import json_at, number_of, text_of
from semap.rules.bound import Bound
from semap.rules.row import Row, Value


class Every:
    """All variables; an empty match binds its row to none."""

    def __contains__(self, variable: object) -> bool:
        return bool(variable)


EVERY = Every()
Variables = Container[str]


def last(bound: Bound | None, variables: Variables, name: str) -> Value:
    while bound is not None:
        if bound.variable in variables:
            return bound.row.values.get(name)
        bound = bound.before
    return None


def first(bound: Bound | None, variables: Variables, name: str) -> Value:
    row: Row | None = None
    while bound is not None:
        if bound.variable in variables:
            row = bound.row
        bound = bound.before
    return None if row is None else row.values.get(name)


def _bound_to(bound: Bound | None, variables: Variables) -> list[Bound]:
    """Those bound to the variables, the latest first."""
    found = []
    while bound is not None:
        if bound.variable in variables:
            found.append(bound)
        bound = bound.before
    return found


def last_of(
    bound: Bound | None, variables: Variables, offset: int, value: Callable[[Bound, Row], Value]
) -> Value:
    """A value of the row so many before the last one that is bound to the variables."""
    found = _bound_to(bound, variables)
    return value(found[offset], found[offset].row) if offset < len(found) else None


def first_of(
    bound: Bound | None, variables: Variables, offset: int, value: Callable[[Bound, Row], Value]
) -> Value:
    """A value of the row so many after the first one that is bound to the variables."""
    found = _bound_to(bound, variables)
    return value(found[-1 - offset], found[-1 - offset].row) if offset < len(found) else None


def values(bound: Bound | None, variables: Variables, name: str, keys: Sequence[str]) -> list[Any]:
    """Of each row bound to the variables, the latest first, a property, or what JSON has there."""
    found = []
    while bound is not None:
        if bound.variable in variables:
            found.append(bound.row.values.get(name))
        bound = bound.before
    return [json_at(value, keys) for value in found] if keys else found


def values_of(bound: Bound | None, variables: Variables, value: Callable[[Bound, Row], Value]) -> list[Any]:
    """The same of what is worked out of each row."""
    return [value(each, each.row) for each in _bound_to(bound, variables)]


def variable_at(bound: Bound, uid: object) -> str | None:
    """The variable that a row before this one is bound to."""
    return next((str(each.variable) for each in bound.latest_first() if each.row.uid == uid), None)


def _numbers(found: Sequence[Any]) -> list[float]:
    return [number for value in found if value is not None and (number := number_of(value)) is not None]


def count(found: Sequence[Any]) -> int:
    return sum(value is not None for value in found)


def _sum(numbers: Sequence[float]) -> float | None:
    """The same in whatever order; null where there is none, or where no float holds it."""
    try:
        return math.fsum(numbers) if numbers else None
    except OverflowError:
        return None


def total(found: Sequence[Any]) -> float | None:
    return _sum(_numbers(found))


def average(found: Sequence[Any]) -> float | None:
    numbers = _numbers(found)
    summed = _sum(numbers)
    return None if summed is None else summed / len(numbers)


def _furthest(of: Callable[[list[Any]], Any]) -> Callable[[Sequence[Any]], Value]:
    def furthest(values: Sequence[Any]) -> Value:
        # JSON may hold both; texts count where there is no number
        for kind in (number_of, text_of):
            found = [value for value in values if kind(value) is not None]
            if found:
                return of(found)
        return None

    return furthest


def array(found: Sequence[Any]) -> list[Any] | None:
    """All of them, the earliest first; null where there is no row."""
    return list(found[::-1]) or None


def distinct(found: Sequence[Any]) -> list[Any] | None:
    """Those that are not null, each once, in the order in which they came first."""
    kept: list[Any] = []
    seen = set()
    for value in found[::-1]:
        # 1 and true are equal to Python, lists have no hash
        known = (type(value) is bool, repr(value) if isinstance(value, list | dict) else value)
        if value is not None and known not in seen:
            seen.add(known)
            kept.append(value)
    return kept or None


def count_distinct(found: Sequence[Any]) -> int:
    return len(distinct(found) or ())


def seconds_between(start_us: int | None, end_us: int | None) -> float | None:
    return None if start_us is None or end_us is None else (end_us - start_us) / 1_000_000


NAVIGATION: Mapping[str, Callable[..., Value]] = {"first": first, "last": last}
AGGREGATES: Mapping[str, Callable[[Sequence[Any]], Value]] = {
    "count": count,
    "sum": total,
    "avg": average,
    "min": _furthest(min),
    "max": _furthest(max),
    "array": array,
    "distinct": distinct,
    "count_distinct": count_distinct,
}
