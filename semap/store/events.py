"""Events in the order in which they were committed.

The number of an event (`seq`) is its place: events become visible in the order of their numbers, so
that whoever has seen number n has seen everything up to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import Connection, func, select

from semap.store.database import translated
from semap.store.tables import event, event_evidence, map_, progress


@dataclass(frozen=True)
class StoredEvent:
    """An event with its number, and its map by name."""

    seq: int
    event_id: UUID
    map: str
    type: str
    stamp: datetime
    cause: str
    rule: str
    rule_version: int
    track_id: int
    track_name: str
    instance_id: int
    instance_name: str
    since: datetime
    evidence: tuple[UUID, ...]


def list_events(
    connection: Connection,
    *,
    after: int = 0,
    limit: int = 100,
    map_name: str | None = None,
    event_type: str | None = None,
) -> tuple[StoredEvent, ...]:
    """At most `limit` events with numbers above `after`, in their order."""
    found = _EVENTS.where(event.c.seq > after).order_by(event.c.seq).limit(limit)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    if event_type is not None:
        found = found.where(event.c.type == event_type)
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
    return StoredEvent(*[*made, tuple(evidence or ())])


_EVENTS = select(
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
    select(func.array_agg(event_evidence.c.change_uid))
    .where(event_evidence.c.event_id == event.c.event_id)
    .scalar_subquery(),
).join(map_, map_.c.map_id == event.c.map_id)
