"""Why a row pattern found nothing at a moment: how far attempts came that were under way then, and what ended
them.

Each attempt is followed for itself, as if no match skipped it and nothing were too unsure, for as long as it
lives. One that came to a match that the rule did not give says most; else the one that was under way at the
moment and bound most rows; else, where none was, the one that is nearest to it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf

from semap.rules.bound import Bound, chained
from semap.rules.compilation import compile_attempts, neighbours_of
from semap.rules.confidence import confidence_of
from semap.rules.declaration import AfterMatch, Declaration, RowPattern
from semap.rules.explanation.asking import Asked, ask
from semap.rules.explanation.moment import Moment
from semap.rules.matching.attempt import Attempt, Run, length, path
from semap.rules.pattern import Absent, Alternation, Node, Permutation, Repeat
from semap.rules.pattern import Sequence as InOrder
from semap.rules.program import Match
from semap.rules.row import Row


@dataclass(frozen=True)
class NearMiss:
    """The furthest that an attempt came.

    bound       rows with their variables; none if no row could begin a match
    asked       for each variable that a row could have been bound to next, the row that came nearest to it
    came        rows whose absence was asked for and that came
    ended_us    when a window ended the attempt
    ended_by    the row that ended it; neither: it is complete, or is_open
    is_open     whether it was still under way when the rows were over
    given_up    whether it was given up because too much was under way
    others      how many other attempts were under way at the moment, none of which came further
    beginning   where none was under way at the moment: what rows of the moment lacked to begin one
    is_distant  whether none was
    matched_us  when it was complete, of a match that the rule did not give
    skipped_by  the match that the rule gave instead
    confidence  of a match that was too unsure
    """

    bound: tuple[tuple[str, Row], ...] = ()
    asked: tuple[Asked, ...] = ()
    came: tuple[Asked, ...] = ()
    ended_us: int | None = None
    ended_by: Row | None = None
    is_open: bool = False
    given_up: bool = False
    others: int = 0
    beginning: tuple[Asked, ...] = ()
    is_distant: bool = False
    matched_us: int | None = None
    skipped_by: Match | None = None
    confidence: float | None = None

    @property
    def says_more(self) -> bool:
        """Whether it is of something else than a match that the moment lies in."""
        return not self.is_distant and self.skipped_by is None and bool(self.bound)


@dataclass
class _Life:
    """An attempt at its furthest. `until`: the place of the last row that it lived to see."""

    run: Run
    begun_at: int
    until: int
    by_time: bool = True
    is_open: bool = True


def find_near_miss(
    declaration: Declaration, of_key: Sequence[Row], moment: Moment, found: Sequence[Match], until_us: int
) -> NearMiss | None:
    """What came nearest to a match of a row pattern at a moment, among the rows of one key, in their order.

    found     what the rule gives of these rows
    until_us  up to which stamp they are all there
    returns  None where all that was under way at the moment was found
    """
    assert isinstance(declaration.body, RowPattern)  # noqa: S101
    # every match, whatever the rule makes of it
    bare = replace(declaration, emit={"match": "match"}, confidence=None, measures={}, each_row=False)
    rows = [*neighbours_of(declaration, declaration.body.node).all_told(of_key)]
    program = compile_attempts(bare, declaration.body.node, AfterMatch("to next"))
    lives: dict[str, _Life] = {}
    matches: list[Match] = []
    state = None
    for place, row in enumerate(rows):
        state, new = program.advance(state, row.stamp_us - 1)
        matches += new
        _note(lives, state.attempts if state is not None else (), place - 1, by_time=True)
        state, new = program.step(state, row)
        matches += new
        _note(lives, state.attempts if state is not None else (), place, by_time=False)
    state, new = program.advance(state, until_us)
    matches += new
    _note(lives, state.attempts if state is not None else (), len(rows) - 1, by_time=True)
    was_found = {match.rows[0][1].uid for match in found if match.rows}
    lost = [match for match in matches if match.rows[0][1].uid not in was_found]
    at_moment = [match for match in lost if moment.meets(match.rows[0][1].stamp_us, match.stamp_us)]
    if at_moment:
        return _lost(declaration, min(at_moment, key=lambda match: moment.away_us(match.stamp_us)), found)
    complete = {match.rows[0][1].uid for match in matches}
    alive = {uid: life for uid, life in lives.items() if moment.meets(*_span(life, rows))}
    if alive and alive.keys() <= complete:
        return None
    lives = {uid: life for uid, life in lives.items() if uid not in complete}
    alive = {uid: life for uid, life in alive.items() if uid not in complete}
    beginning: tuple[Asked, ...] = ()
    if not alive:
        there = [row for row in rows if moment.has(row.stamp_us)] if lives else rows
        beginning = _nearest(declaration, program.automaton.start.awaited, there, None, -1, moment)
    if not lives:
        return NearMiss(asked=beginning)
    best = max((alive or lives).values(), key=lambda life: _nearness(life, rows, moment))
    near_miss = _miss(declaration, best, rows, moment)
    return replace(
        near_miss,
        given_up=near_miss.bound[0][1] in program.given_up,
        others=max(len(alive) - 1, 0),
        beginning=beginning,
        is_distant=not alive,
    )


def _span(life: _Life, rows: Sequence[Row]) -> tuple[float, float]:
    """From when to when an attempt was under way [us]."""
    if life.is_open:
        end_us: float = inf
    else:
        end_us = life.run.deadline_us if life.by_time else rows[life.until + 1].stamp_us
    return rows[life.begun_at].stamp_us, end_us


def _nearness(life: _Life, rows: Sequence[Row], moment: Moment) -> tuple[float, int, int]:
    """The greater, the more an attempt says of a moment."""
    begun_us, end_us = _span(life, rows)
    outside_us = max(begun_us - moment.until_us, moment.from_us - end_us, 0)
    return -outside_us, length(life.run.bound), -moment.away_us(life.run.bound.row.stamp_us)


def _lost(declaration: Declaration, match: Match, found: Iterable[Match]) -> NearMiss:
    """A match that the rule did not give, and why."""
    first_us = match.rows[0][1].stamp_us
    skipped_by = next(
        (each for each in found if each.rows and each.rows[0][1].stamp_us <= first_us <= each.stamp_us), None
    )
    confidence = None
    bound = chained(match.rows)
    if skipped_by is None and declaration.confidence is not None and bound is not None:
        confidence = confidence_of(declaration.confidence, bound)
    return NearMiss(bound=match.rows, matched_us=match.stamp_us, skipped_by=skipped_by, confidence=confidence)


def _miss(declaration: Declaration, life: _Life, rows: Sequence[Row], moment: Moment) -> NearMiss:
    """How far an attempt came, and what ended it."""
    assert isinstance(declaration.body, RowPattern)  # noqa: S101
    bound = life.run.bound
    last = next(place for place in range(len(rows) - 1, -1, -1) if rows[place] is bound.row)
    # the row that ended the attempt is the one after those that it lived to see
    seen = rows[: life.until + (1 if life.by_time else 2)]
    is_over = not life.is_open
    return NearMiss(
        bound=path(bound),
        asked=_nearest(declaration, life.run.outlook.awaited, seen, bound, last, moment),
        came=tuple(_came(declaration, declaration.body.node, seen[last + 1 :], bound)),
        ended_us=life.run.deadline_us if is_over and life.by_time else None,
        ended_by=rows[life.until + 1] if is_over and not life.by_time else None,
        is_open=life.is_open,
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
    moment: Moment,
) -> tuple[Asked, ...]:
    """Of each variable, the row after the last one bound that fails in fewest parts of its condition."""
    found = []
    for variable in variables:
        asked = [
            ask(variable, declaration.define.get(variable), row, bound)
            for place, row in enumerate(rows)
            if place > last
        ]
        if asked:
            found.append(min(asked, key=lambda each: (each.failed, moment.away_us(each.row.stamp_us))))
    return tuple(found)


def _came(declaration: Declaration, node: Node, rows: Sequence[Row], bound: Bound) -> Iterator[Asked]:
    """The first row of each kind that was to be absent."""
    for name in dict.fromkeys(_unwanted(node)):
        for row in rows:
            asked = ask(name, declaration.define.get(name), row, bound)
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
