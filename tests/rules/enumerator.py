"""All matches of a row pattern in a finite stream, by trying everything: the definition, made to run.

Nothing here is shared with the engine. A word of the pattern laid over rows is a candidate; candidates are
compared row by row.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cmp_to_key
from math import inf

from rules.words import Item, words

from semap.rules import pattern as p
from semap.rules.bound import Bound, Condition
from semap.rules.declaration import AfterMatch, Windows
from semap.rules.row import Row


@dataclass(frozen=True)
class Found:
    """rows: (variable, place in the stream)"""

    kind: str
    stamp_us: int
    rows: tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Candidate:
    """A beginning of a word, or a whole one, laid over rows."""

    items: tuple[Item, ...]
    places: tuple[int, ...]
    start: int
    absences: tuple[tuple[str, str | None], ...] | None = None
    stamp_us: float = 0

    @property
    def rows(self) -> tuple[tuple[str, int], ...]:
        if not self.places:
            return (("", self.start),)
        return tuple((item.variable, place) for item, place in zip(self.items, self.places, strict=True))


class Enumerator:
    def __init__(
        self, node: p.Node, conditions: Mapping[str, Condition], windows: Windows, rows: Sequence[Row]
    ) -> None:
        self.conditions = conditions
        self.windows = windows
        self.rows = rows
        self.match_us = inf if windows.match_us is None else windows.match_us
        self.step_us = inf if windows.step_us is None else windows.step_us
        # what could still be bound after the last row tells whether a window ended it: one item more than rows
        self.ranks: dict[tuple[Item, ...], dict[object, int]] = {}
        for rank, word in enumerate(words(node, (), len(rows) + 1)):
            for done, item in enumerate(word.items):
                self.ranks.setdefault(word.items[:done], {}).setdefault(item, rank)
            if not word.cut:
                self.ranks.setdefault(word.items, {}).setdefault(word.absences, rank)

    def find(self, after: AfterMatch, *, times_out: bool) -> list[Found]:
        """By stamp, first row, preference."""
        found: list[tuple[int, Found]] = []
        next_start = 0
        for start in range(len(self.rows)):
            if start < next_start:
                continue
            candidates = self.candidates(start)
            best = candidates if after.skip == "none" else candidates[:1]
            found += [
                (start, Found("match" if each.places else "empty", int(each.stamp_us), each.rows))
                for each in best
            ]
            if not best and times_out and (partial := self.timed_out(start)) is not None:
                found.append((start, partial))
            if best:
                next_start = skip(after, best[0])
        found.sort(key=lambda each: (each[1].stamp_us, each[0]))
        return [each for _, each in found]

    def candidates(self, start: int) -> list[Candidate]:
        whole: dict[tuple[object, ...], Candidate] = {}
        nothing = Candidate((), (), start)
        ended = [ended for partial in (nothing, *self.partials(start)) for ended in self.ends(partial)]
        for each in sorted(ended, key=cmp_to_key(self.compare)):
            whole.setdefault((each.rows, each.stamp_us), each)
        return list(whole.values())

    def partials(self, start: int) -> list[Candidate]:
        """Every beginning of a word over rows from this one on that obeys what there is to obey."""
        found = []
        reached = [Candidate((), (), start)]
        while reached:
            partial = reached.pop()
            if partial.items:
                found.append(partial)
            for item in self.nexts(partial):
                places = range(partial.places[-1] + 1, len(self.rows)) if partial.places else (start,)
                for place in places:
                    if self.in_windows(partial, place) and self.allows(partial, item, place):
                        reached.append(Candidate((*partial.items, item), (*partial.places, place), start))
        return found

    def nexts(self, partial: Candidate) -> list[Item]:
        return [
            each
            for each in self.ranks.get(partial.items, ())
            if isinstance(each, Item) and self.may_stand(partial, each.absences)
        ]

    @staticmethod
    def may_stand(partial: Candidate, absences: tuple[tuple[str, str | None], ...]) -> bool:
        """Whether anchors among them may: no row before the first is an end, and after it none begins."""
        names = {name for name, _ in absences}
        return "^" not in names if partial.places else "$" not in names

    def chain(self, partial: Candidate) -> Bound | None:
        chain = None
        for variable, place in partial.rows if partial.places else ():
            chain = Bound(variable, self.rows[place], chain)
        return chain

    def holds(self, name: str, partial: Candidate, place: int) -> bool:
        """Whether the condition is true of the row, asked as if bound to it after the rows of the candidate."""
        row = self.rows[place]
        if partial.places:
            gap_us = row.stamp_us - self.rows[partial.places[-1]].stamp_us
            if gap_us >= self.windows.variables.get(name, inf):
                return False
        if name not in self.conditions:
            return True
        return self.conditions[name].test_bound(row, Bound(name, row, self.chain(partial)))

    def in_windows(self, partial: Candidate, place: int) -> bool:
        if not partial.places:
            return True
        stamp_us = self.rows[place].stamp_us
        return (
            stamp_us - self.rows[partial.places[0]].stamp_us < self.match_us
            and stamp_us - self.rows[partial.places[-1]].stamp_us < self.step_us
        )

    def allows(self, partial: Candidate, item: Item, place: int) -> bool:
        """Whether the item may bind the row next after those of the candidate."""
        if not self.could_bind(partial, item, place):
            return False
        if not partial.places:
            return True
        passed = range(partial.places[-1] + 1, place)
        if item.joint == "next":
            return not passed
        if item.joint == "any":
            return True
        group = [other for other in self.nexts(partial) if other.element == item.element]
        return not any(self.could_bind(partial, other, earlier) for earlier in passed for other in group)

    def could_bind(self, partial: Candidate, item: Item, place: int) -> bool:
        """All but the joint and the windows that are the same for all."""
        if place > 0 and any(name == "^" for name, _ in item.absences):
            return False
        if not self.holds(item.variable, partial, place):
            return False
        if any(self.holds(name, partial, place) for _, name in item.scopes):
            return False
        return not self.killed(partial, item, place + 1)

    def killed(self, partial: Candidate, item: Item, end: int) -> bool:
        """Whether a row after the last bound, before `end`, rules the item out for good."""
        if not partial.places:
            return False
        begin = partial.places[-1] + 1
        if self.disturbed(partial, item.absences, end):
            return True
        staying = [name for scope, name in item.scopes if (scope, name) in partial.items[-1].scopes]
        return any(self.holds(name, partial, place) for name in staying for place in range(begin, end))

    def disturbed(self, partial: Candidate, absences: tuple[tuple[str, str | None], ...], end: int) -> bool:
        begin = partial.places[-1] + 1
        return any(
            self.holds(name, partial, place)
            for name, joint in absences
            for place in (range(begin, min(begin + 1, end)) if joint == "next" else range(begin, end))
        )

    def ends(self, partial: Candidate) -> Iterator[Candidate]:
        last_us = self.rows[(partial.places or (partial.start,))[-1]].stamp_us
        for absences in self.ranks.get(partial.items, ()):
            if isinstance(absences, Item) or not self.may_stand(partial, absences):
                continue
            if not partial.places:
                if not absences or partial.start == 0:
                    yield replace(partial, absences=absences, stamp_us=last_us)
                continue
            if all(self.absent(partial, absence) for absence in absences):
                ends_us = [self.absent_until_us(partial, name) for name, _ in absences if name != "$"]
                yield replace(partial, absences=absences, stamp_us=max(ends_us, default=last_us))

    def absent_until_us(self, partial: Candidate, name: str) -> float:
        own_us = self.windows.variables.get(name)
        if own_us is not None:
            return self.rows[partial.places[-1]].stamp_us + own_us
        return self.rows[partial.places[0]].stamp_us + self.match_us

    def absent(self, partial: Candidate, absence: tuple[str, str | None]) -> bool:
        until_us = self.absent_until_us(partial, absence[0])
        end = next((place for place, row in enumerate(self.rows) if row.stamp_us >= until_us), len(self.rows))
        return not self.disturbed(partial, (absence,), max(end, partial.places[-1] + 1))

    def compare(self, one: Candidate, other: Candidate) -> int:
        """Negative if `one` is preferred: row by row, what each does with it."""
        items: tuple[Item, ...] = ()
        for place in range(one.start, len(self.rows) + 1):
            what, what_else = self.does(one, items, place), self.does(other, items, place)
            if what != what_else:
                return -1 if self.rank(items, what) < self.rank(items, what_else) else 1
            if isinstance(what, Item):
                items = (*items, what)
        return 0

    @staticmethod
    def does(candidate: Candidate, items: tuple[Item, ...], place: int) -> object:
        """The item that takes the row, "ignored", or what the candidate has ended with."""
        if place in candidate.places:
            return candidate.items[candidate.places.index(place)]
        if candidate.absences is not None and (not candidate.places or place > candidate.places[-1]):
            return candidate.absences
        return "ignored"

    def rank(self, items: tuple[Item, ...], what: object) -> float:
        return inf if what == "ignored" else self.ranks[items][what]

    def timed_out(self, start: int) -> Found | None:
        """Of a start without a match, whose last candidates were ended by a window."""
        under_way: list[tuple[float, Candidate]] = []
        closed_us = -inf
        for partial in self.partials(start):
            for item in self.nexts(partial):
                end_us, by_row = self.open_until(partial, item)
                if by_row:
                    closed_us = max(closed_us, end_us)
                else:
                    under_way.append((end_us, partial))
            for absences in self.ranks.get(partial.items, ()):
                if not isinstance(absences, Item) and self.may_stand(partial, absences):
                    closed_us = max(closed_us, self.disturbed_us(partial, absences))
        last_us = max((end_us for end_us, _ in under_way), default=-inf)
        if last_us == inf or closed_us >= last_us:
            return None
        longest = max(len(partial.places) for end_us, partial in under_way if end_us == last_us)
        best = sorted(
            (
                partial
                for end_us, partial in under_way
                if end_us == last_us and len(partial.places) == longest
            ),
            key=cmp_to_key(self.compare),
        )[0]
        return Found("timeout", int(last_us), best.rows)

    def open_until(self, partial: Candidate, item: Item) -> tuple[float, bool]:
        """When the item can bind no row any more, and whether that is by a row."""
        first_us = self.rows[partial.places[0]].stamp_us
        last_us = self.rows[partial.places[-1]].stamp_us
        own_us = self.windows.variables.get(item.variable, inf)
        end_us = min(first_us + self.match_us, last_us + self.step_us, last_us + own_us)
        group = [other for other in self.nexts(partial) if other.element == item.element]
        for place in range(partial.places[-1] + 1, len(self.rows)):
            if self.rows[place].stamp_us >= end_us:
                break
            closing = (
                item.joint == "next"
                or self.killed(partial, item, place + 1)
                or (
                    item.joint == "relaxed" and any(self.could_bind(partial, other, place) for other in group)
                )
            )
            if closing:
                return self.rows[place].stamp_us, True
        return end_us, False

    def disturbed_us(self, partial: Candidate, absences: tuple[tuple[str, str | None], ...]) -> float:
        """The row that ended an absence at the end."""
        for place in range(partial.places[-1] + 1, len(self.rows)):
            if self.disturbed(partial, absences, place + 1):
                return self.rows[place].stamp_us
        return -inf


def skip(after: AfterMatch, found: Candidate) -> int:
    """The place at which the next attempt may begin."""
    if not found.places:
        return found.start + 1
    if after.skip == "past last":
        return found.places[-1] + 1
    if after.skip in ("to first", "to last"):
        bound = [place for variable, place in found.rows if variable in after.variables]
        place = (bound[0] if after.skip == "to first" else bound[-1]) if bound else found.places[0]
        return max(place, found.places[0] + 1)
    return found.places[0] + 1


def enumerate_matches(
    node: p.Node,
    conditions: Mapping[str, Condition],
    windows: Windows,
    after: AfterMatch,
    rows: Sequence[Row],
    *,
    times_out: bool = False,
) -> list[Found]:
    """All that the rule finds in the stream once it is over.

    raises  TooMany for a pattern that has too many words
    """
    return Enumerator(node, conditions, windows, rows).find(after, times_out=times_out)
