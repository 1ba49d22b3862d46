"""Events in the order in which they were committed.

The number of an event (`seq`) is its place: events become visible in the order of their numbers, so
that whoever has seen number n has seen everything up to it. There are two such orders: that of all maps,
and that of each map by itself, for readers who must not learn from gaps how much happens elsewhere. What
asks for events of `own` numbers asks for those of one map by the second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import Connection, bindparam, func, literal_column, null, select
from sqlalchemy.dialects.postgresql import aggregate_order_by

from semap.model.event import Evidence, TrackAndInstance
from semap.store.database.connection import translated
from semap.store.database.event_number import newest_event
from semap.store.database.tables import (
    abstraction,
    event,
    event_amendment,
    event_evidence,
    event_number,
    event_place,
    one_of,
    place,
)
from semap.store.map.maps import map_id_of

LOOKED_AT = 10_000
"""Events among which one read looks for those that are wanted."""


@dataclass(frozen=True)
class StoredEvent(TrackAndInstance):
    """An event with its number, its map by name, and what the batch layer said of it when it was read.

    verdict     confirmed, retracted or amended; None where the batch layer has not looked
    amended_by  the event that stands in its place
    by_batch    whether the batch layer made it
    created_at  when it was written, by the database's clock
    place       where its track was then, else where its instance is: WKB, in the map frame
    own_seq     its number among the events of its map
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
    created_at: datetime
    place: bytes | None
    evidence: tuple[Evidence, ...]
    own_seq: int = 0

    def of_its_map(self) -> StoredEvent:
        """The same as those see it who may see its map only."""
        return replace(self, seq=self.own_seq)


@dataclass(frozen=True)
class Stretch:
    """What was found in the numbers up to `last`, and whether there are events beyond."""

    events: tuple[StoredEvent, ...]
    last: int
    is_full: bool


@dataclass(frozen=True)
class Kept:
    """Which events there are: the oldest that is still kept, None where none is, and the newest ever made."""

    oldest: int | None
    newest: int


def read_stretch(
    connection: Connection,
    *,
    after: int,
    limit: int,
    map_name: str | None = None,
    event_type: str | None = None,
    rule_name: str | None = None,
    own: bool = False,
) -> Stretch:
    """Events after a number in their order, looked for among so few that it takes a bounded time.

    limit  at most so many, however many fit
    own    by the numbers of the map, which is named then
    """
    number = event_number.c.number if own else event.c.seq
    nearest = select(number.label("seq")).where(number > after).order_by(number).limit(LOOKED_AT)
    if own:
        nearest = nearest.join(place, place.c.map_id == event_number.c.map_id).where(place.c.name == map_name)
    near = nearest.subquery()
    with translated():
        last, count = connection.execute(select(func.max(near.c.seq), func.count(near.c.seq))).one()
    if last is None:
        return Stretch((), after, is_full=False)
    events = list_events(
        connection,
        after=after,
        until=last,
        limit=limit,
        map_name=map_name,
        event_type=event_type,
        rule_name=rule_name,
        own=own,
    )
    if len(events) == limit:
        return Stretch(events, events[-1].seq, is_full=True)
    return Stretch(events, last, is_full=count == LOOKED_AT)


def list_events(
    connection: Connection,
    *,
    after: int = 0,
    until: int | None = None,
    limit: int = 100,
    map_name: str | None = None,
    event_type: str | None = None,
    rule_name: str | None = None,
    own: bool = False,
) -> tuple[StoredEvent, ...]:
    """At most `limit` events with numbers above `after`, and not above `until`, in their order."""
    found = _NEXT_OWN_EVENTS if own else NEXT_EVENTS
    if until is not None:
        found = found.where((event_number.c.number if own else event.c.seq) <= until)
    if map_name is not None:
        found = found.where(place.c.name == map_name)
    if event_type is not None:
        found = found.where(event.c.type == event_type)
    if rule_name is not None:
        found = found.where(event.c.rule_name == rule_name)
    with translated():
        rows = connection.execute(found, {"after": after, "most": limit}).all()
    return tuple(event_of(row) for row in rows)


