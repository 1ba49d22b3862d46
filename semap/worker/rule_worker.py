"""The rule worker: reads changes off the log, lets the rules make events, commits them.

Everything that the worker makes of a stretch of the log is committed in one transaction with the
end of that stretch, and only then acknowledged to the server. Killed at any moment it begins again
where it had committed, and makes the same events with the same ids.

A stretch that made no event only moves watermarks; it is committed at the latest after a second.
One worker reads at a time: the slot belongs to it, and the place in the log is compared when it is
moved. Another one waits and takes over.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from threading import Event as Signal
from types import MappingProxyType

import psycopg
from psycopg.types.json import Jsonb

from semap.errors import ServerUnavailable, SlotLost
from semap.model.event import Event
from semap.replication.pgoutput import Transaction, format_lsn, parse_lsn
from semap.replication.stream import ReplicationStream, SlotInUse, open_stream
from semap.rules.engine import RuleSet
from semap.store.database import connect, translated
from semap.worker.inputs import deleted_map, rule_input, watermark

log = logging.getLogger(__name__)

WORKER = "rules"
PUBLICATIONS = ("semap_change", "semap_rule")
ROLE = "semap_worker"
QUIET_COMMIT_S = 1.0
RECEIVE_S = 0.5
FIRST_RETRY_S = 0.05
LAST_RETRY_S = 2.0


@dataclass(frozen=True)
class Progress:
    """How far the worker has come, and what it knew there."""

    lsn: int
    rules: RuleSet
    watermarks: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True)
class Made:
    """What a stretch of the log makes: events, and maps that it deletes, whose events go."""

    events: tuple[Event, ...] = ()
    gone_maps: tuple[int, ...] = ()


def work(dsn: str, stop: Signal) -> None:
    """Follow the log until `stop` is set; a lost server is awaited, a taken slot too.

    raises SlotLost where the slot is gone, so that changes may have been missed
    """
    wait_s = FIRST_RETRY_S
    waiting_for = ""
    while not stop.is_set():
        try:
            for _ in _follow(dsn, stop):
                wait_s, waiting_for = FIRST_RETRY_S, ""
        except SlotLost:
            raise
        except (ServerUnavailable, psycopg.OperationalError) as error:
            if str(error) != waiting_for:
                waiting_for = str(error)
                log.log(
                    logging.INFO if isinstance(error, SlotInUse) else logging.WARNING, "%s Waiting.", error
                )
            stop.wait(wait_s)
            wait_s = min(wait_s * 2, LAST_RETRY_S)


def _follow(dsn: str, stop: Signal) -> Iterator[None]:
    """Read and commit; yields after every receive, so that its caller knows that all is well."""
    with connect(dsn, ROLE, application="semap work") as connection:
        progress, slot = _load(connection)
        stream = open_stream(dsn, slot, PUBLICATIONS, progress.lsn)
        log.info(
            "Following the log from %s with %d rules.", format_lsn(progress.lsn), len(progress.rules.rules)
        )
        try:
            yield from _read(connection, stream, progress, stop)
        finally:
            stream.close()


def _read(
    connection: psycopg.Connection, stream: ReplicationStream, progress: Progress, stop: Signal
) -> Iterator[None]:
    committed = progress
    commit_due_s = 0.0
    while not stop.is_set():
        transactions = stream.receive(RECEIVE_S)
        yield
        made = Made()
        if transactions:
            if progress is committed:
                commit_due_s = time.monotonic() + QUIET_COMMIT_S
            progress, made = advance(progress, transactions)
        if made != Made() or (progress is not committed and time.monotonic() >= commit_due_s):
            commit_progress(connection, committed.lsn, progress, made)
            committed = progress
            stream.acknowledge(progress.lsn)
    if progress is not committed:
        commit_progress(connection, committed.lsn, progress, Made())
        stream.acknowledge(progress.lsn)


def advance(progress: Progress, transactions: list[Transaction]) -> tuple[Progress, Made]:
    """The progress after these transactions, and what they make. Changes nothing."""
    rules = progress.rules
    watermarks = dict(progress.watermarks)
    events: list[Event] = []
    gone_maps: list[int] = []
    for change in (change for transaction in transactions for change in transaction.changes):
        mark = watermark(change)
        if mark is not None:
            watermarks[mark[0]] = mark[1]
        map_id = deleted_map(change)
        if map_id is not None:
            gone_maps.append(map_id)
            events = [event for event in events if event.map_id != map_id]
        item = rule_input(change)
        if item is not None:
            rules, made = rules.step(item)
            events.extend(made)
    after = replace(
        progress, lsn=transactions[-1].end_lsn, rules=rules, watermarks=MappingProxyType(watermarks)
    )
    return after, Made(tuple(events), tuple(gone_maps))


def _load(connection: psycopg.Connection) -> tuple[Progress, str]:
    with translated():
        row = connection.execute(
            "select lsn::text, rule_state, watermarks, semap.rule_slot()"
            " from semap.progress where worker = %s",
            [WORKER],
        ).fetchone()
    if row is None:
        raise SlotLost("The rule worker has no place in the log.", "Run `semap db migrate`.")
    lsn, rule_state, watermarks, slot = row
    if parse_lsn(lsn) == 0:
        raise SlotLost("A `semap db resync` was begun and did not end.", "Run `semap db resync` again.")
    return Progress(parse_lsn(lsn), RuleSet.from_json(rule_state), MappingProxyType(watermarks)), slot


def commit_progress(connection: psycopg.Connection, before_lsn: int, after: Progress, made: Made) -> int:
    """Write what was made and the progress in one statement, if the place in the log is still `before_lsn`.

    returns  the number of the last event there is
    raises   ServerUnavailable where another worker has moved on
    """
    with translated():
        row = connection.execute(
            "select semap.commit_progress(%s, %s::pg_lsn, %s::pg_lsn, %s, %s, %s, %s)",
            [
                WORKER,
                format_lsn(before_lsn),
                format_lsn(after.lsn),
                Jsonb(after.rules.as_json()),
                Jsonb(dict(after.watermarks)),
                list(made.gone_maps),
                Jsonb([event_json(event) for event in made.events]),
            ],
        ).fetchone()
    return int(row[0]) if row else 0


def event_json(event: Event) -> dict[str, object]:
    """An event as `semap.commit_progress` takes it."""
    return {
        "event_id": str(event.event_id),
        "map_id": event.map_id,
        "rule_name": event.rule_name,
        "rule_version": event.rule_version,
        "type": event.type,
        "stamp": event.stamp.isoformat(),
        "cause": event.cause,
        "track_id": event.track_id,
        "track_name": event.track_name,
        "instance_id": event.instance_id,
        "instance_name": event.instance_name,
        "since": event.since.isoformat(),
        "evidence": [str(uid) for uid in event.evidence],
    }
