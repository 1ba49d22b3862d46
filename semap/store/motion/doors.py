"""Doors that have a leaf, and how they stand."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, column, select, table

from semap.store.database.connection import translated


@dataclass(frozen=True)
class Door:
    """A door as it was last seen.

    state      opening, open, closing or closed; None until it is seen, and after it was moved
    since      when that state began
    stamp      when its leaf was last seen
    angle_deg  of the leaf to where it is closed, with its standard deviation
    max_deg    how far it opens
    rooms      names of the rooms that it joins
    """

    map: str
    instance_id: int
    door: str
    state: str | None
    since: datetime | None
    stamp: datetime | None
    angle_deg: float | None
    angle_std_deg: float | None
    width_m: float
    max_deg: float
    rooms: tuple[str, ...]


def list_doors(
    connection: Connection,
    *,
    map_name: str | None = None,
    name: str | None = None,
    state: str | None = None,
    after: int = 0,
    limit: int = 100,
) -> tuple[Door, ...]:
    """At most `limit` doors with a leaf in the order of their ids, from the first after `after`."""
    found = select(*_DOORS.c).where(_DOORS.c.instance_id > after)
    for wanted, value in ((_DOORS.c.map, map_name), (_DOORS.c.door, name), (_DOORS.c.state, state)):
        if value is not None:
            found = found.where(wanted == value)
    with translated():
        rows = connection.execute(found.order_by(_DOORS.c.instance_id).limit(limit))
        return tuple(Door(*[*known, tuple(rooms)]) for *known, rooms in rows)


_DOORS = table("door_present", *(column(name) for name in Door.__dataclass_fields__), schema="semap")
