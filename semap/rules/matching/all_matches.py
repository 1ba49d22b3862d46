"""A row pattern of which all matches are wanted, where conditions ask the row alone and the one window is of
the match.

There, what may follow depends on where a chain of bound rows stands, not on what it is made of: the outlooks
of its runs are its **place**. All chains at one place are one set (`chains`), which a row takes on as a
whole, and a chain is at one place only, so that none is found twice. A row costs as much for two as for
2^1000.

Matches are walked through when they end, as many as the rule wants told; of the others it is known how many
there are. That number is kept by sums: each set counts the chains that began since the sums were last made,
and how many ways lead to it from each set of that time, of which it was counted with which rows they began.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from operator import add
from typing import NamedTuple

from semap.model.given_up import MOST_UNDER_WAY
from semap.rules.matching.attempt import Ending
from semap.rules.matching.automaton import FOREVER_US, Automaton, Outlook
from semap.rules.matching.chains import Chains, Link, counts, firsts, joined, needed, renumbered, walk
from semap.rules.matching.chains_json import dump_chains, load_chains
from semap.rules.matching.telling import Teller
from semap.rules.program import Match
from semap.rules.row import Row

UNDER_WAY_AT_MOST = MOST_UNDER_WAY
PLACES_AT_MOST = TURNS_AT_MOST = 1_000
PRUNED_AFTER = 4
"""Windows after which a key is looked at again only to forget what has ended."""

SPARE_PARTS = 64
"""So many parts of chains that are needed no more do not matter."""


class Part(NamedTuple):
    """What becomes of the chains at a place: with the row as this variable, or without it (None).

    place  where they stand then; None: nowhere
    ends   whether they are matches then
    """

    variable: str | None
    place: Place | None
    ends: bool


class Place:
    """The outlooks of the runs that a chain has.

    asked  the conditions that they ask, as bits
    turns  what a row does, by the answers to those; None where it does nothing
    """

    __slots__ = ("asked", "outlooks", "turns")

    def __init__(self, outlooks: Sequence[Outlook]) -> None:
        self.outlooks = outlooks
        self.asked = 0
        for outlook in outlooks:
            for bit, _ in outlook.simple:
                self.asked |= bit
        self.turns: dict[int, tuple[Part, ...] | None] = {}


@dataclass(slots=True)
class Standing:
    """The chains at one place.

    fresh  how many of them began since the sums were made
    ways   how many lead here from a chain that stood at each place when the sums were made
    """

    place: Place
    chains: Chains
    fresh: int
    ways: tuple[int, ...]


@dataclass(slots=True)
class AllState:
    """What is under way in one key. One that was stepped is spent.

    firsts  the rows with which chains began; the first of them has the number `oldest`
    sums    of each place at a time: how many chains had begun with row 0 or later, with row 1 or later ...
    summed  the number of the first row after that time
    made    the parts of chains, each after those that it is made of, and others that are needed no more
    most    so many of them, and it is time to leave out those
    """

    standings: tuple[Standing, ...]
    firsts: deque[Row]
    oldest: int
    sums: tuple[list[int], ...]
    summed: int
    made: list[Chains]
    most: int

    def count(self, standing: Standing) -> int:
        """How many chains stand there."""
        if self.oldest >= self.summed:
            return standing.fresh
        old = sum(ways * sums[self.oldest] for ways, sums in zip(standing.ways, self.sums, strict=True))
        return standing.fresh + old


class AllMatchesProgram:
    """Implements `LossyProgram`. Frozen but for what it remembers of what it has worked out already."""

    def __init__(self, automaton: Automaton, telling: Teller, *, at_most: int, clears: bool) -> None:
        self.automaton = automaton
        self.given_up: list[Row] = []
        self.untold: list[tuple[Row, int]] = []
        self._at_most, self._clears = at_most, clears
        self._pruned_us = PRUNED_AFTER * automaton.match_us
        self._match_us = automaton.match_us
        self._tests = automaton.tests
        self._told_of = telling.all
        self._places: dict[frozenset[Outlook], Place] = {}
        self._begin = self._place((automaton.start,))

    def step(self, state: AllState | None, row: Row) -> tuple[AllState | None, tuple[Match, ...]]:
        answers = 0
        for bit, test in self._tests:
            if test(row):
                answers |= bit
        begins = self._turn(self._begin, answers)
        if state is not None:
            firsts, now_us, match_us = state.firsts, row.stamp_us, self._match_us
            while firsts and now_us - firsts[0].stamp_us >= match_us:
                firsts.popleft()
                state.oldest += 1
            if not firsts:
                state = None
        if state is None:
            return self._stepped(_nothing(), row, answers, begins) if begins else (None, ())
        if not begins and all(self._turn(each.place, answers) is None for each in state.standings):
            return state, ()
        return self._stepped(state, row, answers, begins)

    def advance(self, state: AllState | None, watermark_us: int) -> tuple[AllState | None, tuple[Match, ...]]:
        """Nothing is found when a window ends."""
        now_us = watermark_us + 1 if watermark_us < FOREVER_US else 2 * FOREVER_US
        return (None if state is None or now_us >= self._over_us(state) else state), ()

    def deadline_us(self, state: AllState | None) -> int | None:
        """Time only makes less, which can wait: most states end before that."""
        if state is None or (over_us := self._over_us(state)) >= FOREVER_US:
            return None
        return over_us - over_us % -self._pruned_us - 1

    def dump(self, state: AllState) -> object:
        left = self._summed(state)
        placed = [(each.place.outlooks, each.chains) for each in left.standings]
        return dump_chains(placed, left.made, left.firsts)

    def load(self, document: object) -> AllState:
        placed, parts, begun = load_chains(document, self.automaton)
        standings = tuple(Standing(self._place(outlooks), chains, 0, ()) for outlooks, chains in placed)
        return self._summed(AllState(standings, deque(begun), 0, (), 0, parts, 0))

    def _over_us(self, state: AllState) -> int:
        return state.firsts[-1].stamp_us + self._match_us

    def _stepped(
        self, state: AllState, row: Row, answers: int, begins: tuple[Part, ...] | None
    ) -> tuple[AllState | None, tuple[Match, ...]]:
        """The state after a row that does something."""
        if state.oldest > state.summed:
            # what began since includes chains whose windows have ended
            state = self._summed(state)
        oldest, made = state.oldest, state.made
        new: dict[Place, Standing] = {}
        ended: list[Standing] = []
        for standing in state.standings:
            if standing.chains.newest >= oldest:
                turn = self._turn(standing.place, answers)
                if turn is None:
                    _put(new, standing, made)
                else:
                    _take_on(standing, turn, row, new, ended, made)
        if begins:
            number = oldest + len(state.firsts)
            state.firsts.append(row)
            ways = (0,) * len(state.sums)
            for variable, place, ends in begins:
                assert variable is not None  # noqa: S101
                link = Link(variable, row, None, number)
                made.append(link)
                turn = (Part(None, place, ends),)
                _take_on(Standing(self._begin, link, 1, ways), turn, row, new, ended, made)
        state.standings = tuple(new.values())
        matches = self._told(state, ended, row) if ended else ()
        if not new or (ended and self._clears):
            return None, matches
        bounded = self._bounded(state)
        return bounded if bounded.standings else None, matches

    def _told(self, state: AllState, ended: Sequence[Standing], row: Row) -> tuple[Match, ...]:
        ends: list[Ending] = []
        for standing in ended:
            left = islice(walk(standing.chains, state.oldest), self._at_most - len(ends))
            ends += [Ending(row.stamp_us, first, bound) for first, bound in left]
        if len(ends) == self._at_most:
            untold = sum(map(state.count, ended)) - len(ends)
            if untold:
                self.untold.append((state.firsts[0], untold))
        return self._told_of(ends)

    def _bounded(self, state: AllState) -> AllState:
        """The state without what is needed no more, once that is much, and without what is too much."""
        is_much = len(state.firsts) > UNDER_WAY_AT_MOST or len(state.standings) > PLACES_AT_MOST
        if not is_much and len(state.made) < state.most:
            return AllState(
                state.standings, state.firsts, state.oldest, state.sums, state.summed, state.made, state.most
            )
        state = self._summed(state)
        most = len(state.firsts)
        if most <= UNDER_WAY_AT_MOST and len(state.standings) <= PLACES_AT_MOST:
            return state
        # a quarter at a time, so that what is left is not gone through again with each row
        excess = most - min(most, UNDER_WAY_AT_MOST) * 3 // 4
        self.given_up += [state.firsts.popleft() for _ in range(excess)]
        state.oldest += excess
        return self._bounded(self._summed(state))

    def _summed(self, state: AllState) -> AllState:
        """The same with the parts that are still needed alone, and with sums of them."""
        parts = needed(state.made, (each.chains for each in state.standings), state.oldest)
        live = firsts(parts)
        by_part = renumbered(parts, {number: place for place, number in enumerate(live)})
        new = list({id(each): each for each in by_part.values()}.values())
        kept = [each for each in state.standings if id(each.chains) in by_part]
        chains = [by_part[id(each.chains)] for each in kept]
        standings = tuple(
            Standing(each.place, of_place, 0, tuple(int(each is other) for other in kept))
            for each, of_place in zip(kept, chains, strict=True)
        )
        sums = tuple(counts(each, new, len(live)) for each in chains)
        begun = deque(state.firsts[number - state.oldest] for number in live)
        return AllState(standings, begun, 0, sums, len(live), new, 3 * len(new) + SPARE_PARTS)

    def _turn(self, place: Place, answers: int) -> tuple[Part, ...] | None:
        """What a row with these answers makes of the chains at a place."""
        answers &= place.asked
        if answers in place.turns:
            return place.turns[answers]
        after: dict[str | None, dict[Outlook, None]] = {}
        ending = set()
        for outlook in place.outlooks:
            moves = outlook.moves
            move = moves[answers] if answers in moves else self.automaton.move(outlook, answers)
            if move is None:
                after.setdefault(None, {})[outlook] = None
                continue
            for variable, then, ends in move:
                outlooks = after.setdefault(variable, {})
                if then is not None:
                    outlooks[then] = None
                if ends:
                    ending.add(variable)
        turn: tuple[Part, ...] | None = tuple(
            Part(variable, self._place(tuple(outlooks)) if outlooks else None, variable in ending)
            for variable, outlooks in after.items()
            if outlooks or variable in ending
        )
        if turn == (Part(None, place, False),):
            turn = None
        if len(place.turns) < TURNS_AT_MOST:
            place.turns[answers] = turn
        return turn

    def _place(self, outlooks: Sequence[Outlook]) -> Place:
        if len(self._places) >= PLACES_AT_MOST:
            self._places.clear()
        key = frozenset(outlooks)
        found = self._places.get(key)
        if found is None:
            found = self._places[key] = Place(outlooks)
        return found


def _nothing() -> AllState:
    return AllState((), deque(), 0, (), 0, [], SPARE_PARTS)


def _take_on(
    standing: Standing,
    turn: Sequence[Part],
    row: Row,
    new: dict[Place, Standing],
    ended: list[Standing],
    made: list[Chains],
) -> None:
    """Put chains where a row takes them, the matches among them into `ended`, and their parts into `made`."""
    for variable, place, ends in turn:
        chains = standing.chains
        if variable is not None:
            chains = Link(variable, row, chains, chains.newest)
            made.append(chains)
        after = Standing(place or standing.place, chains, standing.fresh, standing.ways)
        if ends:
            ended.append(after)
        if place is not None:
            _put(new, after, made)


def _put(new: dict[Place, Standing], standing: Standing, made: list[Chains]) -> None:
    """Add chains to those that stand at the same place."""
    place = standing.place
    known = new.get(place)
    if known is None:
        new[place] = standing
        return
    both = joined(standing.chains, known.chains)
    made.append(both)
    ways = tuple(map(add, known.ways, standing.ways))
    new[place] = Standing(place, both, known.fresh + standing.fresh, ways)
