"""States from a topic of Kafka, and events and changes to topics: each once, whoever is away meanwhile."""

from __future__ import annotations

import json
import resource
from itertools import pairwise
from pathlib import Path

import pytest
import shapely
from bridging import line, report, running, stored
from confluent_kafka import TopicPartition
from confluent_kafka.admin import NewPartitions
from hypothesis import given, settings
from hypothesis import strategies as st
from making import make_events
from patience import until
from semap_bridge.adapters.kafka.decoding import batch_of_records
from semap_bridge.adapters.kafka.moments import Moments
from semap_bridge.checking import check_bridge
from semap_service.processes.port import free_port
from topics import Topics, entry
from world import SECOND_US, World

from bench.kafka.broker import Broker
from semap.errors import Conflict, InvalidInput
from semap.timeline.stamp import rfc3339, to_datetime

FIRST_US = 1_700_000_000 * SECOND_US
BEGUN = "select from semap.bridge_position where position is not null"


@pytest.fixture
def topics(broker: Broker) -> Topics:
    return Topics(broker)


def walk(states: int, tracks: int = 3, first_us: int = FIRST_US) -> list[tuple]:
    return [(f"t{i % tracks}", first_us + i // tracks * SECOND_US, i * 0.1, 0.0) for i in range(states)]


def keyed(states: list[tuple]) -> list[tuple[str, bytes, int]]:
    """As records by track, whose values do not name it."""
    return [
        (name, json.dumps({"stamp": rfc3339(to_datetime(stamp_us)), "x_m": x_m, "y_m": y_m}).encode(), -1)
        for name, stamp_us, x_m, y_m in states
    ]


def columns(states: list[tuple]) -> bytes:
    names, stamps, xs, ys = zip(*states, strict=True)
    return json.dumps({"track": names, "stamp_us": stamps, "x_m": xs, "y_m": ys}).encode()


def test_each_state_of_a_topic_is_in_once(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    states = walk(900)
    topic = topics.make("states", 3)
    topics.write(topic, keyed(states[:300]))
    topics.write(topic, [(None, columns(states[i : i + 60]), i // 60 % 3) for i in range(300, 600, 60)])
    one = entry(tmp_path, broker, states=topic)
    with running(world, one):
        until(lambda: len(stored(world)) == 600)
    assert stored(world) == states[:600]
    topics.write(topic, [(name, line(name, *more), -1) for name, *more in states[600:]])
    with running(world, one):
        until(lambda: len(stored(world)) == 900)
    assert stored(world) == states
    told = report(world)
    assert (told["state"], told["received"], told["committed"], told["refused"]) == ("ended", 300, 300, 0)


def test_events_and_changes_go_out_in_their_order_once(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    track_id = world.add_track("cat")
    out, changes = topics.name("events"), topics.name("changes")
    one = entry(tmp_path, broker, events=out, changes=changes, from_start=True)
    made: list[str] = []
    for number in range(3):
        with running(world, one):
            made += make_events(world, 20)
            world.add_states([(track_id, number * SECOND_US, 1.0 if number % 2 == 0 else 9.0, 1.0, 1.0)])
            count = len(made)
            until(lambda count=count: topics.count(out) >= count)
            until(lambda number=number: topics.count(changes) > number)
    said = topics.events(out)
    assert [each["id"] for each in said] == made
    assert [int(each["sequence"]) for each in said] == sorted(int(each["sequence"]) for each in said)
    assert {each["specversion"] for each in said} == {"1.0"}
    (first, *_) = topics.read(out)
    assert first.headers() == [("content-type", b"application/cloudevents+json; charset=UTF-8")]
    assert [each["type"] for each in topics.events(changes)] == [
        "semap.relation.began", "semap.relation.ended", "semap.relation.began"
    ]  # fmt: skip
    assert {each.key() for each in topics.read(changes)} == {b"cat"}


def test_a_backlog_of_several_partitions_is_taken_in_the_order_of_time(
    world: World, tmp_path: Path, broker: Broker, topics: Topics, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the states of all partitions but the first would be late."""
    monkeypatch.setattr("semap_bridge.adapters.kafka.reading.RECORDS", 50)
    monkeypatch.setattr("semap_bridge.intake.TOGETHER", 50)
    states = walk(3000)
    topic = topics.make("states", 3)
    producer = topics.producer()
    for number, (name, *more) in enumerate(states):
        stamp_ms = (FIRST_US + number * 1000) // 1000
        producer.produce(topic, line(name, *more), name, partition=int(name[1:]), timestamp=stamp_ms)
    assert producer.flush(60) == 0
    producer.close()
    with running(world, entry(tmp_path, broker, states=topic)):
        until(lambda: len(stored(world)) == 3000)
    assert stored(world) == states
    assert world.one("select count(*) from semap.late_state") == 0


def test_what_cannot_be_read_is_counted_with_its_place_and_keeps_nothing_out(
    world: World, tmp_path: Path, broker: Broker, topics: Topics, caplog: pytest.LogCaptureFixture
) -> None:
    good = walk(4)
    topic = topics.make("states")
    bad = [
        b"no json", b"[1]", b"\xff\xfe", None, b"", b"7", b'{"track": ["a"], "x_m": [1, 2]}', b'{"x_m": 1, "y_m": 2}',
        line("a", 4_000_000_000 * SECOND_US, 1.0), line("a", FIRST_US, 1.0, colour="red"), b"[" * 100_000,
        b'{"instance": "no door", "property": "door", "value": "open", "stamp": "2026-01-31T12:00:00Z"}',
        b'\x00\x00\x00\x00\x07avro',
    ]  # fmt: skip
    topics.write(topic, [*keyed(good[:2]), *(("a", each, 0) for each in bad), *keyed(good[2:])])
    with running(world, entry(tmp_path, broker, states=topic)):
        until(lambda: len(stored(world)) == 4)
    assert stored(world) == good
    assert report(world)["refusals"] == {
        "not JSON": 5, "no state": 4, "no stamp": 1, "stamp in the future": 1, "unknown member": 1, "no such instance": 1,
    }  # fmt: skip
    assert "not JSON: partition 0 at 2: " in caplog.text


def test_a_broker_that_is_away_is_waited_for(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    topic, out = topics.make("states"), topics.name("events")
    states = walk(30)
    with running(world, entry(tmp_path, broker, states=topic, events=out, from_start=True)):
        topics.write(topic, keyed(states[:15]))
        made = make_events(world, 5)
        until(lambda: len(stored(world)) == 15 and topics.count(out) == 5)
        broker.kill()
        made += make_events(world, 5)
        until(lambda: report(world)["state"] == "waiting")
        assert broker.address in report(world)["trouble"]
        broker.start()
        until(broker.answers)
        topics.write(topic, keyed(states[15:]))
        until(lambda: len(stored(world)) == 30 and topics.count(out) == 10)
        until(lambda: report(world)["state"] == "connected")
    assert stored(world) == states
    assert [each["id"] for each in topics.events(out)] == made


def test_a_broker_whose_disk_is_full_is_waited_for(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    """No file may grow any more, which a broker meets as it meets a full disk: it gives up."""
    out = topics.name("events")
    with running(world, entry(tmp_path, broker, events=out, from_start=True)):
        made = make_events(world, 5)
        until(lambda: topics.count(out) == 5)
        fullest = max(each.stat().st_size for each in (broker.data / f"{out}-0").glob("*.log"))
        resource.prlimit(broker.pid, resource.RLIMIT_FSIZE, (fullest, resource.RLIM_INFINITY))
        made += make_events(world, 5)
        until(lambda: report(world)["state"] == "waiting")
        broker.kill()
        broker.start()
        until(broker.answers)
        until(lambda: topics.count(out) == 10)
    assert [each["id"] for each in topics.events(out)] == made


def test_who_lost_its_transactional_id_to_another_bridge_ends_and_says_so(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    out = topics.name("events")
    same = {"events": out, "transactional_id": topics.word, "from_start": True}
    first = entry(tmp_path, broker, **same)
    other = entry(tmp_path, broker, **same, name="other")
    told = pytest.raises(Conflict, match=f"took over the transactional id {topics.word}.events")
    with told, running(world, first) as zombie:
        made = make_events(world, 3)
        until(lambda: topics.count(out) == 3)
        with running(world, other):
            until(lambda: made.extend(make_events(world, 1)) or not zombie.is_alive())
            until(lambda: topics.count(out) == len(made))
    assert [each["id"] for each in topics.events(out)] == made


def test_a_cursor_is_found_though_others_have_open_transactions(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    """Committed readers see nothing behind an open transaction, so a cursor that was read too early were old."""
    out = topics.make("events")
    cursors = topics.make("cursors", 1, **{"cleanup.policy": "compact"})
    one = entry(tmp_path, broker, events=out, cursors=cursors, from_start=True)
    made = make_events(world, 2)
    with running(world, one):
        until(lambda: topics.count(out) == 2)
        other = topics.producer({"transactional.id": f"{topics.word}.other"})
        other.init_transactions(60)
        other.begin_transaction()
        other.produce(cursors, b'{"event": 1}', b"other")
        other.flush(60)
        made += make_events(world, 2)
        until(lambda: topics.count(out) == 4)
    with running(world, one):
        made += make_events(world, 2)
        until(lambda: "connected" in str(report(world)["state"]))
        other.abort_transaction(60)
        until(lambda: topics.count(out) >= 6)
    other.close()
    assert [each["id"] for each in topics.events(out)] == made


def test_topics_that_cannot_be_used_are_told(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    wrong = {
        "Unknown topic": entry(tmp_path, broker, states=topics.name("nowhere")),
        "is not compacted": entry(tmp_path, broker, events="e", cursors=topics.make("deleted")),
    }
    for said, one in wrong.items():
        with running(world, one):
            until(lambda said=said: said in trouble(world))


def trouble(world: World) -> str:
    return world.one("select coalesce(max(trouble), '') from semap.bridge where name = 'lines'")


def test_a_topic_that_was_made_anew_is_read_from_its_beginning(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    states = walk(60)
    topic = topics.make("states")
    topics.write(topic, keyed(states[:20]))
    one = entry(tmp_path, broker, states=topic)
    with running(world, one):
        until(lambda: len(stored(world)) == 20)
    topics.admin.delete_topics([topic])[topic].result(60)
    until(lambda: topic not in topics.admin.list_topics().topics)
    topics.make("states")
    topics.write(topic, keyed(states[20:]))
    with running(world, one):
        until(lambda: len(stored(world)) == 60)
    assert stored(world) == states


def test_records_that_were_deleted_before_they_were_read_are_counted(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    states = walk(30)
    topic = topics.make("states")
    topics.write(topic, keyed(states[:10]))
    one = entry(tmp_path, broker, states=topic)
    with running(world, one):
        until(lambda: len(stored(world)) == 10)
    topics.write(topic, keyed(states[10:]))
    (deleted,) = topics.admin.delete_records([TopicPartition(topic, 0, 25)]).values()
    deleted.result(60)
    with running(world, one):
        until(lambda: len(stored(world)) == 15)
    assert stored(world) == states[:10] + states[25:]
    assert report(world)["dropped"] == 15


def test_a_new_partition_is_read(
    world: World, tmp_path: Path, broker: Broker, topics: Topics, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semap_bridge.adapters.kafka.reading.PARTITIONS_S", 0.0)
    states = walk(20)
    topic = topics.make("states")
    with running(world, entry(tmp_path, broker, states=topic, begin="newest")):
        until(lambda: world.rows(BEGUN))
        topics.admin.create_partitions([NewPartitions(topic, 2)])[topic].result(60)
        topics.write(topic, [(name, line(name, *more), i % 2) for i, (name, *more) in enumerate(states)])
        until(lambda: len(stored(world)) == 20)


def test_only_what_is_new_is_read_where_the_config_says_so(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    states = walk(20)
    topic = topics.make("states", 2)
    topics.write(topic, keyed(states[:10]))
    one = entry(tmp_path, broker, states=topic, begin="newest")
    with running(world, one):
        until(lambda: world.rows(BEGUN))
    topics.write(topic, keyed(states[10:]))
    with running(world, one):
        until(lambda: len(stored(world)) == 10)
    assert stored(world) == states[10:]


def test_cursors_of_another_database_are_not_taken_for_ours(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    out = topics.name("events")
    one = entry(tmp_path, broker, events=out, from_start=True)
    with running(world, one):
        make_events(world, 5)
        until(lambda: topics.count(out) == 5)
    world.run("delete from semap.event")
    make_events(world, 2)
    told = pytest.raises(Conflict, match=r"up to number 5 .* and this database up to 2")
    with told, running(world, one) as thread:
        until(lambda: not thread.is_alive())


def test_a_check_sees_topics_and_makes_none(
    world: World, tmp_path: Path, broker: Broker, topics: Topics
) -> None:
    topic = topics.make("states", 2)
    topics.write(topic, [*keyed(walk(30)), (None, b"nonsense", 0)])
    one = entry(tmp_path, broker, states=topic, events=topics.name("events"))
    seen = check_bridge(world.dsn, one, 3.0)
    assert [(each.what, each.is_a) for each in seen[:3]] == [
        (topic, "topic of states, 2 partitions"),
        (topics.name("events"), "topic of events, which will be made"),
        ("states", "of 3 tracks"),
    ]
    assert seen[2].rate_hz == 10.0
    assert [each.trouble for each in seen if each.trouble] == ["1 records: not JSON."]
    assert [each for each in topics.admin.list_topics().topics if each.startswith(topics.word)] == [topic]
    assert stored(world) == []
    away = entry(tmp_path, broker, servers=f"127.0.0.1:{free_port()}", events="e")
    (sight,) = check_bridge(world.dsn, away, 0.1)
    assert "Kafka at 127.0.0.1" in sight.trouble
    assert "brokers run" in sight.remedy


@pytest.mark.parametrize(
    ("settings", "said"),
    [({}, "states, events or changes"), ({"states": "a b"}, "states"), ({"events": "a", "changes": "a"}, "of its own"),
     ({"events": "a", "servers": "here"}, "servers"), ({"events": "a", "login": {"user": "u", "password": "p"}}, "login")],
)  # fmt: skip
def test_settings_that_cannot_be_meant_are_refused(
    tmp_path: Path, broker: Broker, settings: dict[str, object], said: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        entry(tmp_path, broker, **settings)
    assert said in f"{refused.value} {refused.value.remedy}"


VALUES = st.one_of(
    st.none(),
    st.binary(max_size=60),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["track", "stamp", "stamp_us", "x_m", "y_m", "is_last", "std_m", "instance",
                             "property", "value", "attributes", "other"]),
            inner, max_size=6,
        ),
        max_leaves=12,
    ).map(lambda value: json.dumps(value).encode()),
)  # fmt: skip


class Recorded:
    """As `confluent_kafka.Message`, which only a consumer makes."""

    def __init__(self, key: bytes | None, value: bytes | None, offset: int) -> None:
        self.key, self.value = lambda: key, lambda: value
        self.partition, self.offset = lambda: 7, lambda: offset


@given(
    stamps=st.lists(st.integers(0, 3), max_size=30).map(sorted),
    cuts=st.lists(st.integers(0, 30), max_size=5).map(sorted),
    is_odd=st.lists(st.booleans(), min_size=30, max_size=30),
)
def test_a_moment_is_given_on_in_one_piece(stamps: list[int], cuts: list[int], is_odd: list[bool]) -> None:
    """However its records come; and the position is behind whatever is held back."""
    records = [
        Recorded(None, b"?" if odd and number % 7 == 3 else line(f"t{number}", stamp, 1.0), number)
        for number, (stamp, odd) in enumerate(zip(stamps, is_odd, strict=False))
    ]
    good = [number for number, each in enumerate(records) if each.value() != b"?"]
    moments, given_on, done = Moments(), [], 0
    bounds = [0, *(each for each in cuts if each < len(records)), len(records)]
    for number, (begin, end) in enumerate(pairwise(bounds)):
        part = records[begin:end]
        is_more = number < len(bounds) - 2
        batch = moments.take(part, batch_of_records(part), is_more=is_more)
        given_on += [int(name[1:]) for name in batch.states.names]
        done = moments.begins().get(7, end)
        assert given_on == [each for each in good if each < done]
        if is_more and len(good) == len(records) and given_on:
            assert not {stamps[each] for each in given_on} & {stamps[each] for each in range(done, end)}
            assert end == done or stamps[done] == stamps[end - 1]
    assert done == len(records)
    assert given_on == good


@settings(max_examples=300)
@given(records=st.lists(st.tuples(st.none() | st.binary(max_size=8), VALUES), max_size=6))
def test_whatever_is_in_records_is_read_or_refused(records: list[tuple[bytes | None, bytes | None]]) -> None:
    good = b'{"track": "good", "stamp_us": 1, "x_m": 1, "y_m": 2}'
    said = [Recorded(key, value, i) for i, (key, value) in enumerate([*records, (None, good)])]
    batch = batch_of_records(said)
    assert batch.states.names[-1] == "good"
    for each in batch.refused:
        assert each.detail.startswith(f"partition 7 at {each.index}: ")
        assert each.reason