def list_events_between(
    connection: Connection,
    map_name: str,
    start: datetime,
    end: datetime,
    *,
    limit: int = 100,
    own: bool = False,
) -> tuple[StoredEvent, ...]:
    """At most `limit` events of a map from `start` to `end`, both included, in the order of their stamps.

    raises  NotFound if there is no such map
    """
    map_id = map_id_of(connection, map_name)
    within = (event.c.map_id == map_id, event.c.stamp >= start, event.c.stamp <= end)
    with translated():
        found = (OWN_EVENTS if own else EVENTS).where(*within)
        rows = connection.execute(found.order_by(event.c.stamp, event_number.c.number).limit(limit)).all()
    return tuple(event_of(row) for row in rows)


def numbers_of(connection: Connection, event_ids: Set[UUID]) -> dict[UUID, int]:
    """The number of each event, by its id."""
    if not event_ids:
        return {}
    with translated():
        found = connection.execute(
            select(event.c.event_id, event.c.seq).where(one_of(event.c.event_id, event_ids))
        )
        return {row.event_id: row.seq for row in found}


def kept_events(connection: Connection, of_map: str | None = None) -> Kept:
    """Which events there are now.

    of_map  on this map, by its own numbers
    """
    # The newest first: what is committed between the two must not look as if it had been and gone.
    newest = newest_event(connection, of_map)
    oldest = select(func.min(event.c.seq))
    if of_map is not None:
        of_this = event_number.join(place, place.c.map_id == event_number.c.map_id)
        oldest = select(func.min(event_number.c.number)).select_from(of_this).where(place.c.name == of_map)
    with translated():
        return Kept(connection.scalar(oldest), newest)


def event_of(row: Sequence[Any]) -> StoredEvent:
    """A row of EVENTS."""
    *made, evidence, own_seq = row
    return StoredEvent(*[*made, tuple(_evidence(*each) for each in evidence or ()), own_seq])


def _evidence(uid: str, variable: str, source: Any, stamp: str) -> Evidence:
    return Evidence(UUID(uid), variable, source, datetime.fromisoformat(stamp))


_POSITION = (
    select(abstraction.c.geometry)
    .where(
        abstraction.c.instance_id == event.c.instance_id, abstraction.c.type == literal_column("'Position2D'")
    )
    .scalar_subquery()
)
_GATHERED = select(event_place.c.place).where(event_place.c.event_id == event.c.event_id).scalar_subquery()
_PLACE = func.public.st_asbinary(
    func.coalesce(func.semap.place_at(event.c.track_id, event.c.stamp), _POSITION, _GATHERED)
).label("place")
EVENTS = (
    select(
        event.c.seq,
        event.c.event_id,
        place.c.name,
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
        event.c.created_at,
        _PLACE,
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
        event_number.c.number,
    )
    .join(event_number, event_number.c.event_id == event.c.event_id)
    .join(place, place.c.map_id == event.c.map_id)
    .join(event_amendment, event_amendment.c.event_id == event.c.event_id, isouter=True)
)

NEXT_EVENTS = EVENTS.where(event.c.seq > bindparam("after")).order_by(event.c.seq).limit(bindparam("most"))

# Without the place among the events of all maps, which readers of one map may not even ask for.
OWN_EVENTS = EVENTS.with_only_columns(
    *(event_number.c.number if column is event.c.seq else column for column in EVENTS.selected_columns)
)
_NEXT_OWN_EVENTS = (
    OWN_EVENTS.where(event_number.c.number > bindparam("after"))
    .order_by(event_number.c.number)
    .limit(bindparam("most"))
)

UNPLACED_EVENTS = NEXT_EVENTS.with_only_columns(
    *(null() if column is _PLACE else column for column in EVENTS.selected_columns)
)
