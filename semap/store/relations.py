"""Who is where now: relations that hold, and rooms with who is in them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import ColumnElement, Connection, distinct, func, select, tuple_

from semap.errors import NotFound
from semap.store.database import translated
from semap.store.instances import Instance
from semap.store.tables import concept, instance, map_, region, relation, track

STOREY = instance.alias("storey")
ROOM = "Room"


@dataclass(frozen=True)
class Relation:
    """A track is in an instance since a stamp, as a continuous query sees it."""

    map: str
    query: str
    track_id: int
    track: str
    instance_id: int
    instance: str
    since: datetime
    region_id: int


@dataclass(frozen=True)
class Room:
    """A room, and how many tracks are in it now."""

    instance: Instance
    occupants: int


@dataclass(frozen=True)
class Occupant:
    """A track that is in a room, and since when."""

    track_id: int
    name: str
    since: datetime


def list_relations(
    connection: Connection,
    *,
    map_name: str | None = None,
    track_name: str | None = None,
    track_id: int | None = None,
    instance_name: str | None = None,
    query: str | None = None,
    after: tuple[int, int] = (0, 0),
    limit: int = 100,
) -> tuple[Relation, ...]:
    """At most `limit` relations that hold now, ordered by track and region.

    after  (track_id, region_id) of the last one known
    """
    wanted: list[ColumnElement[bool]] = [tuple_(relation.c.track_id, relation.c.region_id) > tuple_(*after)]
    for column, value in (
        (map_.c.name, map_name),
        (track.c.name, track_name),
        (relation.c.track_id, track_id),
        (region.c.instance_name, instance_name),
        (region.c.query_name, query),
    ):
        if value is not None:
            wanted.append(column == value)
    found = (
        select(
            map_.c.name,
            region.c.query_name,
            relation.c.track_id,
            track.c.name,
            relation.c.instance_id,
            region.c.instance_name,
            relation.c.since,
            relation.c.region_id,
        )
        .select_from(relation)
        .join(region, region.c.region_id == relation.c.region_id)
        .join(track, track.c.track_id == relation.c.track_id)
        .join(map_, map_.c.map_id == relation.c.map_id)
        .where(*wanted)
        .order_by(relation.c.track_id, relation.c.region_id)
        .limit(limit)
    )
    with translated():
        return tuple(Relation(*row) for row in connection.execute(found))


def list_rooms(
    connection: Connection, *, map_name: str | None = None, after: int = 0, limit: int = 100
) -> tuple[Room, ...]:
    """At most `limit` rooms in the order of their ids, from the first after `after`."""
    found = _ROOMS.where(instance.c.instance_id > after).order_by(instance.c.instance_id).limit(limit)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    with translated():
        return tuple(Room(Instance(*row[:7]), row[7]) for row in connection.execute(found))


def get_room(connection: Connection, instance_id: int) -> Room:
    """raises NotFound, also for an instance that is not a room"""
    with translated():
        row = connection.execute(_ROOMS.where(instance.c.instance_id == instance_id)).one_or_none()
    if row is None:
        raise NotFound("room", instance_id, "List the rooms to see their ids.")
    return Room(Instance(*row[:7]), row[7])


def list_occupants(
    connection: Connection, instance_id: int, *, after: int = 0, limit: int = 100
) -> tuple[Occupant, ...]:
    """At most `limit` tracks that are in a room now, in the order of their ids.

    raises  NotFound
    """
    get_room(connection, instance_id)
    found = (
        select(relation.c.track_id, track.c.name, func.min(relation.c.since))
        .join(track, track.c.track_id == relation.c.track_id)
        .where(relation.c.instance_id == instance_id, relation.c.track_id > after)
        .group_by(relation.c.track_id, track.c.name)
        .order_by(relation.c.track_id)
        .limit(limit)
    )
    with translated():
        return tuple(Occupant(*row) for row in connection.execute(found))


_ROOM_CONCEPTS = func.semap.concepts_below(
    select(concept.c.concept_id).where(concept.c.name == ROOM).scalar_subquery()
).column_valued("concept_id")
_OCCUPANTS = (
    select(func.count(distinct(relation.c.track_id)))
    .where(relation.c.instance_id == instance.c.instance_id)
    .scalar_subquery()
)
_ROOMS = (
    select(
        instance.c.instance_id,
        instance.c.uid,
        map_.c.name,
        instance.c.name,
        instance.c.alias,
        concept.c.name,
        STOREY.c.name,
        _OCCUPANTS,
    )
    .select_from(instance)
    .join(map_, map_.c.map_id == instance.c.map_id)
    .join(concept, concept.c.concept_id == instance.c.concept_id)
    .outerjoin(STOREY, STOREY.c.instance_id == instance.c.storey_id)
    .where(instance.c.concept_id.in_(select(_ROOM_CONCEPTS)))
)
