"""The frozen automaton of a pattern: what a run may do at the next row, and what each row makes of that.

A run stands at an **outlook**: an ordered tuple of choices, each to take a row as a variable (`Take`) or to
end (`Finish`). A row is asked the conditions of the outlook; the answers, one bit for each, decide the
**move**: an ordered tuple of outcomes, each the next outlook of a run that has taken the row, ended or passed
over it.
Outlooks are made when first reached and are compared by identity: runs at one outlook have one future, as far
as conditions read no bindings and windows count from the first row. Moves are remembered with the outlook.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from semap.errors import InvalidInput
from semap.rules.bound import Asked, Bound, Condition
from semap.rules.declaration import Windows
from semap.rules.matching.follow import END, Following, Frame, Position, Step, positions
from semap.rules.matching.neighbours import begins_partition
from semap.rules.pattern import Joint, Node
from semap.rules.row import Row

BEGINS, BEGINS_NOT = "^", "not ^"
FOREVER_US = 2**63 - 1
"""No stamp comes to it: at it, or beyond it, ends what has no window."""


@dataclass(frozen=True, eq=False, slots=True)
class Take:
    """A row may be bound to the variable. Conditions are bits of the answers.

    number    in `Automaton.choices`
    element   the part of the pattern that the joint belongs to
    needs     what the row taken satisfies
    bars      what it does not satisfy
    kills     what no row from now to it satisfies, `kills_once`: nor the very next row
    reach_us  how far after the row bound before [us], exclusive
    later     this choice after one row was passed over
    """

    number: int
    position: int
    variable: str
    joint: Joint
    element: int
    needs: int
    bars: int
    kills: int
    kills_once: int
    reach_us: int
    later: Take | None = None

    def takes(self, answers: int) -> bool:
        return not self.needs & ~answers and not self.bars & answers


@dataclass(frozen=True, eq=False, slots=True)
class Finish:
    """The run may end here: at once, or once the windows of absences have ended.

    waits     of each absence how long after the last row [us]; None: as long as the whole match may last
    stamped   those of them at whose end the match stands; of none it stands at its last row
    certain   whether nothing has to be waited for any more
    complete  this choice when it has waited long enough
    """

    number: int
    kills: int
    kills_once: int
    waits: tuple[int | None, ...]
    certain: bool
    later: Finish | None = None
    complete: Finish | None = None
    stamped: tuple[int | None, ...] = ()


Choice: TypeAlias = Take | Finish


class Outcome(NamedTuple):
    """What one run becomes.

    variable  that the row is bound to; None: it is not bound
    outlook   None if nothing can follow
    ends      where all matches are wanted: how the run ends here as well
    """

    variable: str | None
    outlook: Outlook | None
    ends: tuple[Finish, ...] = ()


Move: TypeAlias = tuple[Outcome, ...]


class Question(NamedTuple):
    """A condition that reads bindings or has a window of its own, and its bit among the answers."""

    bit: int
    variable: str
    condition: Condition
    within_us: int


class Outlook:
    """What a run may do at the next row, in order of preference.

    simple     bits and tests that ask the row alone
    questions  the others
    moves      by the answers
    may_finish  whether it may end here, at once or when windows end
    final      the choice by which a run here has ended for certain; it is the only one then
    """

    __slots__ = ("choices", "final", "from_first", "may_finish", "moves", "questions", "simple")

    def __init__(
        self,
        choices: tuple[Choice, ...],
        simple: tuple[tuple[int, Callable[[Row], bool]], ...],
        questions: tuple[Question, ...],
    ) -> None:
        self.choices = choices
        self.simple = simple
        self.questions = questions
        self.moves: dict[int, Move | None] = {}
        preferred = choices[0] if choices else None
        self.may_finish = any(isinstance(choice, Finish) for choice in choices)
        self.final = preferred if isinstance(preferred, Finish) and preferred.certain else None
        self.from_first = self.final is None and all(
            choice.reach_us == FOREVER_US if isinstance(choice, Take) else set(choice.waits) <= {None}
            for choice in choices
        )

    @property
    def awaited(self) -> tuple[str, ...]:
        """The variables that a row may be bound to next, preferred first."""
        return tuple(dict.fromkeys(choice.variable for choice in self.choices if isinstance(choice, Take)))


class Automaton:
    """A compiled pattern.

    keep_all  whether all matches are wanted, not only the preferred one of each start
    start     the outlook at which each row may begin a run
    may_be_empty  whether a match may bind no row
    asked     which of the rows bound conditions ask; None: it may be all
    by_first_row  whether conditions ask the row alone and windows count from the first row
    """

    def __init__(
        self, pattern: Node, conditions: Mapping[str, Condition], windows: Windows, *, keep_all: bool
    ) -> None:
        self._conditions = {**conditions, **ANCHORS}
        self._windows = windows
        self._keep_all = keep_all
        self._bits: dict[str, int] = {}
        self._elements: dict[Frame | None, int] = {}
        self._outlooks: dict[tuple[Choice, ...], tuple[Outlook | None, tuple[Finish, ...]]] = {}
        self.match_us = windows.match_us if windows.match_us is not None else FOREVER_US
        self.choices: list[Choice] = []
        following = Following(pattern)
        start = following.start()
        _refuse_absent(start)
        steps = positions(following)
        numbers = {position: number for number, position in enumerate(steps)}
        begin = tuple(self._choice(step, numbers) for step in start)
        self._after = tuple(tuple(self._choice(step, numbers) for step in after) for after in steps.values())
        outlook, self._empty = self.outlook(begin)
        self.start = outlook or Outlook((), (), ())
        self._begin = begin if self._empty else self.start.choices
        self.may_be_empty = any(isinstance(choice, Finish) for choice in begin)
        self.reads_bindings = any(
            self._conditions[name].test is None for name in self._bits if name in self._conditions
        )
        asking = [self._conditions[name] for name in self._bits if name in self._conditions]
        self.asked = _all_asked([each.asked for each in asking if each.test is None])
        self.counts_from_last = windows.step_us is not None or bool(windows.variables)
        self.waits = any(isinstance(choice, Finish) and not choice.certain for choice in self.choices)
        self.by_first_row = not (
            self.reads_bindings
            or self.counts_from_last
            or any(isinstance(choice, Finish) and not set(choice.waits) <= {None} for choice in self.choices)
        )

    def _bit(self, name: str) -> int:
        return self._bits.setdefault(name, 1 << len(self._bits))

    def _mask(self, names: Iterable[str]) -> int:
        mask = 0
        for name in names:
            mask |= self._bit(name)
        return mask

    def _choice(self, step: Step, numbers: Mapping[Position, int]) -> Choice:
        between = step.between
        kills = self._mask((*(name for name, once in between.absences if not once), *step.staying))
        kills_once = self._mask(name for name, once in between.absences if once)
        if step.to is None:
            return self._finish(step, kills, kills_once)
        variable = step.to.variable
        step_us = self._windows.step_us if self._windows.step_us is not None else FOREVER_US
        take = Take(
            number=len(self.choices),
            position=numbers[step.to],
            variable=variable,
            joint=between.joint,
            element=self._elements.setdefault(between.element, len(self._elements)),
            needs=self._mask(self._needed(variable, begins=between.begins)),
            bars=self._mask(step.entering),
            kills=kills,
            kills_once=0,
            reach_us=min(step_us, self._own_us(variable) or FOREVER_US),
        )
        return self._with_once(take, kills_once)

    def _own_us(self, variable: str) -> int | None:
        return self._windows.variables.get(variable)

    def _needed(self, variable: str, *, begins: bool) -> Iterator[str]:
        if variable in self._conditions or self._own_us(variable):
            yield variable
        if begins:
            yield BEGINS

    def _finish(self, step: Step, kills: int, kills_once: int) -> Choice:
        absent = [name for name, _ in step.between.absences]
        waits = tuple(self._own_us(name) for name in absent)
        stamped = tuple(self._own_us(name) for name in absent if name != END)
        if None in stamped and self._windows.match_us is None:
            name = next(name for name in absent if name != END and self._own_us(name) is None)
            raise InvalidInput(
                f"The pattern may end in the absence of {name}, but no window says how long that is to last.",
                "Give `within`, or within of that variable.",
            )
        complete = Finish(len(self.choices), 0, 0, waits, certain=True, stamped=stamped)
        self.choices.append(complete)
        number = len(self.choices)
        if waits:
            finish = Finish(number, kills, 0, waits, certain=False, complete=complete, stamped=stamped)
            return self._with_once(finish, kills_once)
        if step.between.begins:
            begins_not = self._mask([BEGINS_NOT])
            first = Finish(number, 0, begins_not, (), certain=False, later=complete, complete=complete)
            self.choices.append(first)
            return first
        return complete

    def _with_once(self, later: Choice, kills_once: int) -> Choice:
        """The choice as it is before the first row."""
        self.choices.append(later)
        if not kills_once:
            return later
        number = len(self.choices)
        first: Choice
        if isinstance(later, Take):
            first = _replaced(later, number, kills_once)
        else:
            first = Finish(
                number, later.kills, kills_once, later.waits, False, later, later.complete, later.stamped
            )
        self.choices.append(first)
        return first

    def outlook(self, choices: tuple[Choice, ...]) -> tuple[Outlook | None, tuple[Finish, ...]]:
        """The outlook of these choices, and where all matches are wanted the certain ends among them."""
        found = self._outlooks.get(choices)
        if found is None:
            found = self._outlooks[choices] = self._new_outlook(choices)
        return found

    def outlook_of(self, numbers: Iterable[int]) -> Outlook:
        """The outlook of the choices with these numbers."""
        outlook, _ = self.outlook(tuple(self.choices[number] for number in numbers))
        assert outlook is not None  # noqa: S101
        return outlook

    def _new_outlook(self, choices: tuple[Choice, ...]) -> tuple[Outlook | None, tuple[Finish, ...]]:
        ends = tuple(choice for choice in choices if isinstance(choice, Finish) and choice.certain)
        if ends and self._keep_all:
            left = tuple(choice for choice in choices if choice not in ends)
            return self.outlook(left)[0], ends
        if ends and choices[-1] is not ends[0]:
            # what is less preferred than an end that is certain is never chosen
            return self.outlook(choices[: choices.index(ends[0]) + 1])
        if not choices:
            return None, ()
        asked = 0
        for choice in choices:
            asked |= choice.kills | choice.kills_once
            if isinstance(choice, Take):
                asked |= choice.needs | choice.bars
        return Outlook(choices, tuple(self._simple(asked)), tuple(self._questions(asked))), ()

    def _simple(self, asked: int) -> Iterator[tuple[int, Callable[[Row], bool]]]:
        for name, bit in self._bits.items():
            test = self._conditions[name].test if name in self._conditions else _anything
            if bit & asked and test is not None and self._own_us(name) is None:
                yield bit, test

    def _questions(self, asked: int) -> Iterator[Question]:
        for name, bit in self._bits.items():
            condition = self._conditions.get(name, ANYTHING)
            own_us = self._own_us(name)
            if bit & asked and (condition.test is None or own_us is not None):
                yield Question(bit, name, condition, own_us if own_us is not None else FOREVER_US)

    @property
    def tests(self) -> tuple[tuple[int, Callable[[Row], bool]], ...]:
        """The conditions that ask the row alone, with their bits."""
        return tuple(self._simple((1 << len(self._bits)) - 1))

    def move(self, outlook: Outlook, answers: int) -> Move | None:
        """What a row with these answers makes of a run; None: what it was."""
        choices = self._begin if outlook is self.start else outlook.choices
        live = [choice for choice in choices if not answers & (choice.kills | choice.kills_once)]
        satisfied = {choice.element for choice in live if isinstance(choice, Take) and choice.takes(answers)}
        move = []
        for choice in live:
            if choice in self._empty:
                move.append(Outcome(None, None, (choice,)))
            elif isinstance(choice, Finish):
                move.append(Outcome(None, *self.outlook((choice.later or choice,))))
            elif choice.takes(answers):
                move.append(Outcome(choice.variable, *self.outlook(self._after[choice.position])))
        passed = tuple(
            choice.later or choice
            for choice in live
            if isinstance(choice, Take)
            and (choice.joint == "any" or (choice.joint == "relaxed" and choice.element not in satisfied))
        )
        if passed:
            move.append(Outcome(None, *self.outlook(passed)))
        unchanged = len(move) == 1 and move[0] == Outcome(None, outlook)
        outlook.moves[answers] = found = None if unchanged else tuple(move)
        return found

    def end_us(self, choice: Choice, first_us: int, last_us: int) -> int:
        """When a choice is no longer open: its window has ended, or all that it waits for [us]."""
        if isinstance(choice, Take):
            return min(first_us + self.match_us, last_us + choice.reach_us)
        if not choice.waits:
            return last_us
        return max(first_us + self.match_us if wait is None else last_us + wait for wait in choice.waits)

    def stamp_us(self, finish: Finish, first_us: int, last_us: int) -> int:
        """The stamp of a match that ends so [us]."""
        if not finish.stamped:
            return last_us
        return max(first_us + self.match_us if wait is None else last_us + wait for wait in finish.stamped)

    def expired(self, outlook: Outlook, bound: Bound, first_us: int, now_us: int) -> Outcome:
        """What time alone makes of a run: no more row comes with a stamp before now."""
        last_us = bound.row.stamp_us
        left: list[Choice] = []
        for choice in outlook.choices:
            if now_us < self.end_us(choice, first_us, last_us):
                left.append(choice)
            elif isinstance(choice, Finish):
                left.append(choice.complete or choice)
        return Outcome(None, *self.outlook(tuple(left)))

    def deadline_us(self, outlook: Outlook, first_us: int, last_us: int) -> int:
        """When time alone changes a run first."""
        if outlook.final is not None:
            return FOREVER_US
        if outlook.from_first:
            return first_us + self.match_us
        return min(
            self.end_us(choice, first_us, last_us)
            for choice in outlook.choices
            if isinstance(choice, Take) or not choice.certain
        )


def _all_asked(asked: Iterable[frozenset[Asked] | None]) -> tuple[Asked, ...] | None:
    found: dict[Asked, None] = {}
    for each in asked:
        if each is None:
            return None
        found |= dict.fromkeys(each)
    return tuple(found)


def _anything(_row: Row) -> bool:
    return True


ANYTHING = Condition(_anything, lambda _row, _bound: True)
"""The condition of a variable that has none."""

ANCHORS: Mapping[str, Condition] = {
    BEGINS: Condition(begins_partition, lambda row, _bound: begins_partition(row)),
    BEGINS_NOT: Condition(
        lambda row: not begins_partition(row), lambda row, _bound: not begins_partition(row)
    ),
}


def _replaced(take: Take, number: int, kills_once: int) -> Take:
    return Take(
        number=number,
        position=take.position,
        variable=take.variable,
        joint=take.joint,
        element=take.element,
        needs=take.needs,
        bars=take.bars,
        kills=take.kills,
        kills_once=kills_once,
        reach_us=take.reach_us,
        later=take,
    )


def _refuse_absent(start: tuple[Step, ...]) -> None:
    for step in start:
        if step.between.absences:
            name = step.between.absences[0][0]
            raise InvalidInput(
                f"The pattern begins with the absence of {name}, before which there is no row.",
                "Begin with the row after which it is to be absent.",
            )
