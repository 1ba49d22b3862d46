"""The state of a row pattern as JSON: each row once, the chains of rows bound as a table, runs by number."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

from semap.rules.bound import Bound
from semap.rules.matching.attempt import Attempt, TimedOut
from semap.rules.matching.automaton import Automaton
from semap.rules.matching.cohorts import Cohort, CohortState, Log, Member
from semap.rules.matching.runner import Runner
from semap.rules.pattern import Excluded
from semap.rules.row import Row
from semap.rules.row_json import dump_row, load_row


class RowTable:
    """Numbers rows as they come."""

    def __init__(self) -> None:
        self.rows: list[object] = []
        self._numbers: dict[int, int] = {}

    def number(self, row: Row) -> int:
        if id(row) not in self._numbers:
            self._numbers[id(row)] = len(self.rows)
            self.rows.append(dump_row(row))
        return self._numbers[id(row)]


def dump_label(variable: str) -> object:
    """The variable, and whether its row is excluded from what is told."""
    return [variable] if isinstance(variable, Excluded) else variable


def load_label(document: object) -> str:
    """The variable that `dump_label` gave."""
    return Excluded(document[0]) if isinstance(document, list) else str(document)


class _Tables:
    """Numbers rows and chains as they come."""

    def __init__(self) -> None:
        self._rows = RowTable()
        self.row = self._rows.number
        self.rows = self._rows.rows
        self.chains: list[list[object]] = []
        self._chain_numbers: dict[int, int] = {}

    def chain(self, bound: Bound) -> int:
        new = []
        for each in bound.latest_first():
            if id(each) in self._chain_numbers:
                break
            new.append(each)
        for each in reversed(new):
            before = self._chain_numbers[id(each.before)] if each.before is not None else None
            self._chain_numbers[id(each)] = len(self.chains)
            self.chains.append([dump_label(each.variable), self.row(each.row), before])
        return self._chain_numbers[id(bound)]


def dump_state(under_way: Iterable[Attempt]) -> dict[str, object]:
    """Chains that runs share are shared again after `load_state`."""
    tables = _Tables()
    attempts = [_dump_attempt(attempt, tables) for attempt in under_way]
    return {"attempts": attempts, "rows": tables.rows, "chains": tables.chains}


def _dump_attempt(attempt: Attempt, tables: _Tables) -> dict[str, object]:
    return {
        "first": tables.row(attempt.first),
        "runs": [
            [[choice.number for choice in run.outlook.choices], tables.chain(run.bound)]
            for run in attempt.runs
        ],
        "found": attempt.found,
        "timed_out": attempt.timed_out
        and [tables.chain(attempt.timed_out.bound), attempt.timed_out.stamp_us],
    }


def dump_cohorts(state: CohortState) -> dict[str, object]:
    """Attempts as they were when they joined, the rows since, and of how many members each cohort is."""
    tables = _Tables()
    members = [member for cohort in state.cohorts for member in cohort.members]
    attempts = [_dump_attempt(member.attempt, tables) for member in members]
    log = [tables.row(row) for row in state.log.rows]
    return {
        "attempts": attempts,
        "rows": tables.rows,
        "chains": tables.chains,
        "log": log,
        "seen": [max(member.seen - state.log.first, 0) for member in members],
        "cohorts": [len(cohort.members) for cohort in state.cohorts],
    }


def load_cohorts(
    document: Mapping[str, Any], automaton: Automaton, runner: Runner
) -> tuple[list[Cohort], Log]:
    """The cohorts that `dump_cohorts` wrote."""
    rows = [load_row(row) for row in document["rows"]]
    attempts = _load_attempts(document, rows, automaton, runner)
    log = Log(runner, deque(rows[number] for number in document["log"]))
    of_all = iter(
        [Member(attempt, seen, log) for attempt, seen in zip(attempts, document["seen"], strict=True)]
    )
    cohorts = []
    for count in document["cohorts"]:
        members = deque(islice(of_all, count))
        cohorts.append(Cohort(members[-1].as_it_is(), members))
    return cohorts, log


def load_state(fields: Mapping[str, Any], automaton: Automaton, runner: Runner) -> tuple[Attempt, ...]:
    """The attempts that `dump_state` wrote."""
    rows = [load_row(row) for row in fields["rows"]]
    return _load_attempts(fields, rows, automaton, runner)


def _load_attempts(
    fields: Mapping[str, Any], rows: Sequence[Row], automaton: Automaton, runner: Runner
) -> tuple[Attempt, ...]:
    chains: list[Bound] = []
    for variable, row, before in fields["chains"]:
        label = load_label(variable)
        chains.append(Bound(label, rows[row], chains[before] if before is not None else None))
    return tuple(_load_attempt(each, rows, chains, automaton, runner) for each in fields["attempts"])


def _load_attempt(
    fields: Mapping[str, Any],
    rows: Sequence[Row],
    chains: Sequence[Bound],
    automaton: Automaton,
    runner: Runner,
) -> Attempt:
    runs = []
    for numbers, chain in fields["runs"]:
        runs.append((automaton.outlook_of(numbers), chains[chain]))
    attempt = runner.resume(rows[fields["first"]], runs, found=fields["found"])
    if fields["timed_out"] is None:
        return attempt
    chain, stamp_us = fields["timed_out"]
    return replace(attempt, timed_out=TimedOut(chains[chain], stamp_us))
