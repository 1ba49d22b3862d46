"""What messages say: of whatever comes, each format makes states that can be sifted, or says why it does not."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from semap_bridge.adapters.mqtt import Read
from semap_bridge.adapters.nats import number_of
from semap_bridge.adapters.omlox import OmloxHub, OmloxSettings
from semap_bridge.home_assistant.discovery import person_named_in, states_named_in
from semap_bridge.messages.cursor import number_in
from semap_bridge.messages.path import TopicPattern, find, read_path
from semap_bridge.messages.told import Message, Told, Unusable, compass_rad, read_stamp
from semap_bridge.placing import Placement, states_of
from semap_ingest.named_states import sifted

from semap.errors import ServiceUnreachable

NOW_US = 1_700_000_000_000_000
READ: TypeAdapter[Any] = TypeAdapter(Read)
READINGS = [
    READ.validate_python(each)
    for each in (
        {"topic": "t/{tag}", "track": "{tag}", "x": "$.x", "y": "$.y", "z": "$.z", "std": "$.s", "heading": "$.h",
         "speed": "$.v", "stamp": "$.t", "unit": "ft"},
        {"topic": "t/#", "track": "$.id", "x": "$[0]", "y": "$.p[1]['y']", "each": "$.all", "unit": "deg"},
        {"topic": "t/+", "instance": "$.id", "property": "$.of", "value": "$.v", "values": {"true": "on"}},
        {"topic": "t/{door}", "instance": "{door}", "value": "$", "payload": "text"},
        {"format": "espresense", "topic": "t/{device}/#"},
        {"format": "frigate", "topic": "t/#"},
        {"format": "omlox", "topic": "t/#"},
    )
]  # fmt: skip
EXAMPLES = [
    {"x": 1, "y": 2.5, "z": "3", "s": 0.1, "h": 90, "v": 1, "t": "2023-11-14T22:13:20Z", "id": "a", "of": "lamp"},
    {"x": 1, "y": 2, "t": 1_700_000_000.5, "all": [{"id": 1, "p": [0, {"y": 1}]}], "last_seen": "2023-11-14T22:13:20Z"},
    {"type": "new", "before": {}, "after": {"camera": "door", "id": "1.2-a", "frame_time": 1607123961.8, "box": [1, 2]}},
    {"position": {"type": "Point", "coordinates": [1, 2, 3]}, "provider_id": "a", "crs": "local", "accuracy": 1,
     "true_heading": -1, "course": 90, "speed": 2, "timestamp_generated": "2023-11-14T22:13:20Z", "trackables": ["u"]},
]  # fmt: skip
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text()
    | st.sampled_from(["NaN", "1e999", "\0", "\ud800", "-inf"])
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


def places(value: object, path: tuple = ()) -> list[tuple]:
    found = [path] if path else []
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return found + [each for key, inner in items for each in places(inner, (*path, key))]


@st.composite
def spoilt(draw: st.DrawFn) -> bytes:
    """A message as it should be, in which some values are others, or are missing."""
    value = json.loads(json.dumps(draw(st.sampled_from(EXAMPLES))))
    for _ in range(draw(st.integers(0, 3))):
        *way, last = draw(st.sampled_from(places(value) or [("x",)]))
        inner = value
        for step in way:
            inner = inner[step]
        if draw(st.booleans()):
            inner[last] = draw(VALUES)
        elif isinstance(inner, dict):
            inner.pop(last, None)
    return json.dumps(value).encode()


PAYLOADS = st.binary(max_size=40) | VALUES.map(lambda each: json.dumps(each).encode()) | spoilt()
TOPICS = st.sampled_from(["t/a", "t/", "t/a/attributes", "t/\0", "t/a/b", "u"]) | st.text(max_size=9).map(
    "t/".__add__
)


@given(topic=TOPICS, payload=PAYLOADS, is_retained=st.booleans())
@example(topic="t/a", payload=b"[" * 100_000, is_retained=False)
@example(topic="t/a", payload=b"9" * 5000, is_retained=False)
@example(topic="t/a", payload=b'{"x": 1' + b"0" * 400 + b', "y": 1, "t": 1}', is_retained=False)
@example(topic="t/a", payload=b'{"x": 1, "y": 1, "t": -1e300}', is_retained=False)
@example(topic="t/a", payload=b'{"x": 1, "y": 1, "t": "0001-01-01T00:00:00+23:59"}', is_retained=False)
@example(topic="t/a/attributes", payload=b"not_home", is_retained=False)
def test_whatever_comes_is_read_or_refused(topic: str, payload: bytes, is_retained: bool) -> None:
    for reading in READINGS:
        with suppress(Unusable):
            if reading.is_about(topic):
                _is_sound(reading.read(Message(topic, payload, NOW_US, is_retained)))


def _is_sound(told: Told) -> None:
    states = states_of([Placement(reading_pose()).place(each) for each in told.located])
    good, refused = sifted(states, NOW_US)
    assert len(good) + len(refused) == len(told.located)
    assert all(math.isfinite(each.x) and math.isfinite(each.y) for each in told.located)
    for each in told.objects:
        json.dumps([each.instance, each.property, each.value]).encode()
        assert each.value
    for report in told.reports:
        assert report.camera
        assert isinstance(report.document, dict)


def reading_pose() -> Any:
    return READINGS[0].origin.pose().matrix()


DOCUMENTS = st.fixed_dictionaries(
    {},
    optional={
        "sequence": VALUES | st.integers().map(str),
        "source": st.just("/maps/world") | VALUES,
        "event": VALUES,
        "device": VALUES | st.fixed_dictionaries({"model": st.just("person"), "name": st.text() | VALUES}),
        "state_topic": st.text() | VALUES,
        "components": st.dictionaries(
            st.text(max_size=3),
            st.fixed_dictionaries({}, optional={"state_topic": st.text() | VALUES}) | VALUES,
        ),
    },
).map(lambda each: json.dumps(each).encode())


@given(kept=PAYLOADS | DOCUMENTS)
@example(kept=b"[" * 100_000)
@example(kept=b'{"sequence": Infinity, "source": "/maps/world", "event": 1e999}')
@example(
    kept=b'{"device": {"model": "person", "name": "\\ud800"}, "components": {"a": {"state_topic": "+"}}}'
)
def test_whatever_a_broker_keeps_is_ours_or_is_none(kept: bytes) -> None:
    """What adapters read back: the last event of a subject, a cursor, documents of Home Assistant."""
    number = number_of(kept, "world")
    assert number is None or json.loads(kept)["source"] == "/maps/world"
    with suppress(ValueError):
        assert isinstance(number_in(kept, "event"), int)
    for text in [*states_named_in(kept), person_named_in(kept) or "nobody"]:
        assert text.encode().strip()
        assert "\0" not in text
    assert not any("+" in each or "#" in each for each in states_named_in(kept))


@given(
    payload=PAYLOADS
    | DOCUMENTS
    | st.builds(
        lambda said: json.dumps({"event": "message", "topic": "location_updates", "payload": said}).encode(),
        VALUES | spoilt().map(json.loads),
    )
)
@example(payload=b"[" * 100_000)
@example(payload=b'{"event": "error", "code": [1], "description": {}}')
def test_whatever_a_hub_says_is_read_or_refused(payload: bytes) -> None:
    hub = OmloxHub(OmloxSettings(name="hub", kind="omlox", url="ws://hub/socket"), None)
    with suppress(ServiceUnreachable):
        for told in hub._read(payload, NOW_US):
            _is_sound(told)


@given(value=VALUES)
def test_a_path_finds_what_is_there(value: object) -> None:
    for place in places(value):
        text = "$" + "".join(f"[{step}]" if isinstance(step, int) else f"['{step}']" for step in place)
        wanted = value
        for step in place:
            wanted = wanted[step]  # type: ignore[index]
        if "'" not in text.replace("['", "").replace("']", "") and not any(
            "]" in str(step) for step in place
        ):
            assert find(value, read_path(text)) is wanted


@pytest.mark.parametrize(
    "text", ["x", "$x", "$.", "$..x", "$[x]", "$.x[", "$['a", "$.*", "$.x{y}", "$[99999999999]"]
)
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="path"):
        read_path(text)


def test_topics_are_matched_as_a_broker_does() -> None:
    """As MQTT says (4.7): # also stands for its parent, + for one level, which may be empty."""
    cases = {
        ("a/{x}/b", "a/1/b"): {"x": "1"}, ("a/{x}/b", "a/1/2/b"): None, ("a/{x}", "a/"): {"x": ""}, ("a/#", "a"): {},
        ("a/#", "a/b/c"): {}, ("a/#", "ab"): None, ("#", "a/b"): {}, ("+/{x}", "a/b"): {"x": "b"}, ("a.b", "axb"): None,
        ("{x}/{y}", "1/2"): {"x": "1", "y": "2"}, ("a/{x}/#", "a/1"): {"x": "1"},
    }  # fmt: skip
    for (pattern, topic), parts in cases.items():
        assert TopicPattern(pattern).match(topic) == parts, (pattern, topic)
    assert TopicPattern("a/{x}/+/#").wanted == "a/+/+/#"
    for wrong in ("a/#/b", "a{x}", "{x}/{x}", "a/b#", "", "a/{}"):
        with pytest.raises(ValueError):
            TopicPattern(wrong)


