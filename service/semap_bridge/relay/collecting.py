"""Events of rules that run elsewhere, from their topic into the database, numbered there, each once."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from threading import Event as Signal

from confluent_kafka import Message

from semap.errors import ServerUnavailable, ServiceUnreachable
from semap.store.database.backoff import Patience
from semap.store.database.connection import own_session
from semap.store.event.collected import collect, offsets
from semap_bridge.relay.deriving import Rules
from semap_bridge.relay.topics import Topics

log = logging.getLogger(__name__)

ROLE = "semap_worker"


def collecting(dsn: str, topics: Topics, shard: str, stop: Signal) -> None:
    """Write what rules made of a shard until `stop` is set; whoever is away is awaited."""
    patience = Patience(log, "Events wait to be written")
    while not stop.is_set():
        try:
            _collect(dsn, topics, shard, stop, patience)
        except (ServerUnavailable, ServiceUnreachable) as error:
            patience.wait(error, stop)


def _collect(dsn: str, topics: Topics, shard: str, stop: Signal, patience: Patience) -> None:
    with (
        closing(own_session(dsn, ROLE, application="semap collect")) as connection,
        closing(topics.reader(topics.events, offsets(connection, topics.events))) as reader,
    ):
        while not stop.is_set():
            before = dict(reader.next)
            for partition, messages in _by_partition(reader.read()).items():
                events, late = _said(messages, shard)
                from_to = before[partition], reader.next[partition]
                collect(connection, topics.events, partition, from_to, events, late)
            patience.restored()


def _by_partition(messages: Iterable[Message]) -> dict[int, list[Message]]:
    found: dict[int, list[Message]] = {}
    for message in messages:
        found.setdefault(message.partition() or 0, []).append(message)
    return found


def _said(messages: Iterable[Message], shard: str) -> tuple[list[str], list[str]]:
    """The events and the late rows of a shard."""
    events: list[str] = []
    late: list[str] = []
    for message in messages:
        said = json.loads(message.value() or b"")
        if said["shard"] == shard:
            (events if "event" in said else late).append(json.dumps(said.get("event") or said["late"]))
    return events, late


@dataclass(frozen=True)
class Check:
    """A map's steps taken once more, here, beside what its rules wrote; ids of events.

    same       in both, alike in all that they say
    different  in both, not alike
    missing    made here only; rules that are behind have not made the newest yet
    unknown    written only
    """

    same: int
    different: Sequence[str] = ()
    missing: Sequence[str] = ()
    unknown: Sequence[str] = ()


def check(topics: Topics, map_uid: str) -> Check:
    """Take all steps of a map that its topic has; raises ServiceUnreachable."""
    rules, here, there = Rules(), dict[str, object](), dict[str, object]()
    with closing(topics.reader(topics.due, {})) as reader:
        for message in reader.until_now():
            if message.key() == map_uid.encode():
                here |= _events(said for _, said in rules.take([message]))
    with closing(topics.reader(topics.events, {})) as reader:
        for message in reader.until_now():
            if message.key() == map_uid.encode():
                there |= _events([(message.value() or b"").decode()])
    both = here.keys() & there.keys()
    different = sorted(event_id for event_id in both if here[event_id] != there[event_id])
    return Check(
        len(both) - len(different),
        different,
        sorted(here.keys() - there.keys()),
        sorted(there.keys() - here.keys()),
    )


def _events(texts: Iterable[str]) -> dict[str, object]:
    found = (said["event"] for text in texts if "event" in (said := json.loads(text)))
    return {event["event_id"]: event for event in found}
