"""A recording played through all of semap: what came out of it, and when."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from threading import Event as Signal
from threading import Thread

from semap_ingest.pipeline.ingest_recording import Ingested, Plan, ingest_recording
from semap_ingest.pipeline.meter import Meter, no_meter

from semap.errors import DatabaseError, NotFound
from semap.rules.language.reading import read_declaration
from semap.store.database.connection import listen, one_transaction, own_session, wait_for_notice
from semap.store.database.event_number import newest_event
from semap.store.event.event_progress import end_of_log, has_read
from semap.store.event.events import StoredEvent, list_events
from semap.store.event.rules import add_rule
from semap.store.map.maps import delete_map
from semap.timeline.stamp import to_us
from semap_service.exchange.map_file import bring_in, read_file

PATIENCE_S = 60.0
POLL_S = 0.2


@dataclass(frozen=True)
class PlayedEvent:
    """An event as a client sees it.

    place       the room or the door that it is about
    received_s  when it was here [s, monotonic clock of this machine]
    """

    seq: int
    event_id: str
    type: str
    stamp_us: int
    track: str | None
    place: str
    measures: Mapping[str, object]
    received_s: float


@dataclass(frozen=True)
class Played:
    """took_s  from the first record to the last event"""

    events: tuple[PlayedEvent, ...]
    ingested: Ingested
    took_s: float


def set_the_stage(dsn: str, map_file: Path, name: str) -> None:
    """A map of this name from a file, with the rules of the office; one that was there is deleted first."""
    with one_transaction(dsn, "semap_api") as connection:
        with suppress(NotFound):
            delete_map(connection, name)
        bring_in(connection, read_file(map_file), name, name)
        for text in office_rules():
            add_rule(connection, name, read_declaration(text))


def office_rules() -> list[str]:
    """Who enters and leaves, what doors do, and what of both belongs together: texts in YAML."""
    folder = files("semap_service.evaluation") / "office_rules"
    texts = [each.read_text() for each in folder.iterdir() if each.name.endswith(".yaml")]
    # what others read comes first
    return sorted(texts, key=lambda text: ("{rule:" in text, text))


def play(
    dsn: str, plan: Plan, meter: Meter = no_meter, shown: Callable[[PlayedEvent], None] | None = None
) -> Played:
    """Ingest a recording, and gather the events of its map as they are committed."""
    with listening(dsn, plan.map_name, shown) as events:
        started_s = time.monotonic()
        ingested = ingest_recording(dsn, plan, meter=meter)
        wait_for_rules(dsn)
    ended_s = max([started_s, *(event.received_s for event in events)])
    return Played(tuple(events), ingested, ended_s - started_s)


@contextmanager
def listening(
    dsn: str, map_name: str, shown: Callable[[PlayedEvent], None] | None = None
) -> Iterator[list[PlayedEvent]]:
    """The events of a map from now on, as they come; at the end all that are committed are there."""
    events: list[PlayedEvent] = []
    over, ready = Signal(), Signal()
    thread = Thread(target=_listen, args=(dsn, map_name, events, shown, ready, over), daemon=True)
    thread.start()
    ready.wait(PATIENCE_S)
    try:
        yield events
    finally:
        over.set()
        thread.join()


def wait_for_rules(dsn: str) -> None:
    """Wait until the rule worker has committed all that is in the log now.

    raises  DatabaseError where it does not
    """
    deadline_s = time.monotonic() + PATIENCE_S
    with own_session(dsn, "semap_ingest", application="semap evaluate") as connection:
        lsn = end_of_log(connection)
        while time.monotonic() < deadline_s:
            if has_read(connection, lsn):
                return
            Signal().wait(POLL_S)
    raise DatabaseError("The rule worker does not keep up.", "See the log of `semap work`.")


def _listen(
    dsn: str,
    map_name: str,
    events: list[PlayedEvent],
    shown: Callable[[PlayedEvent], None] | None,
    ready: Signal,
    over: Signal,
) -> None:
    with (
        listen(dsn, "semap_event", "semap_read", application="semap evaluate") as listening,
        own_session(dsn, "semap_read", application="semap evaluate") as connection,
    ):
        last = newest_event(connection)
        ready.set()
        while True:
            is_over = over.is_set()
            while found := list_events(connection, after=last, map_name=map_name):
                last = found[-1].seq
                for event in map(_played, found):
                    events.append(event)
                    if shown is not None:
                        shown(event)
            if is_over:
                return
            wait_for_notice(listening, POLL_S)


def _played(event: StoredEvent) -> PlayedEvent:
    place = event.measures.get("room") or event.key.get("room") or event.instance_name
    return PlayedEvent(
        event.seq, str(event.event_id), event.type, to_us(event.stamp), event.track_name,
        str(place), event.measures, time.monotonic(),
    )  # fmt: skip