def test_a_template_that_cannot_work_is_refused() -> None:
    good = {"topic": "t/{tag}", "track": "{tag}", "x": "$.x", "y": "$.y"}
    READ.validate_python(good)
    for more in (
        {"y": None},
        {"track": None},
        {"track": "{gat}"},
        {"x": "x"},
        {"instance": "a"},
        {"unit": "km"},
        {"colour": 1},
    ):
        with pytest.raises(ValidationError):
            READ.validate_python({**good, **more})


def test_stamps_and_headings() -> None:
    at_us = 1_700_000_000_000_000
    for stamp in (
        "2023-11-14T22:13:20Z",
        "2023-11-14T23:13:20+01:00",
        at_us / 1e6,
        at_us // 1000,
        at_us,
        at_us * 1000,
        str(at_us),
    ):
        assert read_stamp(stamp) == at_us
    for wrong in (None, "", "noon", "2023-11-14T22:13:20", True, [], math.nan, 1e30):
        with pytest.raises(Unusable):
            read_stamp(wrong)
    assert read_stamp("2000-01-01T00:00:00Z") == 946_684_800_000_000
    for unset in (0, 99.5, 86_400_000, "1970-01-01T00:01:39Z", 946_684_799):
        with pytest.raises(Unusable, match="stamp before 2000"):
            read_stamp(unset)
    assert [round(math.degrees(compass_rad(each))) for each in (0, 90, 45, 450)] == [90, 0, 45, 0]
