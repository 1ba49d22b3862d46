"""Why there was an event at a moment, or why there was none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from semap.errors import InvalidInput
from semap.model.given_up import GivenUp
from semap.rules.bound import Bound
from semap.rules.compilation import compile_rule
from semap.rules.condition_text import write_value
from semap.rules.declaration import Declaration, Edges, RowPattern
from semap.rules.engine.partition import part_of
from semap.rules.engine.preparation import Preparation
from semap.rules.engine.rule_run import given_up_of
from semap.rules.explanation.asking import Asked, ask
from semap.rules.explanation.moment import Moment
from semap.rules.explanation.near_miss import NearMiss, find_near_miss
from semap.rules.matching.telling import UNMATCHED
from semap.rules.program import Match, Program
from semap.rules.row import Row
from semap.timeline.stamp import to_datetime

NEAR_US = 10_000_000
SAID = ("input", "type", "track", "subject", "instance", "other", "direction")
"""Properties by which a row is told from others."""


@dataclass(frozen=True)
class Explanation:
    """What a rule found at a moment, or why it found nothing there.

    match      one in which the moment lies; None if there is none
    held       of a match: the condition of each of its rows
    near_miss  without a match, or where something else was under way at a moment within one: how far it came
    left_out   without any row of the key: the row nearest to the moment that `where` left out
    nearest    without a match: the one that is nearest to the moment, if one is near
    given_up   in this key around the moment, because too much was under way
    """

    rule_name: str
    key: Mapping[str, object]
    at_us: int
    match: Match | None = None
    held: tuple[Asked, ...] = ()
    near_miss: NearMiss | None = None
    left_out: Asked | None = None
    nearest: Match | None = None
    given_up: GivenUp | None = None

    def as_text(self) -> str:
        """For a person to read: one fact a line."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        of_key = "".join(f", {name} {value}" for name, value in self.key.items())
        yield f"Rule {self.rule_name}{of_key}, at {_at(self.at_us)}:"
        if self.match is not None:
            yield f"it found {self.match.type} at {_at(self.match.stamp_us)}."
            yield from _bound_lines(self.match.rows)
            for name, value in self.match.measures.items():
                yield f"  {name} = {write_value(value)}"
            if self.match.confidence is not None:
                yield f"  confidence {self.match.confidence:.3g}"
            for asked in self.held:
                yield from _asked_lines(asked)
            if self.near_miss is not None:
                yield "Beside that, something came to nothing at this moment."
                yield from _near_miss_lines(self.near_miss)
        elif self.near_miss is None:
            yield "it read no row of this key near that time."
            if self.left_out is not None:
                yield from _asked_lines(self.left_out)
        else:
            yield from _near_miss_lines(self.near_miss)
        if self.nearest is not None:
            yield f"The nearest that it found: {_match(self.nearest)}."
        if self.given_up is not None:
            yield f"Around that time: {self.given_up.as_text()}"


def explain(
    declaration: Declaration,
    rows: Iterable[Row],
    at_us: int,
    key: Mapping[str, object] | None = None,
    known_us: int = 0,
) -> Explanation:
    """Why a rule found something at a moment in a key, or did not.

    rows      of the rule's inputs, around the moment, with what the rule needs of them; in any order
    key       for each property of `partition_by` its value, by names: {"room": "Room07"}
    known_us  up to which stamp all rows are there
    raises    InvalidInput if the key is not that of the rule
    """
    wanted = _checked(declaration, key or {})
    preparation = Preparation(declaration)
    in_order = sorted(rows, key=lambda row: row.order)
    of_key = [row for came in in_order for row in preparation.rows(came) if _is_of(row, wanted)]
    where = [ask("where", declaration.where, row, None) for row in of_key]
    taken = [asked.row for asked in where if asked.holds]
    nothing = Explanation(declaration.name, wanted, at_us)
    if not taken:
        return replace(nothing, left_out=min(where, key=lambda asked: _away_us(asked, at_us), default=None))
    moment = Moment.at(at_us)
    program = compile_rule(declaration)
    until_us = max(taken[-1].stamp_us, moment.until_us, known_us)
    found = list(_matches(program, taken, until_us))
    nearest = min(found, key=lambda match: _outside_us(match, moment), default=None)
    lost, untold = getattr(program, "given_up", []), getattr(program, "untold", [])
    if lost or untold:
        nothing = replace(nothing, given_up=given_up_of(declaration.partition_by, lost, untold))
    in_matches = [match for match in found if match.identity != UNMATCHED]
    near_miss = _why_not(declaration, taken, moment, in_matches, until_us)
    if nearest is not None and not _outside_us(nearest, moment):
        is_its_own = nearest.identity != UNMATCHED and any(
            map(moment.has, (nearest.stamp_us, *(row.stamp_us for _, row in nearest.rows)))
        )
        beside = None if is_its_own or near_miss is None or not near_miss.says_more else near_miss
        return replace(nothing, match=nearest, held=tuple(_held(declaration, nearest)), near_miss=beside)
    if nearest is not None and _outside_us(nearest, moment) >= (declaration.within.match_us or NEAR_US):
        nearest = None
    return replace(nothing, near_miss=near_miss or NearMiss(), nearest=nearest)


def _why_not(
    declaration: Declaration, rows: Sequence[Row], moment: Moment, found: Sequence[Match], until_us: int
) -> NearMiss | None:
    if isinstance(declaration.body, RowPattern):
        return find_near_miss(declaration, rows, moment, found, until_us)
    return NearMiss(asked=tuple(_nearest(declaration, rows, moment)), is_distant=True)


