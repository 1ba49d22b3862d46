"""Which shard a map is on, as the directory of shards knows; a database without shards is all there is."""

from __future__ import annotations

from dataclasses import dataclass, field

from sqlalchemy import Connection, func, select

from semap.errors import NotFound
from semap.store.database.connection import translated
from semap.store.database.tables import map_, place, shard

MAIN = 0
"""The number of the shard that is the directory itself."""


@dataclass(frozen=True)
class Shard:
    """A database of maps.

    dsn       where it is; None: the database that was asked
    draining  no new map is placed there
    maps      how many are placed there
    """

    shard_id: int
    name: str
    dsn: str | None = field(repr=False)
    draining: bool
    maps: int


@dataclass(frozen=True)
class Place:
    """Where a map is, or will be made."""

    map_id: int
    name: str
    shard_id: int


_SHARDS = select(
    shard.c.shard_id,
    shard.c.name,
    shard.c.dsn,
    shard.c.draining,
    select(func.count()).where(place.c.shard_id == shard.c.shard_id).correlate(shard).scalar_subquery(),
)


def list_shards(connection: Connection) -> tuple[Shard, ...]:
    """All shards by their numbers, the directory first."""
    with translated():
        return tuple(Shard(*row) for row in connection.execute(_SHARDS.order_by(shard.c.shard_id)))


def get_shard(connection: Connection, name: str) -> Shard:
    """raises NotFound"""
    with translated():
        row = connection.execute(_SHARDS.where(shard.c.name == name)).one_or_none()
    if row is None:
        raise NotFound("shard", name, "`semap shard list` shows them.")
    return Shard(*row)


def has_shards(connection: Connection) -> bool:
    """Whether there are others beside this database."""
    with translated():
        return len(connection.scalars(select(shard.c.shard_id)).all()) > 1


def is_made_here(connection: Connection, map_name: str) -> bool:
    """Whether a map is in this database, or would be made here; who asks need not know the way to shards."""
    with translated():
        rows = connection.execute(select(shard.c.shard_id, shard.c.draining)).all()
        draining = {row.shard_id: row.draining for row in rows}
        if connection.scalar(select(map_.c.map_id).where(map_.c.name == map_name)) is not None:
            return True
    found = find_place(connection, map_name)
    if found is not None:
        return len(draining) == 1 or found.shard_id == MAIN
    return not draining.get(MAIN, False)


def shard_of(connection: Connection, map_name: str) -> Shard | None:
    """The shard of a map that is not here, or has not been made; None where it is here, or has no place.

    Only who asks for a map of another shard needs to know the way there (semap_admin).
    """
    with translated():
        if connection.scalar(select(map_.c.map_id).where(map_.c.name == map_name)) is not None:
            return None
        if find_place(connection, map_name) is None:
            return None
        row = connection.execute(
            _SHARDS.join(place, place.c.shard_id == shard.c.shard_id).where(place.c.name == map_name)
        ).one_or_none()
    return None if row is None else Shard(*row)


def find_place(connection: Connection, map_name: str) -> Place | None:
    with translated():
        row = connection.execute(
            select(place.c.map_id, place.c.name, place.c.shard_id).where(place.c.name == map_name)
        ).one_or_none()
    return None if row is None else Place(*row)


def place_of(connection: Connection, map_name: str) -> Place:
    """raises NotFound"""
    found = find_place(connection, map_name)
    if found is None:
        raise NotFound("map", map_name, "List the maps to see their names.")
    return found
