"""Who is where: relations that hold, or held at a moment, and rooms with who is in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from datetime import datetime
from typing import Any, TypeAlias

from sqlalchemy import (
    ColumnElement,
    Connection,
    FromClause,
    Select,
    distinct,
    func,
    null,
    or_,
    select,
    tuple_,
)

from semap.errors import NotFound
from semap.model.relation import Occupant
from semap.store.database.connection import translated
from semap.store.database.tables import (
    concept,
    continuous_query,
    instance,
    map_,
    relation,
    relation_past,
    track,
)
from semap.store.map.instances import Instance

STOREY = instance.alias("storey")
ROOM = "Room"
Place: TypeAlias = tuple[int, int, int, int]
"""Which part of all relations (those that hold, those that are over), and the ids that it is ordered by."""
START: Place = (0, 0, 0, 0)


@dataclass(frozen=True)
class Wanted:
    """Which relations: those of which all of this is true; a name may be that of either side."""

    map: str | None = None
    query: str | None = None
    track: str | None = None
    instance: str | None = None


ALL = Wanted()


@dataclass(frozen=True)
class Relation:
    """A subject is related to an object, as a continuous query sees it: a track or an instance each.

    until  None while it holds
    place  where it stands in the list
    """

    map: str
    query: str
    track_id: int | None
    track: str | None
    subject_instance_id: int | None
    subject_instance: str | None
    instance_id: int | None
    instance: str | None
    object_track_id: int | None
    object_track: str | None
    since: datetime
    until: datetime | None
    place: Place


@dataclass(frozen=True)
class Room:
    """A room, and how many tracks are in it now."""

    instance: Instance
    occupants: int


def list_relations(
    connection: Connection,
    wanted: Wanted = ALL,
    *,
    as_of: datetime | None = None,
    after: Place = START,
    limit: int = 100,
) -> tuple[Relation, ...]:
    """At most `limit` relations that hold now, or held at a moment of event time.

    First come those that hold, query by query, then those that are over: what ends between two pages may come
    twice, but is not missed.

    after  the place of the last one known
    """
    parts = (_NOW,) if as_of is None else (_NOW, _OVER)
    found: list[Relation] = []
    for number, part in enumerate(parts):
        if number < after[0] or len(found) == limit:
            continue
        ids = after[1:] if number == after[0] else START[1:]
        asked = part.select(wanted, as_of).limit(limit - len(found))
        found += _read(connection, number, part, asked, ids)
    return tuple(found)


def list_relations_to_instances(
    connection: Connection, track_id: int, *, after: Place = START, limit: int = 100
) -> tuple[Relation, ...]:
    """What a track is in now, in the order of `list_relations`: who faces a table is not in it."""
    asked = _NOW.select(ALL, None).where(relation.c.track_id == track_id, ~relation.c.in_pairs).limit(limit)
    return tuple(_read(connection, 0, _NOW, asked, after[1:]))


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
        .where(relation.c.instance_id == instance_id, relation.c.track_id > after, *_IS_IN)
        .group_by(relation.c.track_id, track.c.name)
        .order_by(relation.c.track_id)
        .limit(limit)
    )
    with translated():
        return tuple(Occupant(*row) for row in connection.execute(found))


def _read(
    connection: Connection, number: int, part: _Part, asked: Select[Any], after: tuple[int, ...]
) -> list[Relation]:
    """What follows the ids in the order of a part."""
    asked = asked.where(tuple_(*part.ids) > tuple_(*after[: len(part.ids)])).order_by(*part.ids)
    with translated():
        rows = connection.execute(asked).all()
    ids_at = len(fields(Relation)) - 1
    places = ((number, *(*row[ids_at:], 0, 0)[:3]) for row in rows)
    return [Relation(*(*row[:ids_at], place)) for row, place in zip(rows, places, strict=True)]


@dataclass(frozen=True)
class _Part:
    """Relations that are kept in one table.

    sides  the columns of a side's id and name, by the side
    ids    the one to three columns by which the table is ordered
    until  None: all of it holds
    """

    joined: FromClause
    query: ColumnElement[str]
    sides: Mapping[str, tuple[ColumnElement[Any], ColumnElement[Any]]]
    since: ColumnElement[datetime]
    ids: tuple[ColumnElement[int], ...]
    until: ColumnElement[datetime] | None = None
    only: ColumnElement[bool] | None = None

    def select(self, wanted: Wanted, as_of: datetime | None) -> Select[Any]:
        """The columns of `Relation` up to `until`, and the ids."""
        columns = [column for side in _SIDES for column in self.sides.get(side, (null(), null()))]
        until = null() if self.until is None else self.until
        found = select(map_.c.name, self.query, *columns, self.since, until, *self.ids)
        return found.select_from(self.joined).where(*self._conditions(wanted, as_of))

    def _conditions(self, wanted: Wanted, as_of: datetime | None) -> list[ColumnElement[bool]]:
        named = {side: columns[1] for side, columns in self.sides.items()}
        conditions = [] if self.only is None else [self.only]
        for value, columns in (
            (wanted.map, [map_.c.name]),
            (wanted.query, [self.query]),
            (wanted.track, [named[side] for side in _TRACKS if side in named]),
            (wanted.instance, [named[side] for side in _INSTANCES if side in named]),
        ):
            if value is not None:
                conditions.append(or_(*(column == value for column in columns)))
        if as_of is not None:
            conditions += self._held_at(as_of)
        return conditions

    def _held_at(self, as_of: datetime) -> list[ColumnElement[bool]]:
        if self.until is None:
            return [self.since <= as_of]
        # written as the index has it
        span: ColumnElement[Any] = func.tstzrange(self.since, self.until, "[]")
        return [span.bool_op("@>")(as_of), self.until > as_of]


_SIDES = ("track", "subject_instance", "instance", "object_track")
_TRACKS = ("track", "object_track")
_INSTANCES = ("subject_instance", "instance")
_SUBJECT, _OBJECT = instance.alias("subject_instance"), track.alias("object_track")
_NOW = _Part(
    relation.join(continuous_query, continuous_query.c.query_id == relation.c.query_id)
    .join(map_, map_.c.map_id == relation.c.map_id)
    .outerjoin(track, track.c.track_id == relation.c.track_id)
    .outerjoin(_SUBJECT, _SUBJECT.c.instance_id == relation.c.subject_instance_id)
    .outerjoin(instance, instance.c.instance_id == relation.c.instance_id)
    .outerjoin(_OBJECT, _OBJECT.c.track_id == relation.c.object_track_id),
    continuous_query.c.name,
    {
        "track": (relation.c.track_id, track.c.name),
        "subject_instance": (relation.c.subject_instance_id, _SUBJECT.c.name),
        "instance": (relation.c.instance_id, instance.c.name),
        "object_track": (relation.c.object_track_id, _OBJECT.c.name),
    },
    relation.c.since,
    (relation.c.query_id, relation.c.subject_key, relation.c.object_key),
    only=relation.c.confirmed,
)
_OVER = _Part(
    relation_past.join(map_, map_.c.map_id == relation_past.c.map_id),
    relation_past.c.query_name,
    {side: (relation_past.c[f"{side}_id"], relation_past.c[f"{side}_name"]) for side in _SIDES},
    relation_past.c.since,
    (relation_past.c.relation_past_id,),
    until=relation_past.c.until,
)

_IS_IN = (relation.c.confirmed, ~relation.c.in_pairs)
"""That a track is in an instance: who faces a table is not in it."""
_ROOM_CONCEPTS = func.semap.concepts_below(
    select(concept.c.concept_id).where(concept.c.name == ROOM).scalar_subquery()
).column_valued("concept_id")
_OCCUPANTS = (
    select(func.count(distinct(relation.c.track_id)))
    .where(relation.c.instance_id == instance.c.instance_id, *_IS_IN)
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
