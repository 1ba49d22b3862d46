"""When a formula will be decided if nothing changes any more."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from semap.rules.formula import Formula, Future, Past
from semap.rules.temporal.metric import Signals, parts_of, verdict
from semap.rules.temporal.progression import interest_us


@dataclass(frozen=True, slots=True)
class Forecast:
    """The verdict, and the moment at which it becomes certain, if no atom changes until then."""

    verdict: bool
    certain_us: int


def forecast(formula: Formula, at_us: int, signals: Signals, known_us: int) -> Forecast | None:
    """What becomes certain of a moment if each atom stays as it is from `known_us` on; None: nothing ever."""
    bounds = _bounds(formula)
    # All windows that end have ended by then, and what is open for ever looks the same from each moment on.
    undecided, decided = known_us - 1, max(known_us, at_us) + sum(bounds) + 2 * len(bounds) + 1
    found = verdict(formula, at_us, signals, decided)
    if found is None:
        return None
    # What is certain stays so, hence the first such moment is found by halving; most often it ends a window
    # that began where the formula was asked, where it is undecided first, or just now.
    interest = min(interest_us(formula, at_us), known_us)
    begins = {at_us, known_us - 1} | ({int(interest)} if interest > -inf else set())
    likely = sorted(
        {known_us, *(begin + bound + more for begin in begins for bound in bounds for more in (0, 1))}
    )
    while decided - undecided > 1:
        likely = [each for each in likely if undecided < each < decided]
        middle = likely[len(likely) // 2] if likely else (undecided + decided) // 2
        if verdict(formula, at_us, signals, middle) is None:
            undecided = middle
        else:
            decided = middle
    return Forecast(found, decided - 1)


def _bounds(formula: Formula) -> list[int]:
    """The bounds of all windows [us]; of one without end, its start."""
    found = [bound for part in parts_of(formula) for bound in _bounds(part)]
    if isinstance(formula, Future | Past):
        found += [formula.from_us] if formula.to_us is None else [formula.from_us, formula.to_us]
    return found