def _checked(declaration: Declaration, key: Mapping[str, object]) -> dict[str, object]:
    partition_by = declaration.partition_by
    if set(key) != set(partition_by):
        example = " ".join(f"--key {name}=..." for name in partition_by)
        raise InvalidInput(
            f"the rule {declaration.name} has the key {', '.join(partition_by) or 'of all rows'}",
            f"Name each part of it: {example}" if partition_by else "Leave the key out.",
            "key",
        )
    return {name: key[name] for name in partition_by}


def _is_of(row: Row, key: Mapping[str, object]) -> bool:
    return all(
        (part := part_of(row.values, name.split("."))) is not None and str(part) == str(value)
        for name, value in key.items()
    )


def _matches(program: Program, rows: Sequence[Row], until_us: int) -> Iterator[Match]:
    state = None
    for row in rows:
        state, found = program.advance(state, row.stamp_us - 1)
        yield from found
        state, found = program.step(state, row)
        yield from found
    yield from program.advance(state, until_us)[1]


def _held(declaration: Declaration, match: Match) -> Iterator[Asked]:
    """The condition of each row of a match; of an interval, only of the row that began it."""
    bound: Bound | None = None
    begun: set[str] = set()
    for variable, row in match.rows:
        if variable in declaration.define and (
            isinstance(declaration.body, RowPattern) or variable not in begun
        ):
            yield ask(variable, declaration.define[variable], row, bound)
        begun.add(variable)
        bound = Bound(variable, row, bound)


def _outside_us(match: Match, moment: Moment) -> int:
    """How far the moment is before the first row of a match or after its end."""
    first_us = match.rows[0][1].stamp_us if match.rows else match.stamp_us
    return max(first_us - moment.until_us, moment.from_us - match.stamp_us, 0)


def _nearest(declaration: Declaration, rows: Sequence[Row], moment: Moment) -> Iterator[Asked]:
    """The condition of each variable, asked of the row that fails in fewest parts and is nearest."""
    if isinstance(declaration.body, Edges):
        yield ask("", None, min(rows, key=lambda row: moment.away_us(row.stamp_us)), None)
    for variable, condition in declaration.define.items():
        asked = [ask(variable, condition, row, None) for row in rows]
        yield min(asked, key=lambda each: (each.failed, moment.away_us(each.row.stamp_us)))


def _away_us(asked: Asked, at_us: int) -> int:
    return abs(asked.row.stamp_us - at_us)


def _near_miss_lines(near_miss: NearMiss) -> Iterator[str]:
    if near_miss.matched_us is not None:
        yield from _lost_lines(near_miss)
        return
    if near_miss.is_distant and near_miss.bound:
        yield "it found nothing: no attempt was under way at that time."
        if near_miss.beginning:
            yield "  What came nearest to beginning one:"
        for asked in near_miss.beginning:
            yield from _asked_lines(asked)
        yield "  The attempt nearest to it:"
    else:
        yield "it found nothing." + (" The furthest that it came:" if near_miss.bound else "")
    yield from _bound_lines(near_miss.bound)
    for asked in near_miss.came:
        yield f"  {asked.variable} was to be absent, but came:"
        yield from _asked_lines(asked)
    awaited = [asked for asked in near_miss.asked if not asked.holds or not near_miss.came]
    if awaited:
        yield "  What came nearest to being next:" if near_miss.bound else "  What came nearest:"
    for asked in awaited:
        yield from _asked_lines(asked)
    yield from _ending_lines(near_miss)
    if near_miss.others:
        yield f"  Other partial matches at that time, none of which matched further: {near_miss.others}."


def _ending_lines(near_miss: NearMiss) -> Iterator[str]:
    if near_miss.is_open:
        yield "  It is still under way."
    elif near_miss.given_up:
        yield "  It was given up: too much was under way in this key."
    elif near_miss.ended_us is not None:
        yield f"  Its window ended at {_at(near_miss.ended_us)}."
    elif near_miss.ended_by is not None:
        yield f"  It was ended by {_row(near_miss.ended_by)}."


def _lost_lines(near_miss: NearMiss) -> Iterator[str]:
    """Of rows that match, and of which the rule makes no event."""
    yield "it found nothing, though these rows match:"
    yield from _bound_lines(near_miss.bound)
    if near_miss.skipped_by is not None:
        yield f"  They were skipped after another match (after_match): {_match(near_miss.skipped_by)}."
        yield from _bound_lines(near_miss.skipped_by.rows)
    elif near_miss.confidence is not None:
        yield f"  It was too unsure: confidence {near_miss.confidence:.3g} is less than at_least."
    else:
        yield "  The rule makes no event of a match (emit), had given it up, or told of others at that row."


def _match(match: Match) -> str:
    return f"{match.type} at {_at(match.stamp_us)}"


def _bound_lines(rows: Iterable[tuple[str, Row]]) -> Iterator[str]:
    for variable, row in rows:
        yield f"  {variable or '-'}: {_row(row)}"


def _asked_lines(asked: Asked) -> Iterator[str]:
    yield f"  {asked.variable or '-'} {'holds' if asked.holds else 'fails'} of {_row(asked.row)}"
    for part in asked.parts:
        yield f"    {'yes' if part.holds else 'no '} {part.said}" + (f": {part.found}" if part.found else "")


def _row(row: Row) -> str:
    named = [str(row.values[name]) for name in SAID if row.values.get(name)]
    return f"{' '.join(named)} at {_at(row.own_stamp_us)}"


def _at(stamp_us: int) -> str:
    return to_datetime(stamp_us).isoformat().replace("+00:00", "Z")
