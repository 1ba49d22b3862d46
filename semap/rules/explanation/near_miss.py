"""How far a row pattern came near a moment, and what was wanting.

Each attempt is followed for itself, as if no match skipped it, for as long as it lives; the one that bound
most rows is the near miss, and of several the one nearest to the moment that is asked about.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from semap.rules.bound import Bound
from semap.rules.compilation import compile_pattern
from semap.rules.declaration import AfterMatch, Declaration, RowPattern
from semap.rules.explanation.asking import Asked, ask
from semap.rules.matching.attempt import Attempt, Run, length, path
from semap.rules.pattern import Absent, Alternation, Node, Permutation, Repeat
from semap.rules.pattern import Sequence as InOrder
from semap.rules.row import Row


@dataclass(frozen=True)
class NearMiss:
    """The furthest that an attempt came.

    bound      rows with their variables; none if no row could begin a match
    asked      for each variable that a row could have been bound to next, the row that came nearest to it
    came       rows whose absence was asked for and that came
    ended_us   when a window ended the attempt; None if a row did
    is_open    whether it was still under way when the rows were over
    """

    bound: tuple[tuple[str, Row], ...] = ()
    asked: tuple[Asked, ...] = ()
    came: tuple[Asked, ...] = ()
    ended_us: int | None = None
    is_open: bool = False


@dataclass
class _Life:
    """An attempt at its furthest. `until`: the place of the last row that it lived to see."""

    run: Run
    begun_at: int
    until: int
    by_time: bool = True
    is_open: bool = True


def find_near_miss(declaration: Declaration, rows: Sequence[Row], at_us: int) -> NearMiss:
    """What came nearest to a match of a row pattern among the rows of one key, which are in order."""
    assert isinstance(declaration.body, RowPattern)  # noqa: S101
    program = compile_pattern(declaration, declaration.body.node, AfterMatch("to next"))
    lives: dict[str, _Life] = {}
    state = None
    for place, row in enumerate(rows):
        state, _ = program.advance(state, row.stamp_us - 1)
        _note(lives, state.attempts if state is not None else (), place - 1, by_time=True)
        state, _ = program.step(state, row)
        _note(lives, state.attempts if state is not None else (), place, by_time=False)
    if not lives:
        asked = _nearest(declaration, program.automaton.start.awaited, rows, None, -1, at_us)
        return NearMiss(asked=asked)
    best = max(
        lives.values(),
        key=lambda life: (length(life.run.bound), -abs(life.run.bound.row.stamp_us - at_us)),
    )
    bound = best.run.bound
    last = next(place for place in range(len(rows) - 1, -1, -1) if rows[place] is bound.row)
    # the row that ended the attempt is the one after those that it lived to see
    seen = rows[: best.until + (1 if best.by_time else 2)]
    ended_us = best.run.deadline_us if best.by_time and not best.is_open else None
    return NearMiss(
        bound=path(bound),
        asked=_nearest(declaration, best.run.outlook.awaited, seen, bound, last, at_us),
        came=tuple(_came(declaration, declaration.body.node, seen[last + 1 :], bound)),
        ended_us=ended_us,
        is_open=best.is_open,
    )


def _note(lives: dict[str, _Life], attempts: Sequence[Attempt], place: int, *, by_time: bool) -> None:
    """Take in which attempts live, and how far they are."""
    living = {attempt.first.uid: attempt for attempt in attempts if attempt.runs}
    for uid, life in lives.items():
        if life.is_open and uid not in living:
            life.is_open, life.by_time = False, by_time
    for uid, attempt in living.items():
        furthest = max(attempt.runs, key=lambda run: length(run.bound))
        if uid not in lives:
            lives[uid] = _Life(furthest, place, place)
        elif length(furthest.bound) >= length(lives[uid].run.bound):
            lives[uid].run = furthest
        lives[uid].until = place


def _nearest(
    declaration: Declaration,
    variables: Sequence[str],
    rows: Sequence[Row],
    bound: Bound | None,
    last: int,
    at_us: int,
) -> tuple[Asked, ...]:
    """Of each variable, the row after the last one bound that fails in fewest parts of its condition."""
    found = []
    for variable in variables:
        asked = [
            ask(variable, declaration.define.get(variable), row, bound, rows[place - 1] if place else None)
            for place, row in enumerate(rows)
            if place > last
        ]
        if asked:
            found.append(min(asked, key=lambda each: (each.failed, abs(each.row.stamp_us - at_us))))
    return tuple(found)


def _came(declaration: Declaration, node: Node, rows: Sequence[Row], bound: Bound) -> Iterator[Asked]:
    """The first row of each kind that was to be absent."""
    for name in dict.fromkeys(_unwanted(node)):
        for row in rows:
            asked = ask(name, declaration.define.get(name), row, bound, None)
            if asked.holds:
                yield asked
                break


def _unwanted(node: Node) -> Iterator[str]:
    """The conditions that rows are not to satisfy."""
    match node:
        case Absent(name):
            yield name
        case InOrder(elements):
            for element in elements:
                yield from _unwanted(element.node)
        case Alternation(nodes) | Permutation(nodes):
            for each in nodes:
                yield from _unwanted(each)
        case Repeat(node=inner, until=until):
            if until is not None:
                yield until
            yield from _unwanted(inner)
