"""What one key of a formula's rule remembers, and the same as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import TypeAlias, cast

from semap.rules.formula import Formula
from semap.rules.interval.holding import Subject
from semap.rules.row import Row
from semap.rules.row_json import dump_row, load_row
from semap.rules.temporal.forecast import Forecast
from semap.rules.temporal.formula_json import dump_formula, load_formula
from semap.rules.temporal.metric import Signals
from semap.rules.temporal.spans import Span

Lasting: TypeAlias = tuple[Row, Span]
"""A row, and from when to when what it began lasts; until inf while it does."""

Change: TypeAlias = tuple[str, Row]
"""An atom, and the row that made it true or false."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The formula asked of the moment of a row.

    rest      what is left to ask of that moment
    forecast  its verdict if nothing changes; None: not known yet, or none ever
    """

    row: Row
    rest: Formula
    forecast: Forecast | None = None


@dataclass(frozen=True, slots=True)
class FormulaState:
    """What one key remembers.

    moment_us    stamp of the latest row that mattered
    settled      whether all rows of that moment are known, and the forecasts are of it
    change       the latest change of an atom in that moment while it is not settled
    holding      the atoms that hold by each subject
    signals      when each atom was true, as far as an evaluation may still ask
    evaluations  in the order of their rows
    lasting      where atoms ask of the row that began an evaluation: what began with which row, and its span
    """

    moment_us: int
    settled: bool
    change: Change | None = None
    holding: Mapping[Subject, tuple[str, ...]] = field(default_factory=dict)
    signals: Signals = field(default_factory=dict)
    evaluations: tuple[Evaluation, ...] = ()
    lasting: tuple[Lasting, ...] = ()


def dump_state(state: FormulaState) -> dict[str, object]:
    """The state as JSON; a span that is open has no end."""
    return {
        "moment_us": state.moment_us,
        "settled": state.settled,
        "change": None if state.change is None else [state.change[0], dump_row(state.change[1])],
        "holding": [[list(subject), list(names)] for subject, names in state.holding.items()],
        "signals": {
            name: [[start, None if end == inf else end] for start, end in spans]
            for name, spans in state.signals.items()
        },
        "evaluations": [
            [
                dump_row(each.row),
                dump_formula(each.rest),
                None if each.forecast is None else [each.forecast.verdict, each.forecast.certain_us],
            ]
            for each in state.evaluations
        ],
        "lasting": [
            [dump_row(row), start, None if end == inf else end] for row, (start, end) in state.lasting
        ],
    }


def load_state(document: object) -> FormulaState:
    """The state that `dump_state` gave."""
    found = cast(Mapping[str, object], document)
    change = cast("Sequence[object] | None", found["change"])
    return FormulaState(
        moment_us=cast(int, found["moment_us"]),
        settled=cast(bool, found["settled"]),
        change=None if change is None else (cast(str, change[0]), load_row(change[1])),
        holding={
            cast(Subject, tuple(subject)): cast("tuple[str, ...]", tuple(names))
            for subject, names in cast(Sequence[Sequence[Sequence[object]]], found["holding"])
        },
        signals={
            name: tuple((start, inf if end is None else end) for start, end in spans)
            for name, spans in cast(
                Mapping[str, Sequence[tuple[float, float | None]]], found["signals"]
            ).items()
        },
        evaluations=tuple(
            Evaluation(
                load_row(row),
                load_formula(rest),
                None if forecast is None else Forecast(*cast(tuple[bool, int], tuple(forecast))),
            )
            for row, rest, forecast in cast(
                Sequence[tuple[object, object, Sequence[object] | None]], found["evaluations"]
            )
        ),
        lasting=tuple(
            (load_row(row), (start, inf if end is None else end))
            for row, start, end in cast(Sequence[tuple[object, float, float | None]], found["lasting"])
        ),
    )
