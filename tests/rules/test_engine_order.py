"""Whatever the order of arrival within the lateness, wherever watermarks and restarts cut: the same log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from engine_store import Engine, EngineStore
from hypothesis import given, settings
from hypothesis import strategies as st
from scene import ALL, DOORS, MAP, ROOMS, TRACKS, S, door, rule, visit

from semap.model.event import Event
from semap.rules.engine.run_over import run_over
from semap.rules.engine.step import NEVER_US
from semap.rules.row import Row

LATENESS_S = 3
END_S = 1000
DOOR_SOURCE = 1
SOURCES = (DOOR_SOURCE, *TRACKS.values())
RULES = [rule(rule_id, document) for rule_id, document in enumerate(ALL, 1)]


@dataclass(frozen=True)
class Arrival:
    """A row, when it arrives [s], and what the worker does after it."""

    row: Row
    at_s: float
    then: frozenset[str]


@st.composite
def arrivals(draw: st.DrawFn) -> list[Arrival]:
    """What may happen in the scene: stamps may be alike, and rows overtake one another."""
    now_s = 0.0
    inside: dict[tuple[str, str], float] = {}
    opened: set[str] = set()
    found = []
    for _ in range(draw(st.integers(1, 14))):
        now_s += draw(st.sampled_from([0, 0, 0.5, 1, 1.5, 2, 4]))
        if draw(st.booleans()):
            name = draw(st.sampled_from(sorted(DOORS)))
            actor = draw(st.sampled_from([None, *TRACKS]))
            row = door(
                name, "closed" if name in opened else "open", now_s, actor, draw(st.sampled_from([1, 2]))
            )
            opened ^= {name}
        else:
            place = draw(st.sampled_from(sorted(TRACKS))), draw(st.sampled_from(sorted(ROOMS)))
            since_s = inside.pop(place, None)
            if since_s is None:
                inside[place] = now_s
            row = visit(*place, "began" if since_s is None else "ended", now_s, since_s)
        if any(arrival.row.uid == row.uid for arrival in found):
            continue
        delay_s = draw(st.sampled_from([0, 0, 0.5, 1.5, LATENESS_S - 1e-6]))
        then = draw(st.sets(st.sampled_from(["watermark", "release", "store", "restart"])))
        found.append(Arrival(row, now_s + delay_s, frozenset(then)))
    return sorted(found, key=lambda arrival: arrival.at_s)


def play(found: Iterable[Arrival], does: frozenset[str]) -> tuple[list[Event], EngineStore]:
    """The events in the order in which they were given, and what is stored in the end."""
    engine, store = Engine(), EngineStore()
    for each in RULES:
        engine.change_rule(each.rule_id, each)
    for source_id in SOURCES:
        engine.watermark(MAP, source_id, NEVER_US)
    events = []
    for arrival in found:
        events += engine.arrive(MAP, arrival.row)
        then = arrival.then & does
        if "watermark" in then:
            engine.watermark(MAP, source_of(arrival.row), round((arrival.at_s - LATENESS_S) * S))
        if "release" in then:
            events += engine.release()
        if "store" in then or "restart" in then:
            store.take(engine)
        if "restart" in then:
            engine = store.restored()
    for source_id in SOURCES:
        engine.watermark(MAP, source_id, END_S * S)
        events += engine.release()
    store.take(engine)
    return events, store


def source_of(row: Row) -> int:
    """Doors, and each of the tracks, are told by a source of their own."""
    return int(str(row.values.get("track_id", DOOR_SOURCE)))


@settings(deadline=None, max_examples=60)
@given(arrivals())
def test_order_watermarks_and_restarts_change_nothing(found: list[Arrival]) -> None:
    """Equal events in equal order, as one who had all rows in the order of their stamps would make them."""
    rows = [arrival.row for arrival in found]
    expected = run_over(RULES, sorted(rows, key=lambda row: row.order), END_S * S)
    events, store = play(found, frozenset({"watermark", "release", "store", "restart"}))
    assert events == expected
    assert store.late == []
    assert store.pending == {}


@settings(deadline=None, max_examples=40)
@given(arrivals())
def test_the_log_goes_by_stamps_and_uids_and_not_by_numbers(found: list[Arrival]) -> None:
    """In another database tracks, instances and rules have other numbers; the log is in the same order."""
    rows = [arrival.row for arrival in found]
    renamed = [replace(row, values=renumbered(row.values)) for row in rows]
    others = [replace(each, rule_id=100 - each.rule_id) for each in reversed(RULES)]
    made = [
        [event.event_id for event in run_over(rules, of_rows, END_S * S)]
        for rules, of_rows in ((RULES, rows), (others, renamed))
    ]
    assert made[0] == made[1]


def renumbered(values: Mapping[str, object]) -> dict[str, object]:
    return {
        name: -value if name in ("track_id", "instance_id", "actor_id") and isinstance(value, int) else value
        for name, value in values.items()
    }


@settings(deadline=None, max_examples=40)
@given(arrivals())
def test_rows_make_events_in_the_order_of_their_stamps(found: list[Arrival]) -> None:
    events, _ = play(found, frozenset({"watermark", "release"}))
    stamps = [event.stamp for event in events if event.rule_name in ("visits", "crowded", "entered_by_door")]
    assert stamps == sorted(stamps)


@settings(deadline=None, max_examples=40)
@given(arrivals())
def test_what_is_stored_in_the_end_is_the_same_wherever_it_was_cut(found: list[Arrival]) -> None:
    _, once = play(found, frozenset({"watermark", "release"}))
    _, often = play(found, frozenset({"watermark", "release", "store", "restart"}))
    assert often.states == once.states
    assert often.progress == once.progress


@settings(deadline=None, max_examples=40)
@given(arrivals())
def test_ids_tell_events_apart(found: list[Arrival]) -> None:
    events, _ = play(found, frozenset())
    ids = [event.event_id for event in events]
    assert len(set(ids)) == len(ids)
