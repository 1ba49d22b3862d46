"""A rule that fails in a way that nobody foresaw: it is put out of force, and the others go on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from engine_store import Engine
from scene import BOTH_STAYED, MAP, OPENED_THEN_ENTERED, STAYED, VISITS, S, rule, visit

from semap.rules.engine.rule_run import RuleRun
from semap.rules.row import Row

COUNTED = {"name": "counted", "input": "both_stayed", "emit": {"both_stayed": "counted"}}
PAIRS = {"name": "pairs", "input": "track_in_room", "pattern": "A A2", "emit": "pair"}
ROWS = [
    visit("ann", "kitchen", "began", 1),
    visit("bob", "kitchen", "began", 2),
    visit("ann", "kitchen", "ended", 9, 1),
]


def boom(*_: object) -> None:
    raise ZeroDivisionError("nobody foresaw this")


def run(
    documents: dict[int, dict], break_: Callable[[Engine], None] = lambda engine: None
) -> tuple[Engine, list]:
    engine = Engine()
    for rule_id, document in documents.items():
        engine.change_rule(rule_id, rule(rule_id, document))
    break_(engine)
    events = [event for row in ROWS for event in engine.arrive(MAP, row)]
    engine.watermark(MAP, 1, 20 * S)
    return engine, [(each.rule_name, each.event_id) for each in [*events, *engine.release()]]


def broken(rule_id: int, what: str) -> Callable[[Engine], None]:
    return lambda engine: setattr(engine.half._maps[MAP].runs[rule_id], what, boom)


@pytest.mark.parametrize(
    ("failing", "what"), [(1, "take"), (2, "take"), (2, "fire"), (3, "take"), (4, "take"), (5, "take")]
)
def test_the_others_make_the_same_events(failing: int, what: str, caplog: pytest.LogCaptureFixture) -> None:
    documents = dict(enumerate((VISITS, STAYED, PAIRS, BOTH_STAYED, COUNTED), 1))
    name = documents[failing]["name"]
    engine, events = run(documents, broken(failing, what))
    _, expected = run(documents)
    without = {"stayed": {"stayed", "both_stayed", "counted"}, "both_stayed": {"both_stayed", "counted"}}.get(
        name, {name}
    )
    assert [each for each in events if each[0] not in without] == [
        each for each in expected if each[0] not in without
    ]
    assert name not in {each[0] for each in events}
    assert f"Rule {name} is put out of force" in caplog.text
    assert failing not in engine.rules
    assert str(failing) not in engine.intake.rules_json()


def test_what_it_had_stored_goes_and_it_may_be_declared_again() -> None:
    engine = Engine()
    engine.change_rule(1, rule(1, STAYED))
    engine.arrive(MAP, ROWS[0])
    engine.watermark(MAP, 1, 1 * S)
    engine.release()
    stored = engine.changes().states
    assert list(stored.values()) != [None]
    broken(1, "fire")(engine)
    engine.watermark(MAP, 1, 20 * S)
    assert engine.release() == []
    assert engine.changes().states == dict.fromkeys(stored)
    engine.change_rule(1, rule(1, STAYED, version=2))
    engine.arrive(MAP, later := replace(visit("ann", "hall", "began", 30)))
    engine.watermark(MAP, 1, 60 * S)
    assert [event.rule_version for event in engine.release()] == [2]
    assert isinstance(later, Row)


def test_the_past_of_a_rule_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    engine, _ = run({1: VISITS, 2: STAYED})
    for document in (PAIRS, {**VISITS, "name": "visits_2"}, OPENED_THEN_ENTERED):
        engine.change_rule(3, rule(3, document))
        with monkeypatch.context() as patched:
            patched.setattr(RuleRun, "_take", boom)
            patched.setattr(RuleRun, "_take_prepared", boom)
            assert engine.begin(3, ROWS) == []
        assert set(engine.rules) == {1, 2}


def test_a_state_that_cannot_be_read_ends_its_rule_only() -> None:
    states = [(1, "[null]", {"what": "another release wrote"})]
    engine = Engine.restore([rule(1, PAIRS), rule(2, VISITS)], {}, states, [])
    assert set(engine.rules) == {2}
    assert engine.changes().states == {(1, "[null]"): None}
    engine.arrive(MAP, ROWS[0])
    engine.watermark(MAP, 1, 1 * S)
    assert [event.type for event in engine.release()] == ["entered"]
