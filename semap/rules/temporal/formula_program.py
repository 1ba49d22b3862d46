"""A formula of metric temporal logic, asked from rows on.

An atom is true while some interval of its variable holds. The rows of one stamp are one moment: what is true
at it is known when the watermark has reached it or a later row has come. Then what was begun to be asked is
progressed to that moment, and its verdict is forecast as if nothing changed any more; so a verdict comes at
the moment at which it is certain, whether a row or the passing of time made it so, and no cut through the
stream moves it.

With `when`, an evaluation begins at each row of which its condition is true; if the formula has an atom of
this name, only at those that begin an interval of it. Without, one begins at the first row of the key, and
the next at the row that comes after its verdict. What is asked is the formula at the moment of that row.

An atom may ask of the row at which the formula is asked: `track_id <> S.track_id`. It is then true for an
evaluation while an interval lasts whose first row satisfies that; so one formula says somebody else, or
nobody else, of each row anew. What lasts is kept with the rows that began it, instead of as signals. So it is
for what stands in `exists L`, of whose intervals it may ask (`quantifiers`).

Where the formula looks back, what it asks of was false before the first row of the key.

Bounds of memory: what holds now; each evaluation until its verdict, at most MOST_EVALUATIONS in a key (the
oldest one goes first, without a verdict, and is noted); the signals from the first moment that matters to
one of them (see semap.rules.temporal.progression), or to one that begins now. A key that nothing holds in is
forgotten once it is too long ago for the formula to look back to; never, if that has no bound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, isinf

from semap.model.given_up import MOST_UNDER_WAY
from semap.rules.bound import Bound, Condition
from semap.rules.finish import Finish, finished
from semap.rules.formula import Formula
from semap.rules.interval.holding import Subject, begins, begun, satisfies, subject_of
from semap.rules.program import Match
from semap.rules.row import Row
from semap.rules.temporal.forecast import Forecast, forecast
from semap.rules.temporal.formula_state import (
    Change,
    Evaluation,
    FormulaState,
    Lasting,
    dump_state,
    load_state,
)
from semap.rules.temporal.metric import (
    ROWS,
    Signals,
    Truth,
    atom_names,
    back_us,
    has_previous,
    known_until,
    name_of,
    quantified,
    truth_of,
)
from semap.rules.temporal.progression import interest_us, progressed
from semap.rules.temporal.quantifiers import variables_of, written_out
from semap.rules.temporal.spans import Spans, clipped, union
from semap.rules.temporal.tautology import without_tautologies

MOST_EVALUATIONS = MOST_UNDER_WAY


@dataclass(frozen=True)
class FormulaProgram:
    """`formula`, asked of each row that satisfies `when`.

    conditions  of the atoms, asked of the row that begins an interval; of `when`, asked of any row
    emits       names of the events `holds` and `fails`; either may be left out

    A match has the row that began the evaluation, bound to `when` (or to the empty name), and the row that
    decided it (of several at that moment the last), bound to the atom that it changed; none where time did.

    given_up  the rows that began evaluations that were given up, as there were too many; to be cleared
    """

    formula: Formula
    when: str | None
    conditions: Mapping[str, Condition]
    emits: Mapping[str, str]
    finish: Finish
    given_up: list[Row] = field(default_factory=list, compare=False)

    @cached_property
    def _asked(self) -> Formula:
        return without_tautologies(self.formula)

    @cached_property
    def _counts_rows(self) -> bool:
        return has_previous(self._asked)

    @cached_property
    def _back_us(self) -> float:
        return back_us(self._asked)

    @cached_property
    def _looks_back(self) -> bool:
        return self._counts_rows or self._back_us > 0

    @cached_property
    def _relative(self) -> Mapping[str, Condition]:
        """The atoms that ask of the row at which the formula is asked, and the variables of quantifiers."""
        found = {name: self.conditions.get(name) for name in atom_names(self.formula)}
        variables = variables_of(self.formula)
        return {
            name: each
            for name, each in found.items()
            if each is not None and (each.test is None or name in variables)
        }

    @cached_property
    def _atoms(self) -> Mapping[str, Condition | None]:
        names = (name for name in atom_names(self.formula) if name not in self._relative)
        return {name: self.conditions.get(name) for name in names}

    def step(self, state: FormulaState | None, row: Row) -> tuple[FormulaState | None, tuple[Match, ...]]:
        """Take the next row of the key."""
        given = self.advance(state, row.stamp_us - 1)
        before, matches = given
        if before is None:
            before = FormulaState(row.stamp_us, True)
        names = begun(row, self._atoms)
        holding = _held(before.holding, subject_of(row), names)
        lasting = _lasting(before.lasting, row) if self._relative else ()
        changed = _changed(before.holding, holding)
        if lasting != before.lasting:
            changed = {**dict.fromkeys(self._relative, True), **changed}
        starts = self._starts(row, names, before)
        if not changed and holding == before.holding and not starts and not self._counts_rows:
            return given
        evaluations = before.evaluations
        if starts:
            kept = evaluations[-MOST_EVALUATIONS + 1 :]
            self.given_up.extend(each.row for each in evaluations[: len(evaluations) - len(kept)])
            evaluations = (*kept, Evaluation(row, self._asked))
        change = before.change if row.stamp_us == before.moment_us else None
        plain = {name: true for name, true in changed.items() if name in self._atoms}
        signals = _signals(before.signals, plain, row.stamp_us)
        if self._counts_rows:
            changed = changed or {ROWS: True}
            signals = {**signals, ROWS: union([*signals.get(ROWS, ()), (row.stamp_us, row.stamp_us + 1)])}
        if changed and before.evaluations:
            change = next(iter(changed)), row
        state = FormulaState(
            moment_us=row.stamp_us,
            settled=not evaluations or (before.settled and not starts and not changed),
            change=change,
            holding=holding,
            signals=signals,
            evaluations=evaluations,
            lasting=lasting,
        )
        return self._remembered(state), matches

    def advance(
        self, state: FormulaState | None, watermark_us: int
    ) -> tuple[FormulaState | None, tuple[Match, ...]]:
        """Know that every row to come has a stamp after the watermark."""
        if state is None or (not state.settled and watermark_us < state.moment_us):
            return state, ()
        change = None if state.settled else state.change
        expected = {each.row.order: each.forecast for each in state.evaluations}
        if not state.settled:
            state = self._settled(state)
        due = [
            (each.forecast, each)
            for each in state.evaluations
            if each.forecast is not None and each.forecast.certain_us <= watermark_us
        ]
        if not due:
            return self._still_asked(state, watermark_us), ()
        due.sort(key=lambda pair: (pair[0].certain_us, pair[1].row.order))
        matches = tuple(
            match
            for found, each in due
            # What was to come anyhow at this moment is not the doing of a row.
            for match in self._matches(found, each, None if expected[each.row.order] == found else change)
        )
        gone = {each.row.order for _, each in due}
        left = tuple(each for each in state.evaluations if each.row.order not in gone)
        return self._remembered(replace(state, evaluations=left)), matches

    def deadline_us(self, state: FormulaState | None) -> int | None:
        """The moment whose rows are not all known yet; else when the first verdict is certain."""
        if state is None:
            return None
        if not state.settled:
            return state.moment_us
        due_us = [each.forecast.certain_us for each in state.evaluations if each.forecast is not None]
        if not state.evaluations and not state.holding and all(end < inf for _, (_, end) in state.lasting):
            due_us = [us for us in (self._forgotten_us(state),) if us is not None]
        return min(due_us, default=None)

    def dump(self, state: FormulaState) -> object:
        """The state as JSON."""
        return dump_state(state)

    def load(self, document: object) -> FormulaState:
        """The state that `dump` gave."""
        return load_state(document)

    def _starts(self, row: Row, names: tuple[str, ...], state: FormulaState) -> bool:
        """Whether an evaluation begins at the row, which begins intervals of these atoms."""
        if self.when is None:
            return not state.evaluations
        if self.when in self._atoms:
            return self.when in names
        return satisfies(row, self.when, self.conditions.get(self.when))

    def _settled(self, state: FormulaState) -> FormulaState:
        """The state once all rows of its moment are known: progressed to it, with forecasts."""
        names = (*self._atoms, ROWS) if self._counts_rows else self._atoms
        signals = {name: state.signals.get(name, ()) for name in names}
        known_us = state.moment_us + 1
        evaluations = []
        for each in state.evaluations:
            at_us, rest = each.row.stamp_us, each.rest
            # Without a change the forecasts still stand.
            if state.change is not None or at_us == state.moment_us:
                own: dict[str, Spans] = {**signals}
                atoms = self._atoms_of(each, state.lasting, own, known_us)
                rest = progressed(rest, at_us, atoms)
                plain = self._written_out(rest, each.row, state.lasting, own)
                evaluations.append(Evaluation(each.row, rest, forecast(plain, at_us, own, known_us)))
            else:
                evaluations.append(each)
        settled = replace(state, settled=True, change=None, evaluations=tuple(evaluations))
        return self._remembered(settled) or settled

    def _remembered(self, state: FormulaState) -> FormulaState | None:
        """The state without what no evaluation, begun or to come, can ask for; None where nothing is left."""
        holds_any = state.holding or any(end == inf for _, (_, end) in state.lasting)
        if not state.evaluations and not holds_any and not self._looks_back:
            return None
        rows = state.signals.get(ROWS, ())
        asked = [interest_us(each.rest, each.row.stamp_us, rows) for each in state.evaluations]
        since_us = min([*asked, state.moment_us])
        if self._looks_back:
            since_us = min(since_us, interest_us(self._asked, state.moment_us, rows))
        kept = {name: clipped(spans, since_us, inf) for name, spans in state.signals.items()}
        lasting = tuple(each for each in state.lasting if each[1][1] > since_us)
        return replace(state, signals={name: spans for name, spans in kept.items() if spans}, lasting=lasting)

    def _written_out(
        self, rest: Formula, asked: Row, lasting: Sequence[Lasting], signals: dict[str, Spans]
    ) -> Formula:
        """A formula by what its atoms are of a row at which it is asked; adds their signals."""
        if not self._relative:
            return rest
        return written_out(rest, Bound(self.when or "", asked), lasting, self._relative, signals)

    def _atoms_of(
        self, evaluation: Evaluation, lasting: Sequence[Lasting], signals: dict[str, Spans], known_us: int
    ) -> Mapping[str, Truth]:
        """The truth of all atoms, and of what is quantified, as far as it is known; adds their signals."""
        parts = quantified(evaluation.rest)
        plain = {name_of(each): self._written_out(each, evaluation.row, lasting, signals) for each in parts}
        self._written_out(evaluation.rest, evaluation.row, lasting, signals)
        atoms = known_until(signals, known_us)
        return {**atoms, **{name: truth_of(each, atoms) for name, each in plain.items()}}

    def _still_asked(self, state: FormulaState, watermark_us: int) -> FormulaState | None:
        """None where nothing is under way, and too much time has passed to look back."""
        if state.evaluations or state.holding or any(end == inf for _, (_, end) in state.lasting):
            return state
        forgotten_us = self._forgotten_us(state)
        return None if forgotten_us is not None and forgotten_us <= watermark_us else state

    def _forgotten_us(self, state: FormulaState) -> int | None:
        """When what was true is too long ago to be asked for; None: never."""
        if isinf(self._back_us):
            return None
        return state.moment_us + int(self._back_us)

    def _matches(self, found: Forecast, evaluation: Evaluation, change: Change | None) -> tuple[Match, ...]:
        """The match of a verdict; `change` is the latest one of the moment that has just been settled."""
        rows = [(self.when or "", evaluation.row)]
        if (
            change is not None
            and change[1].stamp_us == found.certain_us
            and change[1].order > evaluation.row.order
        ):
            rows.append(change)
        match_type = self.emits.get("holds" if found.verdict else "fails")
        return finished(match_type, rows, found.certain_us, self.finish)


def _held(
    holding: Mapping[Subject, tuple[str, ...]], subject: Subject | None, names: tuple[str, ...]
) -> Mapping[Subject, tuple[str, ...]]:
    """What holds after a row of a subject that begins these: all that held by the subject ends at it."""
    if subject is None or (not names and subject not in holding):
        return holding
    others = {each: held for each, held in holding.items() if each != subject}
    return {**others, subject: names} if names else others


def _lasting(lasting: tuple[Lasting, ...], row: Row) -> tuple[Lasting, ...]:
    """What lasts after a row: what its subject did ends, and what it does begins."""
    subject = subject_of(row)
    if subject is None:
        return lasting
    left = [
        (each, (start, row.stamp_us if end == inf and subject_of(each) == subject else end))
        for each, (start, end) in lasting
    ]
    kept = [each for each in left if each[1][0] < each[1][1]]
    return (*kept, (row, (row.stamp_us, inf))) if begins(row) else tuple(kept)


def _changed(
    before: Mapping[Subject, tuple[str, ...]], after: Mapping[Subject, tuple[str, ...]]
) -> Mapping[str, bool]:
    """The atoms that became true or false."""
    if before is after:
        return {}
    was = {name for names in before.values() for name in names}
    now = {name for names in after.values() for name in names}
    return {name: name in now for name in sorted(was ^ now)}


def _signals(signals: Signals, changed: Mapping[str, bool], stamp_us: int) -> Signals:
    """The signals with these changes."""
    changes = {
        name: union([*signals.get(name, ()), (stamp_us, inf)])
        if true
        else clipped(signals.get(name, ()), -inf, stamp_us)
        for name, true in changed.items()
    }
    return {**signals, **changes} if changes else signals
