"""The engine: each kind of rule over a small scene, and what time, order, cuts and changes of rules may do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from uuid import UUID, uuid5

import pytest
from engine_store import Engine, EngineStore
from scene import (
    ALL,
    BOTH_STAYED,
    CLOSES_SOON,
    CROWDED,
    DOORS,
    DURING,
    MAP,
    OPENED_THEN_ENTERED,
    ROOMS,
    STAYED,
    TIMED_OUT,
    VISITS,
    S,
    door,
    rule,
    visit,
)  # fmt: skip

from semap.errors import InvalidInput
from semap.model.event import Event, Evidence
from semap.model.given_up import GivenUp
from semap.rules.engine.event_identity import EVENT_NAMESPACE
from semap.rules.engine.rule_order import order_of_rules
from semap.rules.engine.run_over import run_over
from semap.rules.matching import pattern_program as matching
from semap.rules.row import RANKS, Row
from semap.timeline.stamp import to_datetime

LEFT_THEN = {"name": "then", "input": {"rule": "visits"}, "emit": {"left": "gone"}}
BUILT = {"name": "built", "input": {"map": True}, "emit": {"added": "built"}}
BUILT_THEN_ENTERED = {
    "name": "built_then_entered", "input": [{"map": True}, "track_in_room"], "pattern": "B followed by E",
    "define": {"B": "input = 'map'", "E": "type = 'began'"}, "emit": "entered_what_was_built",
}  # fmt: skip


def engine_of(*documents: dict) -> Engine:
    engine = Engine()
    for rule_id, document in enumerate(documents, 1):
        engine.change_rule(rule_id, rule(rule_id, document))
    return engine


def at(stamp_s: float):
    return to_datetime(round(stamp_s * S))


def arrive(engine: Engine, *rows) -> list[Event]:
    return [event for row in rows for event in engine.arrive(MAP, row)]


def release(engine: Engine, at_s: float, source_id: int = 1, lateness_s: float = 0) -> list[Event]:
    engine.watermark(MAP, source_id, round((at_s - lateness_s) * S))
    return engine.release()


def told(events: Iterable[Event]) -> list[tuple[str, float]]:
    return [(event.type, (event.stamp - at(0)).total_seconds()) for event in events]


def test_one_declaration_gives_both_edges_with_their_evidence() -> None:
    engine = engine_of(VISITS)
    began, ended = visit("ann", "kitchen", "began", 1), visit("ann", "kitchen", "ended", 5, since_s=1)
    assert arrive(engine, ended, began) == []
    entered, left = release(engine, 5)
    assert left == Event(
        event_id=left.event_id, map_id=MAP, rule_name="visits", rule_version=1, type="left",
        stamp=at(5), since=at(1), cause="moved", track_id=31, track_name="ann", instance_id=11,
        instance_name="kitchen", evidence=(Evidence(UUID(ended.uid), "", "relation", at(5)),),
    )  # fmt: skip
    assert (entered.type, entered.stamp, entered.since) == ("entered", at(1), at(1))
    assert release(engine, 100) == []


def test_ids_follow_from_rule_version_type_and_evidence() -> None:
    row = visit("ann", "kitchen", "began", 1)
    (event,) = run_over([rule(3, VISITS)], [row], 1 * S)
    assert event.event_id == uuid5(EVENT_NAMESPACE, f"visits|1|entered|{row.uid}")
    (same,) = run_over([rule(77, VISITS)], [replace(row, values={**row.values, "track_id": 99})], 1 * S)
    assert same.event_id == event.event_id
    others = [
        run_over([rule(3, VISITS, version=2)], [row], 1 * S),
        run_over([rule(3, VISITS | {"name": "other"})], [row], 1 * S),
        run_over([rule(3, VISITS | {"emit": {"began": "came"}})], [row], 1 * S),
        run_over([rule(3, VISITS)], [replace(row, uid=str(UUID(int=9)))], 1 * S),
    ]
    assert len({event.event_id, *(other.event_id for (other,) in others)}) == 5


def test_a_pattern_waits_for_the_watermark_and_goes_by_room_and_actor() -> None:
    engine = engine_of(OPENED_THEN_ENTERED)
    opened, entered = door("kitchen_door", "open", 1, actor="ann"), visit("ann", "kitchen", "began", 4)
    # they arrive in the wrong order, and bob is not who opened the door
    assert arrive(engine, entered, visit("bob", "kitchen", "began", 2), opened) == []
    assert release(engine, 3.9) == []
    (event,) = release(engine, 4)
    assert event == Event(
        event_id=event.event_id, map_id=MAP, rule_name="opened_then_entered", rule_version=1,
        type="entered_by_door", stamp=at(4), since=at(1), track_id=31, track_name="ann",
        instance_id=11, instance_name="kitchen", key={"room": "kitchen"}, measures={"gap_s": 3.0},
        evidence=(
            Evidence(UUID(opened.uid), "O", "object_state", at(1)),
            Evidence(UUID(entered.uid), "E", "relation", at(4)),
        ),
    )  # fmt: skip


def test_one_row_of_two_rooms_makes_an_event_in_each() -> None:
    opened_and_closed = {
        "name": "open_shortly", "input": {"object_state": "door"}, "partition_by": "room", "pattern": "O C",
        "define": {"O": "type = 'open'", "C": "type = 'closed'"}, "emit": "open_shortly",
    }  # fmt: skip
    rows = [door("kitchen_door", "open", 1), door("kitchen_door", "closed", 2)]
    events = run_over([rule(1, opened_and_closed)], rows, 10 * S)
    assert sorted(event.key["room"] for event in events) == ["hall", "kitchen"]
    assert len({event.event_id for event in events}) == 2


def test_an_actor_counts_within_the_distance_that_the_rule_says() -> None:
    rows = [door("kitchen_door", "open", 1, actor="ann", distance_m=1.6), visit("ann", "kitchen", "began", 2)]
    assert run_over([rule(1, OPENED_THEN_ENTERED)], rows, 10 * S) == []
    wide = OPENED_THEN_ENTERED | {"input": ["track_in_room", {"object_state": "door", "actor_within_m": 2}]}
    assert len(run_over([rule(1, OPENED_THEN_ENTERED), rule(2, wide | {"name": "wide"})], rows, 10 * S)) == 1


def test_absence_comes_by_the_watermark_when_no_row_comes() -> None:
    engine = engine_of(STAYED)
    arrive(engine, visit("ann", "kitchen", "began", 1), visit("bob", "kitchen", "began", 2))
    arrive(engine, visit("bob", "kitchen", "ended", 4))
    assert told(release(engine, 3.999998)) == []
    (event,) = release(engine, 3.999999)
    assert told([event]) == [("stayed", 4.0)]
    assert (event.key, event.track_name) == ({"track": "ann", "room": "kitchen"}, "ann")
    assert release(engine, 100) == []


def test_events_are_rows_of_other_rules_at_the_moment_at_which_they_were_known() -> None:
    engine = engine_of(BOTH_STAYED, STAYED)
    arrive(engine, visit("ann", "kitchen", "began", 1), visit("bob", "kitchen", "began", 2))
    events = release(engine, 100)
    assert told(events) == [("stayed", 4.0), ("stayed", 5.0), ("both_stayed", 4.999999)]
    assert events[2].evidence == (
        Evidence(events[0].event_id, "A", "event", at(4)),
        Evidence(events[1].event_id, "B", "event", at(5)),
    )


def test_occupants_are_counted_in_order() -> None:
    engine = engine_of(CROWDED)
    arrive(engine, visit("bob", "kitchen", "began", 3), visit("ann", "kitchen", "ended", 2))
    arrive(engine, visit("ann", "kitchen", "began", 1), visit("ann", "kitchen", "began", 4))
    (event,) = release(engine, 5)
    assert (event.stamp, event.track_name) == (at(4), "ann")


def test_a_partial_match_that_timed_out_is_an_event() -> None:
    rows = [visit("ann", "kitchen", "began", 1), visit("bob", "kitchen", "began", 2),
            visit("bob", "kitchen", "ended", 3)]  # fmt: skip
    assert told(run_over([rule(1, TIMED_OUT)], rows, 10 * S)) == [
        ("no_short_visit", 3.0),
        ("short_visit", 3.0),
    ]


def test_intervals_and_formulas_are_rules_as_well() -> None:
    rows = [
        door("kitchen_door", "open", 1), visit("ann", "kitchen", "began", 2), visit("ann", "kitchen", "ended", 3),
        door("kitchen_door", "closed", 4),
    ]  # fmt: skip
    during = run_over([rule(1, DURING)], rows, 10 * S)
    assert [(event.type, event.key) for event in during] == [("there_while_open", {"room": "kitchen"})]
    assert told(run_over([rule(1, CLOSES_SOON)], rows, 10 * S)) == [("left_open", 3.0)]


def test_the_slowest_source_holds_the_watermark_until_it_is_idle() -> None:
    engine = engine_of(STAYED)
    engine.watermark(MAP, 2, 0)
    arrive(engine, visit("ann", "kitchen", "began", 1))
    assert release(engine, 100) == []
    engine.watermark(MAP, 2, 0, is_awaited=False)
    assert told(engine.release()) == [("stayed", 4.0)]
    arrive(engine, visit("bob", "kitchen", "began", 101))
    engine.watermark(MAP, 2, 50 * S)
    assert release(engine, 200) == []
    engine.watermark(MAP, 2, 150 * S)
    assert told(engine.release()) == [("stayed", 104.0)]


def test_where_no_source_is_awaited_all_that_they_gave_is_taken() -> None:
    engine = engine_of(STAYED)
    arrive(engine, visit("ann", "kitchen", "began", 1), visit("bob", "kitchen", "began", 7))
    engine.watermark(MAP, 1, 5 * S, is_awaited=False)
    assert told(engine.release()) == [("stayed", 4.0)]
    engine.watermark(MAP, 2, 12 * S)
    engine.intake.forget_source(2)
    assert told(engine.release()) == [("stayed", 10.0)]


def test_what_comes_within_the_lateness_is_taken_and_what_comes_later_is_given_out() -> None:
    engine = engine_of(STAYED)
    assert release(engine, 10, lateness_s=5) == []
    in_time, late = visit("ann", "kitchen", "began", 5.000001), visit("bob", "kitchen", "began", 5)
    arrive(engine, late, in_time)
    assert told(release(engine, 100)) == [("stayed", 8.000001)]
    (given,) = engine.changes().late
    assert (given.row, given.watermark_us) == (late, 5 * S)
    assert engine.changes().late == []


def test_what_needs_no_order_is_never_late() -> None:
    engine = engine_of(VISITS)
    release(engine, 10)
    late = visit("ann", "kitchen", "began", 5)
    assert told(arrive(engine, late)) == [("entered", 5.0)]
    assert engine.changes().late == []
    engine.change_rule(2, rule(2, STAYED))
    assert told(arrive(engine, late)) == [("entered", 5.0)]
    assert [each.row for each in engine.changes().late] == [late]


def test_what_an_edit_of_the_map_did_is_taken_where_the_map_is_and_waits_for_no_source() -> None:
    """Also by a rule that reads what another one makes of it, and after a restart."""
    engine, store = engine_of(VISITS, STAYED, LEFT_THEN), EngineStore()
    arrive(engine, visit("ann", "kitchen", "began", 5))
    release(engine, 6)
    arrive(engine, visit("ann", "kitchen", "ended", 5.5, cause="map"))
    store.take(engine)
    engine = store.restored()
    assert told(engine.release()) == [("left", 5.5), ("gone", 5.5)]
    assert engine.release() == []
    assert engine.intake.released_us(MAP) == 6 * S
    store.take(engine)
    assert (store.pending, store.late) == ({}, [])
    arrive(engine, visit("bob", "kitchen", "began", 6.000001))
    assert told(release(engine, 100)) == [("entered", 6.000001), ("stayed", 9.000001)]


def test_an_edit_that_is_ahead_of_the_map_waits_as_its_track_does() -> None:
    engine = engine_of(VISITS)
    arrive(engine, visit("ann", "kitchen", "began", 5), visit("ann", "kitchen", "ended", 5.5, cause="map"))
    assert told(release(engine, 5.2)) == [("entered", 5.0)]
    assert told(release(engine, 5.5)) == [("left", 5.5)]


def test_a_change_of_the_map_waits_for_nobody_but_in_a_pattern() -> None:
    engine = engine_of(BUILT, BUILT_THEN_ENTERED)
    values = {"input": "map", "type": "added", "stamp": 50 * S}
    built = Row(50 * S, RANKS["map"], str(UUID(int=1)), "map", values)
    assert told(arrive(engine, built)) == [("built", 50.0)]
    arrive(engine, visit("ann", "kitchen", "began", 40), visit("bob", "kitchen", "began", 51))
    assert told(release(engine, 60)) == [("entered_what_was_built", 51.0)]


def test_a_rule_is_in_force_from_its_place_on() -> None:
    engine = engine_of(VISITS)
    began, ended = visit("ann", "kitchen", "began", 1), visit("ann", "kitchen", "ended", 2)
    arrive(engine, began)
    events = release(engine, 1)
    engine.change_rule(1, rule(1, VISITS | {"emit": {"ended": "left"}}, version=2))
    arrive(engine, ended)
    events += release(engine, 2)
    engine.change_rule(1, rule(1, VISITS, version=2, enabled=False))
    events += arrive(engine, began, ended)
    engine.change_rule(1, None)
    events += arrive(engine, began, ended) + release(engine, 9)
    assert [(event.type, event.rule_version) for event in events] == [("entered", 1), ("left", 2)]


def test_a_new_version_begins_without_states_while_others_go_on() -> None:
    engine = engine_of(STAYED, TIMED_OUT)
    arrive(engine, visit("ann", "kitchen", "began", 1))
    release(engine, 1)
    assert {key for key, state in engine.changes().states.items() if state is not None} == {
        (1, "[31,11]"), (2, "[31]"),
    }  # fmt: skip
    engine.change_rule(1, rule(1, STAYED, version=2))
    assert engine.changes().states == {(1, "[31,11]"): None}
    assert told(release(engine, 100)) == [("no_short_visit", 3.0)]


def test_rules_say_what_they_read_and_need() -> None:
    engine = engine_of(OPENED_THEN_ENTERED, VISITS | {"where": "s_intersects(position, BBOX(0,0,1,1))"})
    assert not engine.intake.reads_map(MAP)
    needs = engine.intake.needs(MAP)
    assert (needs.actor_within_m, needs.position, needs.footprint) == (
        {"door": 1.5}, frozenset({"track_in_room"}), frozenset(),
    )  # fmt: skip


def test_rows_may_be_completed_before_they_are_taken() -> None:
    engine = engine_of(OPENED_THEN_ENTERED)
    arrive(engine, door("kitchen_door", "open", 1), visit("ann", "kitchen", "began", 2))
    engine.watermark(MAP, 1, 10 * S)
    (due,) = engine.due()
    seen = [replace(row, values={**row.values, "actor": "ann", "actor_distance_m": 0.1}) for row in due.rows]
    assert told(engine.take([replace(due, rows=seen)])) == [("entered_by_door", 2.0)]


@pytest.mark.parametrize("split", range(6))
@pytest.mark.parametrize("other", [TIMED_OUT, CLOSES_SOON], ids=["same input", "other input"])
def test_a_rule_that_begins_with_the_past_goes_over_into_the_present(split: int, other: dict) -> None:
    """At any place in the log: history up to there, then what comes; nothing is lost and nothing doubled."""
    rows = [
        visit("ann", "kitchen", "began", 1), visit("bob", "hall", "began", 2), visit("bob", "hall", "ended", 3),
        visit("bob", "hall", "began", 4), visit("ann", "kitchen", "ended", 6), visit("ann", "hall", "began", 7),
    ]  # fmt: skip
    engine = engine_of(other)
    made = arrive(engine, *rows[:split])
    made += release(engine, split - 0.5)
    engine.change_rule(2, rule(2, STAYED))
    made += engine.begin(2, rows[:split])
    made += arrive(engine, *rows[split:]) + release(engine, 100)
    whole = run_over([rule(1, other), rule(2, STAYED)], rows, 100 * S)
    assert sorted(event.event_id for event in made) == sorted(event.event_id for event in whole)
    assert told(event for event in whole if event.rule_name == "stayed") == [
        ("stayed", 4.0), ("stayed", 7.0), ("stayed", 10.0),
    ]  # fmt: skip


def test_what_was_given_up_is_counted_by_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matching, "RUNS_AT_MOST", 3)
    document = {
        "name": "again", "input": "track_in_room", "partition_by": "track", "pattern": "A followed by B",
        "define": {"A": "type = 'began'", "B": "type = 'ended'"}, "after_match": "skip to next row",
        "emit": "again",
    }  # fmt: skip
    engine = engine_of(VISITS, document)
    arrive(engine, *(visit("ann", "kitchen", "began", at_s) for at_s in range(5)))
    release(engine, 9)
    assert engine.given_up == {2: GivenUp(2, to_datetime(0), {"track": "ann"})}


def test_a_deleted_map_takes_all_with_it() -> None:
    engine = engine_of(STAYED)
    arrive(engine, visit("ann", "kitchen", "began", 1), visit("bob", "kitchen", "began", 2))
    release(engine, 1)
    assert len(engine.changes().pending_added) == 1
    engine.delete_map(MAP)
    changes = engine.changes()
    assert (list(changes.states.values()), len(changes.pending_removed)) == ([None], 1)
    assert (engine.rules, engine.release()) == ({}, [])


def test_rules_that_read_one_another_in_a_circle_are_refused() -> None:
    engine = engine_of(STAYED, BOTH_STAYED)
    circle = STAYED | {"input": {"rule": "both_stayed"}}
    with pytest.raises(InvalidInput, match=r"(stayed|both_stayed) reads (stayed|both_stayed) reads") as wrong:
        engine.change_rule(1, rule(1, circle, version=2))
    assert wrong.value.remedy
    arrive(engine, visit("ann", "kitchen", "began", 1))
    assert told(release(engine, 100)) == [("stayed", 4.0)]


def test_the_order_of_rules_is_that_in_which_they_read() -> None:
    assert order_of_rules({"c": ["b", "query"], "a": ["c"], "b": [], "d": []}) == ("b", "d", "c", "a")
    with pytest.raises(InvalidInput, match="a reads b reads c reads a"):
        order_of_rules({"a": ["b"], "b": ["c"], "c": ["a"]})


def test_the_scene_names_each_thing_once() -> None:
    ids = [*ROOMS.values(), *(instance_id for instance_id, _ in DOORS.values())]
    assert len(ids) == len(set(ids))
    assert len({document["name"] for document in ALL}) == len(ALL)
