"""Events of a map by their time, newest first, and by what they are about: to find what has happened."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import ColumnElement, Connection, Select, cast, func, or_, select, tuple_
from sqlalchemy.dialects.postgresql import JSONB, JSONPATH

from semap.store.database.connection import translated
from semap.store.database.tables import event, event_number, instance
from semap.store.event.events import EVENTS, LOOKED_AT, OWN_EVENTS, StoredEvent, event_of
from semap.store.map.maps import map_id_of


@dataclass(frozen=True)
class Place:
    """Where an event stands among those of its map: by its stamp, then by its number among them."""

    stamp: datetime
    number: int


@dataclass(frozen=True)
class Wanted:
    """Which events are wanted; None: whichever.

    start, end       of the stamps, both included
    event_type       as the rule calls it
    track, instance  the name of what it is about, or of what its key or measures name
    text             each of its words is part of the type, the rule, a name, or a value of key or measures
    """

    start: datetime | None = None
    end: datetime | None = None
    event_type: str | None = None
    track: str | None = None
    instance: str | None = None
    text: str | None = None


@dataclass(frozen=True)
class Found:
    """Events, newest first.

    last  all that are not before it were looked at; None: all
    """

    events: tuple[StoredEvent, ...]
    last: Place | None


def search_events(
    connection: Connection,
    map_name: str,
    wanted: Wanted,
    *,
    before: Place | None = None,
    limit: int = 100,
    own: bool = False,
) -> Found:
    """At most `limit` events, looked for among so few that it takes a bounded time.

    own     with their numbers among those of the map
    raises  NotFound if there is no such map
    """
    map_id = map_id_of(connection, map_name)
    near = (
        select(event.c.event_id, event.c.stamp, event_number.c.number)
        .join(event_number, event_number.c.event_id == event.c.event_id)
        .where(event.c.map_id == map_id, *_within(wanted, before))
        .order_by(event.c.stamp.desc(), event_number.c.number.desc())
        .limit(LOOKED_AT)
    )
    looked = near.subquery()
    found = (
        (OWN_EVENTS if own else EVENTS)
        .where(event.c.event_id.in_(select(looked.c.event_id)), *_about(wanted, map_id))
        .order_by(event.c.stamp.desc(), event_number.c.number.desc())
        .limit(limit)
    )
    with translated():
        events = tuple(event_of(row) for row in connection.execute(found).all())
        if len(events) == limit:
            return Found(events, Place(events[-1].stamp, events[-1].own_seq))
        return Found(events, _last_of(connection, near))


def _last_of(connection: Connection, near: Select[tuple[object, datetime, int]]) -> Place | None:
    """The oldest that was looked at, where there may be older ones."""
    last = connection.execute(near.limit(None).offset(LOOKED_AT - 1).limit(1)).one_or_none()
    return None if last is None else Place(last.stamp, last.number)


def _within(wanted: Wanted, before: Place | None) -> list[ColumnElement[bool]]:
    bounds: list[ColumnElement[bool]] = []
    if wanted.start is not None:
        bounds.append(event.c.stamp >= wanted.start)
    if wanted.end is not None:
        bounds.append(event.c.stamp <= wanted.end)
    if before is not None:
        bounds.append(event.c.stamp <= before.stamp)
        bounds.append(tuple_(event.c.stamp, event_number.c.number) < tuple_(before.stamp, before.number))
    return bounds


def _about(wanted: Wanted, map_id: int) -> list[ColumnElement[bool]]:
    about: list[ColumnElement[bool]] = []
    if wanted.event_type is not None:
        about.append(event.c.type == wanted.event_type)
    if wanted.track is not None:
        about.append(or_(event.c.track_name == wanted.track, _is_named(wanted.track)))
    if wanted.instance is not None:
        named = select(instance.c.instance_id).where(
            instance.c.map_id == map_id, instance.c.name == wanted.instance
        )
        about.append(
            or_(
                event.c.instance_name == wanted.instance,
                event.c.instance_id.in_(named),
                _is_named(wanted.instance),
            )
        )
    for word in (wanted.text or "").lower().split():
        about.append(func.strpos(_TEXT, word) > 0)
    return about


def _is_named(name: str) -> ColumnElement[bool]:
    """Whether the key or the measures have it as a value."""
    return or_(*(_values(each).contains([name]) for each in (event.c.key, event.c.measures)))


def _values(column: ColumnElement[object]) -> ColumnElement[object]:
    return func.jsonb_path_query_array(column, cast("$.*", JSONPATH), type_=JSONB)


_ALIAS = select(instance.c.alias).where(instance.c.instance_id == event.c.instance_id).scalar_subquery()
_TEXT = func.lower(
    func.concat_ws(
        " ",
        event.c.type,
        func.replace(event.c.type, "_", " "),
        event.c.rule_name,
        event.c.track_name,
        event.c.instance_name,
        _ALIAS,
        _values(event.c.key),
        _values(event.c.measures),
    )
)
