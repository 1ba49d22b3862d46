"""States of tracks from JSON: one state, a list of states (rows), or one object of lists (columns).

    {"track": "cat", "stamp": "2026-01-31T12:00:00Z", "x_m": 1.0, "y_m": 2.0}
    {"track": ["cat", "dog"], "stamp": "2026-01-31T12:00:00Z", "x_m": [1.0, 3.0], "y_m": [2.0, 4.0]}

Both say the same members, those of a state (semap/model/track_state), so that both are read as columns. In
place of `stamp` there may be `stamp_us`, microseconds since 1970.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.timeline.stamp import parse_stamp
from semap_ingest.named_states import EARLIEST_US, VALUES, NamedStates, Refused

KEYS = frozenset({"track", "stamp", "stamp_us", "is_last", *VALUES})
NUMBERS = {int, float, type(None)}
COLUMNS_REMEDY = "Give each member a list with a value for each state, or one value for all."
NONE_US = EARLIEST_US - 1
"""In place of a stamp that there is not."""
LARGEST_US = 2**62


def states_of(value: object) -> tuple[NamedStates, list[Refused]]:
    """The states, and what is wrong with those that are none.

    raises  InvalidInput where the whole is no state, no list of states and no columns
    """
    if isinstance(value, Mapping):
        if any(isinstance(each, list) for each in value.values()):
            return _of_columns(value)
        return _of_rows([value])
    if isinstance(value, list):
        return _of_rows(value)
    raise InvalidInput(
        f"{_shown(value)} is no state of a track",
        'Give {"track": ..., "stamp": ..., "x_m": ..., "y_m": ...}.',
    )


def states_of_lines(lines: Sequence[bytes]) -> tuple[NamedStates, list[Refused]]:
    """Of newline-delimited JSON, a state each; empty lines are passed over."""
    rows: list[object] = []
    try:
        rows = json.loads(b"[" + b",".join(line for line in lines if line.strip()) + b"]")
    except (ValueError, RecursionError):
        for line in lines:
            if line.strip():
                try:
                    rows.append(json.loads(line))
                except (ValueError, RecursionError) as error:
                    rows.append(_Unreadable(f"{error}"))
    return _of_rows(rows)


class _Unreadable(str):
    """What is wrong with a line that is no JSON."""


def _of_rows(rows: Sequence[object]) -> tuple[NamedStates, list[Refused]]:
    refused: list[Refused] = []
    index = [number for number, row in enumerate(rows) if isinstance(row, dict)]
    for number, row in enumerate(rows):
        if isinstance(row, _Unreadable):
            refused.append(Refused(number, "not JSON", str(row)))
        elif not isinstance(row, dict):
            refused.append(Refused(number, "no state", f"{_shown(row)} is no object"))
    good: list[dict[str, object]] = [rows[number] for number in index]  # type: ignore[misc]
    keys = set(chain.from_iterable(good))
    if not keys <= KEYS:
        refused += [
            Refused(number, "unknown member", f"{', '.join(sorted(row.keys() - KEYS)[:3])}")
            for number, row in zip(index, good, strict=True)
            if not row.keys() <= KEYS
        ]
        index, good = _kept(index, good, [row.keys() <= KEYS for row in good])
        keys &= KEYS
    return _read({key: [row.get(key) for row in good] for key in keys}, index, refused)


def _of_columns(given: Mapping[str, object]) -> tuple[NamedStates, list[Refused]]:
    unknown = sorted(given.keys() - KEYS)
    if unknown:
        raise InvalidInput(f"unknown: {', '.join(unknown[:3])}", f"Known are {', '.join(sorted(KEYS))}.")
    counts = {len(each) for each in given.values() if isinstance(each, list)}
    if len(counts) > 1:
        raise InvalidInput(f"columns of {min(counts)} and of {max(counts)} values", COLUMNS_REMEDY)
    (count,) = counts
    columns = {
        key: each if isinstance(each, list) else [each] * count
        for key, each in given.items()
        if each is not None
    }
    return _read(columns, list(range(count)), [])


def _read(
    columns: Mapping[str, list[object]], index: list[int], refused: list[Refused]
) -> tuple[NamedStates, list[Refused]]:
    count = len(index)
    is_good = np.ones(count, dtype=np.bool_)

    def refuse(row: int, reason: str, detail: str) -> None:
        if is_good[row]:
            is_good[row] = False
            refused.append(Refused(index[row], reason, detail))

    names = columns.get("track", [None] * count)
    if set(map(type, names)) != {str}:
        for row, name in enumerate(names):
            if not isinstance(name, str):
                refuse(row, "no name of a track", f"{_shown(name)} is no text")
    stamp_us = _stamps(columns, count, refuse)
    values = {name: _numbers(name, columns[name], refuse) for name in VALUES if name in columns}
    is_last = np.zeros(count, dtype=np.bool_)
    for row, said in enumerate(columns.get("is_last", ())):
        if isinstance(said, bool):
            is_last[row] = said
        elif said is not None:
            refuse(row, "is_last is no truth", _shown(said))
    states = NamedStates(names, stamp_us, values, is_last, np.array(index, dtype=np.int64))  # type: ignore[arg-type]
    if not is_good.all():
        states = states.take(np.flatnonzero(is_good))
    return states, sorted(refused, key=lambda each: each.index)


def _numbers(name: str, column: list[object], refuse: Refuse) -> NDArray[np.float64]:
    if set(map(type, column)) <= NUMBERS:
        try:
            return np.array(column, dtype=np.float64)
        except OverflowError:
            pass
    values = np.full(len(column), np.nan)
    for row, value in enumerate(column):
        if type(value) not in NUMBERS:
            refuse(row, f"{name} is no number", _shown(value))
        elif value is not None:
            try:
                values[row] = float(value)  # type: ignore[arg-type]
            except OverflowError:
                refuse(row, f"{name} out of range", _shown(value))
    return values


def _stamps(columns: Mapping[str, list[object]], count: int, refuse: Refuse) -> NDArray[np.int64]:
    stamps = np.full(count, NONE_US, dtype=np.int64)
    given_us = columns.get("stamp_us", [None] * count)
    texts = columns.get("stamp", [None] * count)
    if set(map(type, given_us)) == {int} and all(each is None for each in texts):
        try:
            return np.array(given_us, dtype=np.int64)
        except OverflowError:
            pass
    known: dict[str, int] = {}
    for row, (text, number) in enumerate(zip(texts, given_us, strict=True)):
        if isinstance(text, str) and number is None:
            try:
                stamps[row] = known[text] if text in known else known.setdefault(text, parse_stamp(text))
            except InvalidInput as error:
                refuse(row, "no stamp", str(error))
        elif type(number) is int and text is None and abs(number) < LARGEST_US:
            stamps[row] = number
        else:
            said = text if number is None else number
            refuse(row, "no stamp", f"{_shown(said)}: give stamp as 2026-01-31T12:00:00Z, or stamp_us")
    return stamps


class Refuse(Protocol):
    """Notes what is wrong with a row: the reason, and in detail."""

    def __call__(self, row: int, reason: str, detail: str, /) -> None: ...


def _kept(
    index: list[int], rows: list[dict[str, object]], is_kept: Iterable[bool]
) -> tuple[list[int], list[dict[str, object]]]:
    both = [(number, row) for number, row, kept in zip(index, rows, is_kept, strict=True) if kept]
    return [number for number, _ in both], [row for _, row in both]


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
