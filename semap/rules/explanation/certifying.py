"""A certificate of what a rule found in a span of time, over all keys or one, or how far it came there.

What is in one says semap.certificate, which checks it and knows nothing of what is here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

from semap.errors import InvalidInput
from semap.rules.compilation import compile_attempts, compile_rule, compile_where, neighbours_of
from semap.rules.condition import counts_matches
from semap.rules.declaration import AfterMatch, Declaration, RowPattern, TemporalFormula
from semap.rules.engine.partition import BY_ID, Key, key_reader
from semap.rules.engine.preparation import Preparation
from semap.rules.explanation.explanation import SAID
from semap.rules.matching.attempt import Run, length, path
from semap.rules.matching.neighbours import Neighbours
from semap.rules.matching.pattern_program import PatternProgram
from semap.rules.matching.telling import UNMATCHED
from semap.rules.needs import properties_read
from semap.rules.pattern import Alternation, Node, Permutation, Repeat, Variable, has_begin
from semap.rules.pattern import Sequence as InOrder
from semap.rules.program import Match, Program
from semap.rules.row import PROPERTIES, Row
from semap.rules.row_json import dump_row

VERSION = 1
ATTEMPTS_AT_MOST = 10
ALL = 10**9
ALWAYS_SAID = (*SAID, "stamp", "track_id", "instance_id", "subject_id", "other_id")


@dataclass(frozen=True)
class Span:
    """Both ends included [us]; `known_us`: up to which stamp all rows are there."""

    from_us: int
    until_us: int
    known_us: int

    def meets(self, begin_us: float, end_us: float) -> bool:
        return begin_us <= self.until_us and self.from_us <= end_us


@dataclass(frozen=True)
class _Attempt:
    """What came to nothing in a key: its rows, what could have come next, how and when it ended."""

    rows: tuple[tuple[str, Row], ...]
    awaits: tuple[str, ...]
    ended: object
    end_us: float


def certify(
    declaration: Declaration,
    rows: Iterable[Row],
    span: Span,
    key: Mapping[str, object] | None = None,
    about: Mapping[str, object] | None = None,
) -> dict[str, object]:
    """The certificate of a rule in a span, as JSON.

    rows    of the rule's inputs, around the span, with what the rule needs of them; in any order
    key     only those keys in which these properties have these values, by names: {"room": "Room07"}
    about   `map` and `version`, where they are known
    raises  InvalidInput if the rule has no such key
    """
    streams = []
    programs = _Programs(declaration)
    for of_key, found in _by_key(declaration, rows, key or {}):
        kept, events = _told(programs.rule, found, span)
        attempts = [each for each in _attempts(programs, kept, span, events) if _is_in(each, span)]
        events = [each for each in events if span.meets(*_lasts(each))]
        if events or attempts:
            streams.append((of_key, kept, events, attempts))
    streams.sort(key=lambda each: each[1][0].order)
    ranked = sorted(
        ((number, each) for number, stream in enumerate(streams) for each in stream[3]),
        key=lambda pair: (-len(pair[1].rows), pair[1].rows[0][1].order, pair[0]),
    )
    said = {*ALWAYS_SAID, *properties_read(declaration), *declaration.partition_by} & PROPERTIES.keys()
    said |= {BY_ID[name] for name in said if name in BY_ID}
    return {
        "certificate": VERSION,
        "map": None,
        "version": None,
        **(about or {}),
        "rule": {"name": declaration.name, **declaration.document},
        "key": {name: str(value) for name, value in (key or {}).items()},
        "from_us": span.from_us,
        "until_us": span.until_us,
        "known_us": span.known_us,
        "streams": [
            {"key": list(of_key), "rows": [_as_json(row, said) for row in kept]}
            for of_key, kept, *_ in streams
        ],
        "events": [_event(number, match) for number, stream in enumerate(streams) for match in stream[2]],
        "attempts": [
            {"stream": number, "rows": _bound(each.rows), "awaits": list(each.awaits), "ended": each.ended}
            for number, each in ranked[:ATTEMPTS_AT_MOST]
        ],
        "other_attempts": max(len(ranked) - ATTEMPTS_AT_MOST, 0),
    }


@dataclass(frozen=True)
class _Programs:
    """A rule, and what finds out what came of each attempt; each compiled once for all keys."""

    declaration: Declaration

    @cached_property
    def rule(self) -> Program:
        return compile_rule(self.declaration)

    @cached_property
    def _shown(self) -> Declaration:
        """In which each match is known by its first row, whether that is told or not."""
        body = self.declaration.body
        if isinstance(body, RowPattern):
            body = RowPattern(_shown(body.node))
        after_match = replace(self.declaration.after_match, at_most=ALL)
        return replace(self.declaration, body=body, after_match=after_match, measures={}, each_row=False)

    @cached_property
    def told(self) -> Program:
        return compile_rule(self._shown)

    @cached_property
    def _named(self) -> Declaration:
        """With an event of each outcome, however unsure."""
        is_formula = isinstance(self.declaration.body, TemporalFormula)
        outcomes = ("holds", "fails") if is_formula else ("match", "timeout", "empty")
        return replace(self._shown, emit={name: name for name in outcomes}, confidence=None)

    @cached_property
    def settled(self) -> Program:
        return compile_rule(self._named)

    @cached_property
    def alone(self) -> PatternProgram:
        """Each attempt by itself, as if no match skipped it."""
        assert isinstance(self._named.body, RowPattern)  # noqa: S101
        return compile_attempts(self._named, self._named.body.node, AfterMatch("to next"))


def counts_from_begin(declaration: Declaration) -> bool:
    """Whether it matters which row of a key is the first of all."""
    body = declaration.body
    is_numbered = any(map(counts_matches, declaration.measures.values()))
    return isinstance(body, RowPattern) and (is_numbered or has_begin(body.node))


def _by_key(
    declaration: Declaration, rows: Iterable[Row], wanted: Mapping[str, object]
) -> Iterator[tuple[Key, list[Row]]]:
    """The rows of each key, in order; a key is wanted where any of its rows has the names that are."""
    for name in wanted:
        if name not in declaration.partition_by:
            raise InvalidInput(
                f"{name} is not in the key of the rule {declaration.name}",
                f"Its key is {', '.join(declaration.partition_by) or 'that of all rows: leave it out'}.",
                "key",
            )
    preparation, where = Preparation(declaration), compile_where(declaration)
    key_of = key_reader(declaration.partition_by)
    found: dict[Key, list[Row]] = {}
    for came in sorted(rows, key=lambda row: row.order):
        for row in preparation.rows(came):
            key = key_of(row)
            if key is not None and (where is None or where(row)):
                found.setdefault(key, []).append(row)
    for key, of_key in found.items():
        if all(any(str(_part(row, name)) == str(value) for row in of_key) for name, value in wanted.items()):
            yield key, of_key


def _part(row: Row, name: str) -> object:
    value: object = row.values
    for part in name.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def _told(program: Program, rows: Sequence[Row], span: Span) -> tuple[list[Row], list[Match]]:
    """What the rule makes of the rows of a key, and those rows before which nothing mattered to the span."""
    state, begin, found = None, 0, list[Match]()
    for place, row in enumerate(rows):
        state, new = program.advance(state, row.stamp_us - 1)
        found += new
        if (
            state is None
            and row.stamp_us < span.from_us
            and not any(span.meets(*_lasts(each)) for each in found)
        ):
            begin, found = place, []
        state, new = program.step(state, row)
        found += new
    found += program.advance(state, span.known_us)[1]
    return list(rows[begin:]), found


def _lasts(match: Match) -> tuple[int, int]:
    stamps = [match.stamp_us, *(row.stamp_us for _, row in match.rows)]
    return min(stamps), max(stamps)


def _is_in(attempt: _Attempt, span: Span) -> bool:
    return span.meets(attempt.rows[0][1].stamp_us, attempt.end_us)


def _attempts(
    programs: _Programs, rows: Sequence[Row], span: Span, events: Sequence[Match]
) -> Iterator[_Attempt]:
    declaration = programs.declaration
    match declaration.body:
        case RowPattern(node):
            yield from _of_pattern(programs, neighbours_of(declaration, node), rows, span)
        case TemporalFormula(when=when):
            for match in _told(programs.settled, rows, span)[1]:
                if match.type not in declaration.emit or _is_unsure(declaration, match, events):
                    ended = {match.type: match.stamp_us}
                    yield _Attempt(((when or "", match.rows[0][1]),), (), ended, match.stamp_us)


def _is_unsure(declaration: Declaration, match: Match, events: Sequence[Match]) -> bool:
    return declaration.confidence is not None and not any(
        each.rows[0][1].uid == match.rows[0][1].uid and each.stamp_us == match.stamp_us for each in events
    )


@dataclass
class _Life:
    """An attempt at its furthest, and how it ended."""

    run: Run
    ended: object = "open"
    end_us: float = inf


def _of_pattern(
    programs: _Programs, neighbours: Neighbours, rows: Sequence[Row], span: Span
) -> Iterator[_Attempt]:
    """Each attempt followed for itself, as if no match skipped it, where the rule told nothing of it."""
    program = programs.alone
    lives: dict[str, _Life] = {}
    ends: list[Match] = []
    state = None
    all_told = [*neighbours.all_told(rows)]
    waiting = [
        row
        for place, row in enumerate(rows)
        if place + neighbours.ahead >= len(rows) and span.known_us + 1 - row.stamp_us < neighbours.window_us
    ]
    for row in all_told[: len(rows) - len(waiting)]:
        state, new = program.advance(state, row.stamp_us - 1)
        _note(lives, state, new, ends)
        state, new = program.step(state, row)
        _note(lives, state, new, ends, row)
    state, new = program.advance(state, min([span.known_us, *(row.stamp_us - 1 for row in waiting[:1])]))
    _note(lives, state, new, ends)
    settled = {match.rows[0][1].uid for match in _told(programs.settled, rows, span)[1]}
    told = {
        match.rows[0][1].uid for match in _told(programs.told, rows, span)[1] if match.identity != UNMATCHED
    }
    matches = {each.rows[0][1].uid: each for each in ends if each.type != "timeout"}
    for uid, match in matches.items():
        if uid in told or (match.type == "empty" and uid not in settled):
            continue
        how = "skipped" if uid not in settled else "unsure" if programs.declaration.confidence else "unnamed"
        yield _Attempt(match.rows, (), how, match.stamp_us)
    for uid, life in lives.items():
        if uid not in told and uid not in matches:
            yield _Attempt(
                path(life.run.bound), tuple(sorted(set(life.run.outlook.awaited))), life.ended, life.end_us
            )


def _shown(node: Node) -> Node:
    """The pattern with none of its rows left out."""
    match node:
        case Variable():
            return replace(node, excluded=False)
        case InOrder(elements):
            return InOrder(tuple(replace(each, node=_shown(each.node)) for each in elements))
        case Alternation(options):
            return Alternation(tuple(map(_shown, options)))
        case Permutation(nodes):
            return replace(node, nodes=tuple(map(_shown, nodes)))
        case Repeat(inner):
            return replace(node, node=_shown(inner))
    return node


def _note(
    lives: dict[str, _Life], state: object, new: Sequence[Match], ends: list[Match], row: Row | None = None
) -> None:
    """Take in which attempts live, how far they are, and which have ended: by a row, or by time."""
    ends += new
    attempts = getattr(state, "attempts", ())
    living = {attempt.first.uid: attempt for attempt in attempts if attempt.runs}
    timed_out = {each.rows[0][1].uid: each.stamp_us for each in new if each.type == "timeout"}
    timed_out |= {each.first.uid: each.timed_out.stamp_us for each in attempts if each.timed_out is not None}
    for uid, life in lives.items():
        if life.ended != "open" or uid in living:
            continue
        if uid in timed_out:
            life.ended, life.end_us = {"silence_us": timed_out[uid]}, timed_out[uid]
        elif row is not None:
            life.ended, life.end_us = {"row": row.uid}, row.stamp_us
    for uid, attempt in living.items():
        furthest = max(attempt.runs, key=lambda run: length(run.bound))
        if uid not in lives:
            lives[uid] = _Life(furthest)
        elif length(furthest.bound) >= length(lives[uid].run.bound):
            lives[uid].run = furthest


def _as_json(row: Row, said: set[str]) -> object:
    values = {name: value for name, value in row.values.items() if name in said and value is not None}
    concepts = row.concepts if "concept" in said else ()
    return dump_row(Row(row.stamp_us, row.rank, row.uid, row.source, values, tuple(concepts)))


def _bound(rows: Sequence[tuple[str, Row]]) -> list[list[str]]:
    return [[str(variable), row.uid] for variable, row in rows]


def _event(number: int, match: Match) -> dict[str, object]:
    return {
        "stream": number,
        "event": match.type,
        "stamp_us": match.stamp_us,
        "rows": _bound(match.rows),
        "measures": dict(match.measures),
        "confidence": match.confidence,
    }
