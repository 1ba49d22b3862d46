"""The rules as a state machine: same inputs, same events; one declaration, both edges."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from semap.errors import InvalidInput
from semap.model.relation import RelationChange
from semap.rules.declaration import parse_declaration
from semap.rules.engine import Rule, RuleChanged, RuleSet

T = datetime(2026, 1, 31, 12, tzinfo=UTC)
BEGAN = RelationChange(UUID(int=1), 1, 5, 10, "ann", 20, "kitchen", "began", "moved", T, T)
ENDED = replace(BEGAN, uid=UUID(int=2), kind="ended")
VISITS = Rule(1, 5, 1, True, parse_declaration(
    {"name": "room_visits", "input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
))  # fmt: skip


def play(state: RuleSet, *items: RelationChange | RuleChanged):
    events = []
    for item in items:
        state, made = state.step(item)
        events.extend(made)
    return state, events


def test_one_declaration_gives_both_edges_with_their_evidence() -> None:
    _, events = play(RuleSet(), RuleChanged(3, VISITS), BEGAN, ENDED)
    assert [(e.type, e.track_name, e.instance_name, e.stamp, e.evidence) for e in events] == [
        ("entered", "ann", "kitchen", T, (UUID(int=1),)),
        ("left", "ann", "kitchen", T, (UUID(int=2),)),
    ]


def test_ids_follow_from_rule_version_type_and_evidence() -> None:
    _, (event,) = play(RuleSet(), RuleChanged(3, VISITS), BEGAN)
    assert event.event_id.version == 5
    _, (same,) = play(RuleSet(), RuleChanged(77, VISITS), replace(BEGAN, track_id=11, instance_id=21))
    assert same.event_id == event.event_id
    for other_rule, other_change in [
        (replace(VISITS, version=2), BEGAN),
        (replace(VISITS, declaration=replace(VISITS.declaration, name="other")), BEGAN),
        (replace(VISITS, declaration=replace(VISITS.declaration, began="came")), BEGAN),
        (VISITS, replace(BEGAN, uid=UUID(int=9))),
    ]:
        _, (other,) = play(RuleSet(), RuleChanged(3, other_rule), other_change)
        assert other.event_id != event.event_id


def test_a_rule_is_in_force_from_its_place_in_the_log() -> None:
    only_left = replace(VISITS, version=2, declaration=replace(VISITS.declaration, began=None))
    _, events = play(
        RuleSet(), BEGAN, RuleChanged(3, VISITS), BEGAN, RuleChanged(3, only_left), BEGAN, ENDED,
        RuleChanged(3, replace(only_left, enabled=False)), ENDED, RuleChanged(3, only_left), ENDED,
        RuleChanged(3, None), ENDED,
    )  # fmt: skip
    assert [(e.type, e.rule_version) for e in events] == [("entered", 1), ("left", 2), ("left", 2)]


def test_a_rule_hears_only_its_own_query() -> None:
    _, events = play(RuleSet(), RuleChanged(3, VISITS), replace(BEGAN, query_id=6))
    assert events == []


@given(st.lists(st.one_of(
    st.sampled_from([BEGAN, ENDED, replace(BEGAN, query_id=6)]),
    st.tuples(st.integers(1, 3), st.one_of(st.none(), st.booleans(), st.integers(1, 9))).map(
        lambda p: RuleChanged(p[0], None if p[1] is None else replace(VISITS, enabled=p[1] is not False,
                                                                      version=int(p[1]) + 1))),
), max_size=20), st.integers(0, 20))  # fmt: skip
def test_any_cut_with_the_state_stored_between_gives_the_same(items: list, cut: int) -> None:
    whole_state, whole = play(RuleSet(), *items)
    state, first = play(RuleSet(), *items[:cut])
    end_state, second = play(RuleSet.from_json(state.as_json()), *items[cut:])
    assert first + second == whole
    assert end_state.as_json() == whole_state.as_json()


@pytest.mark.parametrize(
    ("document", "where"),
    [
        ("text", "mapping"),
        ({"name": "r", "input": "q"}, "emit"),
        ({"name": "r", "input": "q", "emit": {}}, "emit"),
        ({"name": "r", "input": "q", "emit": {"begun": "x"}}, "emit.begun"),
        ({"name": "r", "input": "q", "emit": {"began": ""}}, "emit.began"),
        ({"name": "r", "input": "q", "emit": {"began": 3}}, "emit.began"),
        ({"name": "2r", "input": "q", "emit": {"began": "x"}}, "name"),
        ({"name": "r", "emit": {"began": "x"}}, "input"),
        ({"name": "r", "input": "q", "emit": {"began": "x"}, "wihtin": "6 s"}, "wihtin"),
    ],
)
def test_a_wrong_declaration_names_the_clause_and_the_remedy(document: object, where: str) -> None:
    with pytest.raises(InvalidInput) as wrong:
        parse_declaration(document)
    assert where in str(wrong.value)
    assert wrong.value.remedy
