"""Proposed rules: what is counted is what the rule finds, and what trying everything counts."""

from __future__ import annotations

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from semap.rules.engine.rule import Rule
from semap.rules.engine.run_over import run_over
from semap.rules.mining import Proposal, Wanted, mine
from semap.rules.row import RANKS, Row

S = 1_000_000
ANY = Wanted(within_us=10 * S, support=1, confidence=0, lift=0, partitions=("track",))


def event(number: int, kind: str, at_s: float, track_id: int = 1) -> Row:
    stamp_us = round(at_s * S)
    values = {
        "input": "watch",
        "type": kind,
        "stamp": stamp_us,
        "track": f"t{track_id}",
        "track_id": track_id,
    }
    return Row(stamp_us, RANKS["event"], f"00000000-0000-0000-0000-{number:012}", "event", values)


@st.composite
def logs(draw: st.DrawFn) -> list[Row]:
    rows, at_s = [], 0.0
    for number in range(draw(st.integers(0, 14))):
        at_s += draw(st.sampled_from((0, 0.5, 1, 2, 5)))
        rows.append(event(number, draw(st.sampled_from("abc")), at_s, draw(st.sampled_from((1, 1, 2)))))
    return rows


def counted(rows: list[Row], proposal: Proposal, within_us: int) -> int:
    """So many first rows are followed by each next kind, the first one that comes, in the window."""
    found = 0
    for first in rows:
        if first.values["type"] != proposal.kinds[0][2]:
            continue
        at = first
        for _, _, kind in proposal.kinds[1:]:
            later = [
                row for row in rows
                if row.order > at.order and row.values["type"] == kind and row.values["track_id"] == first.values["track_id"]
            ]  # fmt: skip
            at = later[0] if later else None
            if at is None:
                break
        found += at is not None and at.stamp_us - first.stamp_us < within_us
    return found


@settings(max_examples=150, deadline=None)
@given(logs())
def test_what_is_counted_is_what_the_rule_finds(rows: list[Row]) -> None:
    proposals = mine(rows, ANY)
    for each in proposals:
        within_us = each.declaration.within.match_us
        assert within_us is not None
        assert each.support == counted(rows, each, within_us)
        assert each.firsts == sum(row.values["type"] == each.kinds[0][2] for row in rows)
        rule = Rule(1, 1, 1, True, each.declaration)
        assert len(run_over([rule], rows, 1000 * S)) == each.support
    pairs = {each.kinds for each in proposals if len(each.kinds) == 2}
    wanted = {
        (("event", "watch", a.values["type"]), ("event", "watch", b.values["type"]))
        for a in rows for b in rows
        if a.order < b.order and a.values["track_id"] == b.values["track_id"] and b.stamp_us - a.stamp_us < 10 * S
    }  # fmt: skip
    assert pairs == wanted


def test_what_was_planted_is_found_and_noise_is_not() -> None:
    chance = random.Random(7)
    rows: list[Row] = []
    for visit in range(40):
        at_s, track_id = 600 * visit + chance.uniform(0, 300), visit % 5
        rows.append(event(len(rows), "opened", at_s, track_id))
        rows.append(event(len(rows), "entered", at_s + chance.uniform(1, 4), track_id))
        rows.append(event(len(rows), "noise", chance.uniform(0, 24_000), track_id))
    (found,) = mine(rows, Wanted(partitions=("track",)))
    assert [kind for *_, kind in found.kinds] == ["opened", "entered"]
    assert (found.support, found.firsts, found.declaration.within.match_us) == (40, 40, 5 * S)
    assert found.by_chance < 0.05
    assert found.declaration.document["define"] == {
        "A": "input = 'watch' and type = 'opened'", "B": "input = 'watch' and type = 'entered'",
    }  # fmt: skip
