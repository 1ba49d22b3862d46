"""What rules give up because too much is under way in a key: noted the same, wherever a run is cut."""

from __future__ import annotations

import pytest
from engine_store import Engine, EngineStore
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scene import MAP, ROOMS, TRACKS, S, rule, visit

from semap.model.given_up import GivenUp
from semap.rules.engine.run_over import run_over
from semap.rules.matching import all_matches, pattern_program
from semap.rules.row import Row
from semap.rules.temporal import formula_program
from semap.timeline.stamp import to_datetime

MOST = 5
GROWING = {
    "name": "growing", "input": "track_in_room", "partition_by": "track", "pattern": "A+ any followed by any B",
    "define": {"A": "type = 'began'", "B": "type = 'ended'"}, "after_match": "no skip", "emit": "found",
}  # fmt: skip
EACH = GROWING | {
    "name": "each",
    "pattern": "A followed by B",
    "after_match": "skip to next row",
    "within": "9 s",
}
NEVER = {
    "name": "never", "input": "track_in_room", "partition_by": "track", "define": {"K": "room = 'kitchen'"},
    "formula": "always not K", "when": "K", "emit": {"fails": "came"},
}  # fmt: skip
RULES = [rule(1, GROWING), rule(2, EACH), rule(3, NEVER)]


@pytest.fixture(autouse=True)
def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pattern_program, "RUNS_AT_MOST", MOST)
    monkeypatch.setattr(all_matches, "UNDER_WAY_AT_MOST", MOST)
    monkeypatch.setattr(formula_program, "MOST_EVALUATIONS", MOST)


@pytest.mark.parametrize(("after_match", "most"), [("no skip", 1_000), ("no skip, at most 16382", 16_382)])
def test_the_witness_of_a_bound_that_told_nobody(
    monkeypatch: pytest.MonkeyPatch, after_match: str, most: int
) -> None:
    """14 rows that may begin it: of 16,383 matches as many are told as the rule wants, and it is said how many are not."""
    monkeypatch.setattr(all_matches, "UNDER_WAY_AT_MOST", 14)
    rows = [visit("ann", "kitchen", "began", at_s) for at_s in range(14)]
    rows.append(visit("ann", "kitchen", "ended", 20))
    told: dict[str, GivenUp] = {}
    growing = rule(1, GROWING | {"after_match": after_match})
    events = run_over([growing], rows, 30 * S, tell=lambda of, what: told.update({of.name: what}))
    assert len({event.event_id for event in events}) == len(events) == most
    left = 16_383 - most
    assert told == {"growing": GivenUp(0, to_datetime(0), {"track": "ann"}, left)}
    assert told["growing"].as_text() == (
        f"It found {left:,} match{'es' * (left > 1)} more than after_match tells of those that end at one row;"
        " events that begin at 1970-01-01T00:00:00Z or later may be missing (first of track ann). Say how many are"
        " wanted: after_match: no skip, at most 100000; or use an after_match that skips."
    )


def test_what_stays_within_the_bound_says_nothing() -> None:
    told: list[GivenUp] = []
    rows = [visit("ann", "kitchen", "began", at_s) for at_s in range(MOST)]
    run_over([rule(2, EACH)], rows, 30 * S, tell=lambda _, what: told.append(what))
    assert told == []


visits = st.builds(
    visit,
    st.sampled_from(sorted(TRACKS)),
    st.sampled_from(sorted(ROOMS)),
    st.sampled_from(["began", "began", "ended"]),
    st.integers(0, 30),
)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(visits, max_size=40, unique_by=lambda row: row.uid),
    cuts=st.lists(st.integers(0, 40), max_size=3),
)
def test_it_is_noted_the_same_wherever_the_run_is_cut_and_stored(rows: list[Row], cuts: list[int]) -> None:
    rows = sorted(rows, key=lambda row: row.order)
    whole: dict[int, GivenUp] = {}
    run_over(RULES, rows, 40 * S, tell=lambda of, what: whole.update({of.rule_id: what}))
    engine, store = Engine(), EngineStore()
    for each in RULES:
        engine.change_rule(each.rule_id, each)
    for number, row in enumerate(rows):
        if number in cuts:
            store.take(engine)
            engine = store.restored()
        engine.arrive(MAP, row)
        engine.watermark(MAP, 0, row.stamp_us - 1)
        engine.release()
    engine.watermark(MAP, 0, 40 * S)
    engine.release()
    assert engine.given_up == whole


def test_another_version_of_a_rule_has_given_nothing_up() -> None:
    engine = Engine()
    engine.change_rule(2, rule(2, EACH))
    for at_s in range(8):
        engine.arrive(MAP, visit("ann", "kitchen", "began", at_s))
    engine.watermark(MAP, 0, 8 * S)
    engine.release()
    noted = {2: GivenUp(3, to_datetime(0), {"track": "ann"})}
    assert engine.given_up == noted
    engine.change_rule(2, rule(2, EACH, enabled=False))
    assert engine.given_up == noted
    store = EngineStore()
    store.take(engine)
    assert store.restored().given_up == noted
    engine.change_rule(2, rule(2, EACH))
    assert engine.given_up == noted
    engine.change_rule(2, rule(2, EACH, version=2))
    assert engine.given_up == {}
