"""Which events a selection takes, against plain Python."""

from datetime import timedelta

import pytest
import shapely
from stored import STAMP, stored

from semap.errors import InvalidInput
from semap.store.event.event_selection import KINDS, Selection

EVENTS = [
    stored(1),
    stored(2, type="left", map="home", rule="other"),
    stored(3, track_id=None, track_name=None, cause=None, key={"room": "Room08"}, measures={"gap_s": 1.5}),
    stored(4, instance_id=None, instance_name=None, measures={"gap_s": 4, "who": ["a", "b"]}),
    stored(5, stamp=STAMP + timedelta(hours=1), confidence=0.5, verdict="confirmed", by_batch=True),
    stored(6, measures={"gap_s": "long", "n": {"deep": 2}}, place=shapely.Point(3, 4).wkb),
]


@pytest.mark.parametrize(
    ("text", "taken"),
    [
        ("map = 'office'", {1, 3, 4, 5, 6}),
        ("type = 'left' OR rule = 'other'", {2}),
        ("track = 'person'", {1, 2, 4, 5, 6}),
        ("track_id IS NULL", {3}),
        ("instance IS NULL AND track_id = 3", {4}),
        ("instance_id IN (7, 8)", {1, 2, 3, 5, 6}),
        ("stamp > TIMESTAMP('2026-01-31T12:30:00Z')", {5}),
        ("since <= TIMESTAMP('2026-01-31T12:00:00Z')", {1, 2, 3, 4, 5, 6}),
        ("measures.gap_s > 1", {3, 4}),
        ("payload.gap_s > 1 AND payload.room = 'Room08'", {3}),
        ("measures.n.deep = 2", {6}),
        ("measures.who.1 = 'b'", {4}),
        ("key.room LIKE 'Room%'", {3}),
        ("NOT cause = 'moved'", set()),
        ("confidence >= 0.5 AND by_batch = TRUE AND verdict = 'confirmed'", {5}),
        ("seq BETWEEN 2 AND 4 AND rule_version = 1", {2, 3, 4}),
        ("S_INTERSECTS(place, BBOX(2, 3, 4, 5))", {6}),
        ("S_DISJOINT(place, POINT(0 0))", {6}),
        ("place IS NULL AND type = 'left'", {2}),
        ("CASEI(map) = CASEI('HOME')", {2}),
    ],
)
def test_a_filter_takes_what_it_says(text: str, taken: set[int]) -> None:
    selection = Selection(filter=text)
    selection.check()
    assert {each.seq for each in EVENTS if selection.takes(each)} == taken


def test_every_property_can_be_asked_for() -> None:
    named = {"track": "track_name", "instance": "instance_name"}
    for name, kind in KINDS.items():
        selection = Selection(filter=f"{name} IS NULL" if kind != "any" else f"{name}.room IS NULL")
        missing = (
            [each for each in EVENTS if "room" not in (each.measures if name == "measures" else each.key)]
            if kind == "any"
            else [each for each in EVENTS if getattr(each, named.get(name, name)) is None]
        )
        assert [each for each in EVENTS if selection.takes(each)] == missing, name


def test_all_that_is_asked_must_hold() -> None:
    selection = Selection("office", "entered", "room_visits", "seq > 3", frozenset({"office"}))
    assert [each.seq for each in EVENTS if selection.takes(each)] == [4, 5, 6]
    assert not any(Selection(maps=frozenset()).takes(each) for each in EVENTS)
    assert [each.seq for each in EVENTS if Selection(maps=frozenset({"home"})).takes(each)] == [2]


@pytest.mark.parametrize(
    "text", ["", "type =", "colour = 1", "type", "isA('Room')", "seq = 'one'", "(" * 5000]
)
def test_what_is_no_filter_is_refused(text: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        Selection(filter=text).check()
    assert str(caught.value)
