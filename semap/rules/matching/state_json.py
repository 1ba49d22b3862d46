"""The state of a row pattern as JSON: each row once, the chains of rows bound as a table, runs by number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from semap.rules.bound import Bound
from semap.rules.matching.attempt import Attempt, TimedOut
from semap.rules.matching.automaton import Automaton
from semap.rules.matching.runner import Runner
from semap.rules.row import Row
from semap.rules.row_json import dump_row, load_row


class _Tables:
    """Numbers rows and chains as they come."""

    def __init__(self) -> None:
        self.rows: list[object] = []
        self.chains: list[tuple[str, int, int | None]] = []
        self._row_numbers: dict[int, int] = {}
        self._chain_numbers: dict[int, int] = {}

    def row(self, row: Row) -> int:
        if id(row) not in self._row_numbers:
            self._row_numbers[id(row)] = len(self.rows)
            self.rows.append(dump_row(row))
        return self._row_numbers[id(row)]

    def chain(self, bound: Bound) -> int:
        new = []
        for each in bound.latest_first():
            if id(each) in self._chain_numbers:
                break
            new.append(each)
        for each in reversed(new):
            before = self._chain_numbers[id(each.before)] if each.before is not None else None
            self._chain_numbers[id(each)] = len(self.chains)
            self.chains.append((each.variable, self.row(each.row), before))
        return self._chain_numbers[id(bound)]


def dump_state(under_way: Sequence[Attempt], row_before: Row | None) -> object:
    """Chains that runs share are shared again after `load_state`."""
    tables = _Tables()
    attempts = [
        {
            "first": tables.row(attempt.first),
            "runs": [
                [[choice.number for choice in run.outlook.choices], tables.chain(run.bound)]
                for run in attempt.runs
            ],
            "found": attempt.found,
            "timed_out": attempt.timed_out
            and [tables.chain(attempt.timed_out.bound), attempt.timed_out.stamp_us],
        }
        for attempt in under_way
    ]
    before = tables.row(row_before) if row_before is not None else None
    return {
        "attempts": attempts,
        "before": before,
        "rows": tables.rows,
        "chains": [list(chain) for chain in tables.chains],
    }


def load_state(
    document: object, automaton: Automaton, runner: Runner
) -> tuple[tuple[Attempt, ...], Row | None]:
    """The attempts and the row before that `dump_state` wrote."""
    fields = cast(Mapping[str, Any], document)
    rows = [load_row(row) for row in fields["rows"]]
    chains: list[Bound] = []
    for variable, row, before in fields["chains"]:
        chains.append(Bound(variable, rows[row], chains[before] if before is not None else None))
    attempts = tuple(_load_attempt(each, rows, chains, automaton, runner) for each in fields["attempts"])
    return attempts, rows[fields["before"]] if fields["before"] is not None else None


def _load_attempt(
    fields: Mapping[str, Any],
    rows: Sequence[Row],
    chains: Sequence[Bound],
    automaton: Automaton,
    runner: Runner,
) -> Attempt:
    runs = []
    for numbers, chain in fields["runs"]:
        outlook, _ = automaton.outlook(tuple(automaton.choices[number] for number in numbers))
        assert outlook is not None  # noqa: S101
        runs.append((outlook, chains[chain]))
    attempt = runner.resume(rows[fields["first"]], runs, found=fields["found"])
    if fields["timed_out"] is None:
        return attempt
    chain, stamp_us = fields["timed_out"]
    return replace(attempt, timed_out=TimedOut(chains[chain], stamp_us))
