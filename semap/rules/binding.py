"""What conditions and measures ask of the rows bound so far; null where a variable has bound none."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from semap.cql2.value import json_at, number_of, text_of
from semap.rules.bound import Bound
from semap.rules.row import Row, Value


def last(bound: Bound | None, variable: str, name: str) -> Value:
    while bound is not None:
        if bound.variable == variable:
            return bound.row.values.get(name)
        bound = bound.before
    return None


def first(bound: Bound | None, variable: str, name: str) -> Value:
    row: Row | None = None
    while bound is not None:
        if bound.variable == variable:
            row = bound.row
        bound = bound.before
    return None if row is None else row.values.get(name)


def _known(bound: Bound | None, variable: str, name: str, keys: Sequence[str]) -> list[Any]:
    """Of the rows bound to the variable, the latest first, what is not null."""
    found = []
    while bound is not None:
        if bound.variable == variable:
            value = bound.row.values.get(name)
            if keys:
                value = json_at(value, keys)
            if value is not None:
                found.append(value)
        bound = bound.before
    return found


def _numbers(bound: Bound | None, variable: str, name: str, keys: Sequence[str]) -> list[float]:
    numbers = map(number_of, _known(bound, variable, name, keys))
    return [number for number in numbers if number is not None]


def count(bound: Bound | None, variable: str, name: str, keys: Sequence[str]) -> int:
    return len(_known(bound, variable, name, keys))


def _sum(numbers: Sequence[float]) -> float | None:
    """The same in whatever order; null where there is none, or where no float holds it."""
    try:
        return math.fsum(numbers) if numbers else None
    except OverflowError:
        return None


def total(bound: Bound | None, variable: str, name: str, keys: Sequence[str]) -> float | None:
    return _sum(_numbers(bound, variable, name, keys))


def average(bound: Bound | None, variable: str, name: str, keys: Sequence[str]) -> float | None:
    numbers = _numbers(bound, variable, name, keys)
    found = _sum(numbers)
    return None if found is None else found / len(numbers)


def _furthest(of: Callable[[list[Any]], Any]) -> Callable[..., Value]:
    def furthest(bound: Bound | None, variable: str, name: str, keys: Sequence[str]) -> Value:
        values = _known(bound, variable, name, keys)
        # JSON may hold both; texts count where there is no number
        for kind in (number_of, text_of):
            found = [value for value in values if kind(value) is not None]
            if found:
                return of(found)
        return None

    return furthest


def seconds_between(start_us: int | None, end_us: int | None) -> float | None:
    return None if start_us is None or end_us is None else (end_us - start_us) / 1_000_000


NAVIGATION: Mapping[str, Callable[..., Value]] = {"first": first, "last": last}
AGGREGATES: Mapping[str, Callable[..., Value]] = {
    "count": count,
    "sum": total,
    "avg": average,
    "min": _furthest(min),
    "max": _furthest(max),
}
