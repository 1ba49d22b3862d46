"""Whatever the order of arrival within the lateness, wherever watermarks and restarts cut: the same events."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from engine_store import EngineStore
from hypothesis import given, settings
from hypothesis import strategies as st
from scene import ALL, DOORS, MAP, ROOMS, TRACKS, S, door, rule, visit

from semap.model.event import Event
from semap.rules.engine.engine import Engine
from semap.rules.engine.run_over import run_over
from semap.rules.row import Row

LATENESS_S = 3
END_S = 1000
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


def play(found: Iterable[Arrival], does: frozenset[str]) -> tuple[list[Event], list[Event], EngineStore]:
    """The events given at once, those given as rows were released, and what is stored in the end."""
    engine, store = Engine(), EngineStore()
    for each in RULES:
        engine.change_rule(each.rule_id, each)
    at_once, released = [], []
    for arrival in found:
        at_once += engine.arrive(MAP, arrival.row)
        then = arrival.then & does
        if "watermark" in then:
            engine.watermark(MAP, 1, round(arrival.at_s * S), LATENESS_S * S)
        if "release" in then:
            released += engine.release()
        if "store" in then or "restart" in then:
            store.take(engine)
        if "restart" in then:
            engine = store.restored()
    engine.watermark(MAP, 1, END_S * S, 0)
    released += engine.release()
    store.take(engine)
    return at_once, released, store


@settings(deadline=None, max_examples=40)
@given(arrivals())
def test_order_watermarks_and_restarts_change_nothing(found: list[Arrival]) -> None:
    rows = [arrival.row for arrival in found]
    expected = run_over(RULES, sorted(rows, key=lambda row: row.order), END_S * S)
    at_once, released, store = play(found, frozenset({"watermark", "release", "store", "restart"}))
    assert released == [event for event in expected if event.rule_name != "visits"]
    assert sorted(at_once, key=lambda event: event.event_id) == sorted(
        (event for event in expected if event.rule_name == "visits"), key=lambda event: event.event_id
    )
    assert store.late == []
    assert store.pending == {}


@settings(deadline=None, max_examples=40)
@given(arrivals())
def test_what_is_stored_in_the_end_is_the_same_wherever_it_was_cut(found: list[Arrival]) -> None:
    *_, once = play(found, frozenset({"watermark", "release"}))
    *_, often = play(found, frozenset({"watermark", "release", "store", "restart"}))
    assert often.states == once.states
    assert often.progress == once.progress


@settings(deadline=None, max_examples=40)
@given(arrivals())
def test_ids_tell_events_apart(found: list[Arrival]) -> None:
    at_once, released, _ = play(found, frozenset())
    ids = [event.event_id for event in at_once + released]
    assert len(set(ids)) == len(ids)
