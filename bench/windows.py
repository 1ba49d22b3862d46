"""What a row costs in windows of 1, 10, 100 and 1,000 s, by the rule engine.

A row a second in one key, a, b and x equally likely where nothing else is said. The clock is that of the
processor, from the first row handed to an engine to the last event, with a watermark after each hundred rows;
the first round warms up. Of all matches that end at one row, one is told and the others are counted: outside
of the clock, the count is compared with what is known of the rows.
"""

from __future__ import annotations

import random
import time
from collections.abc import Sequence

from bench.figure import Figure, Rows, figure
from semap.intake.intake import Intake
from semap.rules.compilation import compile_rule
from semap.rules.engine.engine import Engine
from semap.rules.engine.rule import Rule
from semap.rules.language.reading import parse_declaration
from semap.rules.row import RANKS, Row

S = 1_000_000
MAP_ID = 1
WINDOWS_S = (1, 10, 100, 1_000)
ROWS = 20_000
ROUNDS = 3
BATCH = 100
ALIKE = "abx"
RARE = "a" * 25 + "x" * 24 + "b"
NEVER = "ax"
LETTERS = {ALIKE: "a, b, x alike", RARE: "b in 50", NEVER: "no b"}
ANY, RELAXED, NESTED = "A+ any followed by any B", "A+ relaxed followed by B", "(A+)+ B"
ALL, ONE = "no skip, at most 1", "skip past last row"

CASES = (
    (ANY, ALL, ALIKE),
    (ANY, ONE, RARE),
    (ANY, ONE, NEVER),
    (RELAXED, ALL, ALIKE),
)


def measure() -> Rows:
    """A row for each pattern; rows/s by window."""
    found: Rows = []
    for pattern, after_match, letters in CASES:
        rows = make_rows(ROWS, letters)
        rates = {f"rows_per_s_{each}_s": _rate(pattern, after_match, each, rows) for each in WINDOWS_S}
        medians = [rate.median for rate in rates.values()]
        case: dict[str, object] = {"pattern": pattern, "after_match": after_match, "rows": LETTERS[letters]}
        case |= {**rates, "most_to_least": round(max(medians) / min(medians), 1)}
        if (pattern, after_match) == (ANY, ALL):
            case["count_is_right"] = all(_is_right(window_s, rows) for window_s in WINDOWS_S)
        found.append(case)
    rows = make_rows(1_000, "a")
    for after_match in (ONE, "skip to next row", ALL):
        seconds = [_round(_clauses(NESTED, after_match, 2_000), rows) for _ in range(ROUNDS)]
        found.append(
            {"pattern": NESTED, "after_match": after_match, "rows": "1,000 a", "seconds": figure(seconds, 3)}
        )
    return found


def _rate(pattern: str, after_match: str, window_s: int, rows: Sequence[Row]) -> Figure:
    seconds = [_round(_clauses(pattern, after_match, window_s), rows) for _ in range(ROUNDS + 1)]
    return figure(len(rows) / each for each in seconds[1:])


def make_rows(count: int, letters: str) -> list[Row]:
    """One a second, of types among the letters."""
    chance = random.Random(count)
    values = [
        {"input": "x", "type": chance.choice(letters), "stamp": place * S, "track": "t", "track_id": 1}
        for place in range(count)
    ]
    return [
        Row(place * S, RANKS["relation"], f"00000000-0000-0000-0000-{place:012x}", "relation", said)
        for place, said in enumerate(values)
    ]


def _clauses(pattern: str, after_match: str, window_s: int) -> dict[str, object]:
    return {
        "input": "x",
        "partition_by": "track",
        "pattern": pattern,
        "define": {"A": "type = 'a'", "B": "type = 'b'"},
        "within": f"{window_s} s",
        "after_match": after_match,
        "emit": "found",
    }


def _round(clauses: dict[str, object], rows: Sequence[Row]) -> float:
    """Seconds."""
    intake, engine = Intake(), Engine()
    document = {
        "map_id": MAP_ID,
        "name": "windows",
        "version": 1,
        "enabled": True,
        "queries": {"x": 1},
        "declaration": clauses,
    }
    for half in (intake, engine):
        half.change_rule(1, Rule.from_json(1, document))
    started_s = time.process_time()
    for first in range(0, len(rows), BATCH):
        for row in rows[first : first + BATCH]:
            intake.arrive(MAP_ID, row)
        intake.watermark(MAP_ID, 1, row.stamp_us)
        for due in intake.due():
            engine.take(due)
    return time.process_time() - started_s


def _is_right(window_s: int, rows: Sequence[Row]) -> bool:
    """Whether all matches of `ANY` are counted: at each b, each set of a's in its window but the empty."""
    program = compile_rule(parse_declaration(_clauses(ANY, ALL, window_s), "windows"))
    state, told, wanted = None, 0, 0
    for place, row in enumerate(rows):
        state, matches = program.step(state, row)
        told += len(matches)
        if row.values["type"] == "b":
            before = rows[max(place - window_s + 1, 0) : place]
            wanted += 2 ** sum(other.values["type"] == "a" for other in before) - 1
    untold: list[tuple[Row, int]] = getattr(program, "untold", [])
    return told + sum(count for _, count in untold) == wanted
