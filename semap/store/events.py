"""Events in the order in which they were committed.

The number of an event (`seq`) is its place: events become visible in the order of their numbers, so
that whoever has seen number n has seen everything up to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import Connection, func, select
from sqlalchemy.dialects.postgresql import aggregate_order_by

from semap.model.event import Evidence
from semap.store.database import translated
from semap.store.tables import event, event_amendment, event_evidence, map_, progress


@dataclass(frozen=True)
class StoredEvent:
    """An event with its number, its map by name, and what the batch layer said of it when it was read.

    verdict     confirmed, retracted or amended; None where the batch layer has not looked
    amended_by  the event that stands in its place
    by_batch    whether the batch layer made it
    """

    seq: int
    event_id: UUID
    map: str
    type: str
    stamp: datetime
    cause: str | None
    rule: str
    rule_version: int
    track_id: int | None
    track_name: str | None
    instance_id: int | None
    instance_name: str | None
    since: datetime
    key: Mapping[str, object]
    measures: Mapping[str, object]
    confidence: float | None
    by_batch: bool
    verdict: str | None
    amended_by: UUID | None
    evidence: tuple[Evidence, ...]


def list_events(
    connection: Connection,
    *,
    after: int = 0,
    limit: int = 100,
    map_name: str | None = None,
    event_type: str | None = None,
    rule_name: str | None = None,
) -> tuple[StoredEvent, ...]:
    """At most `limit` events with numbers above `after`, in their order."""
    found = _EVENTS.where(event.c.seq > after).order_by(event.c.seq).limit(limit)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    if event_type is not None:
        found = found.where(event.c.type == event_type)
    if rule_name is not None:
        found = found.where(event.c.rule_name == rule_name)
    with translated():
        rows = connection.execute(found).all()
    return tuple(_event(row) for row in rows)


def newest_event(connection: Connection) -> int:
    """The number of the newest event; 0 where there was none. It does not go back when a map is deleted."""
    made = select(func.max(progress.c.event_seq)).scalar_subquery()
    there = select(func.max(event.c.seq)).scalar_subquery()
    with translated():
        return int(connection.scalar(select(func.greatest(made, there, 0))) or 0)


def _event(row: Sequence[Any]) -> StoredEvent:
    *made, evidence = row
    return StoredEvent(*[*made, tuple(_evidence(*each) for each in evidence or ())])


def _evidence(uid: str, variable: str, source: Any, stamp: str) -> Evidence:
    return Evidence(UUID(uid), variable, source, datetime.fromisoformat(stamp))


_EVENTS = (
    select(
        event.c.seq,
        event.c.event_id,
        map_.c.name,
        event.c.type,
        event.c.stamp,
        event.c.cause,
        event.c.rule_name,
        event.c.rule_version,
        event.c.track_id,
        event.c.track_name,
        event.c.instance_id,
        event.c.instance_name,
        event.c.since,
        event.c.key,
        event.c.measures,
        event.c.confidence,
        event.c.by_batch,
        event_amendment.c.verdict,
        event_amendment.c.by_event_id,
        select(
            func.jsonb_agg(
                aggregate_order_by(
                    func.jsonb_build_array(
                        event_evidence.c.uid,
                        event_evidence.c.variable,
                        event_evidence.c.source,
                        event_evidence.c.stamp,
                    ),
                    event_evidence.c.place,
                )
            )
        )
        .where(event_evidence.c.event_id == event.c.event_id)
        .scalar_subquery(),
    )
    .join(map_, map_.c.map_id == event.c.map_id)
    .join(event_amendment, event_amendment.c.event_id == event.c.event_id, isouter=True)
)
