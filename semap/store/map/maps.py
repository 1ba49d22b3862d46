"""Maps: made, listed, deleted.

A new map has its root frame `map`, a continuous query for people and things in rooms, and a rule that
makes events of it, so that an imported building is alive at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from uuid import UUID, uuid5

from sqlalchemy import Connection, delete, func, insert, select
from sqlalchemy.dialects.postgresql import insert as upsert

from semap.errors import Conflict, InvalidInput, NotFound
from semap.store.database.connection import translated
from semap.store.database.name import require_name
from semap.store.database.tables import continuous_query, instance, map_, rule, track
from semap.store.map.concept import concept_id
from semap.store.map.placement import ROOT_FRAME, Placed, insert_frames

MAP_NAMESPACE = UUID("0b5a3c1e-5f0f-5d0c-8a86-5e6b1a2f9c40")
QUERY = "track_in_room"
RULE = "room_visits"
DECLARATION = {"input": QUERY, "emit": {"began": "entered", "ended": "left"}}


SMALLEST_CELL_M, LARGEST_CELL_M = 0.1, 1e6


@dataclass(frozen=True)
class Map:
    """A map, the side of its cells [m], and how much is on it."""

    map_id: int
    uid: UUID
    name: str
    cell_m: float
    created_at: datetime
    instances: int
    tracks: int


def create_map(connection: Connection, name: str, cell_m: float = 4.0, *, with_visits: bool = True) -> Map:
    """A new map; the same name always gives the same uid.

    cell_m       side of the cells of the region index; about the size of a room
    with_visits  with the query and the rule for who enters and leaves which room
    raises  Conflict if the name is taken, InvalidInput for a name or a cell that will not do
    """
    require_name(name)
    if not SMALLEST_CELL_M <= cell_m <= LARGEST_CELL_M:
        raise InvalidInput(
            f"cells of {cell_m} m", f"Choose from {SMALLEST_CELL_M} m to {LARGEST_CELL_M:g} m.", "cell_m"
        )
    with translated():
        map_id = connection.scalar(
            upsert(map_)
            .values(name=name, uid=uuid5(MAP_NAMESPACE, name), cell_m=cell_m)
            .on_conflict_do_nothing(index_elements=["name"])
            .returning(map_.c.map_id)
        )
    if map_id is None:
        raise Conflict(f"There is a map {name} already.", "Choose another name, or delete that map first.")
    insert_frames(connection, map_id, [Placed(ROOT_FRAME, None)])
    if with_visits:
        _add_visits(connection, map_id)
    return get_map(connection, name)


def _add_visits(connection: Connection, map_id: int) -> None:
    room = concept_id(connection, "Room")
    with translated():
        query_id = connection.scalar(
            insert(continuous_query)
            .values(map_id=map_id, name=QUERY, predicate="contains", object_concept_id=room)
            .returning(continuous_query.c.query_id)
        )
        connection.execute(
            insert(rule).values(map_id=map_id, name=RULE, queries={QUERY: query_id}, declaration=DECLARATION)
        )


def list_maps(connection: Connection, *, after: str = "", limit: int = 1000) -> tuple[Map, ...]:
    """At most `limit` maps by name (by its characters' numbers), from the first name after `after`."""
    with translated():
        rows = connection.execute(_MAPS.where(after < _NAME).order_by(_NAME).limit(limit))
        return tuple(Map(*row) for row in rows)


def get_map(connection: Connection, name: str) -> Map:
    """raises NotFound"""
    with translated():
        row = connection.execute(_MAPS.where(map_.c.name == name)).one_or_none()
    if row is None:
        raise NotFound("map", name, "List the maps to see their names.")
    return Map(*row)


def map_id_of(connection: Connection, name: str) -> int:
    """raises NotFound"""
    with translated():
        found = connection.scalar(select(map_.c.map_id).where(map_.c.name == name))
    if found is None:
        raise NotFound("map", name, "List the maps to see their names.")
    return int(found)


def delete_map(connection: Connection, name: str) -> None:
    """Delete a map with all that is on it and all that happened on it.

    raises  NotFound
    """
    with translated():
        gone = connection.scalar(delete(map_).where(map_.c.name == name).returning(map_.c.map_id))
    if gone is None:
        raise NotFound("map", name, "List the maps to see their names.")


_NAME = map_.c.name.collate("C")  # so that lists of several databases are in one order
_MAPS = select(
    map_.c.map_id,
    map_.c.uid,
    map_.c.name,
    map_.c.cell_m,
    map_.c.created_at,
    select(func.count()).where(instance.c.map_id == map_.c.map_id).scalar_subquery(),
    select(func.count()).where(track.c.map_id == map_.c.map_id).scalar_subquery(),
)
