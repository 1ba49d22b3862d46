"""The history of the map: who changed what, how it was, and undo.

Every transaction that changes the map leaves one change set (sql/060_history.sql).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal
from uuid import UUID

import shapely
from sqlalchemy import Connection, func, select, text

from semap.errors import InvalidInput, NotFound
from semap.model.building import HeightBand
from semap.model.pose import Pose
from semap.store.database.connection import translated
from semap.store.map.maps import map_id_of

SIGN = text("select set_config('semap.author', :author, true), set_config('semap.message', :message, true)")
CHANGE_SETS = """
    select c.change_set_id, c.made_at, c.author, c.message, c.undoes_id,
           (select count(*) from semap.row_version v
            where v.change_set_id = c.change_set_id and v.table_name <> 'abstraction')
    from semap.change_set c
"""
LIST_CHANGE_SETS = text(f"""
    {CHANGE_SETS}
    where c.change_set_id < coalesce(:before, 9223372036854775807)
      and exists (select from semap.row_version v
                  where v.change_set_id = c.change_set_id and (v.map_id = :map_id or :map_id is null))
    order by c.change_set_id desc limit :limit
""")
GET_CHANGE_SET = text(f"{CHANGE_SETS} where c.change_set_id = :change_set_id")
ROW_CHANGES = text("""
    select v.table_name, coalesce(v.content ->> 'name', b.content ->> 'name', v.row_key),
           case when v.content is null then 'deleted' when b.content is null then 'made' else 'changed' end
    from semap.row_version v
    left join lateral (
      select content from semap.row_version b
      where b.table_name = v.table_name and b.row_key = v.row_key and b.version_id < v.version_id
      order by b.version_id desc limit 1) b on true
    where v.change_set_id = :change_set_id and v.table_name <> 'abstraction'
    order by v.version_id limit :limit
""")
INSTANCES_AS_OF = text("""
    select instance_id, uid, name, alias, concept, storey, attributes,
           (pose).x_m, (pose).y_m, (pose).z_m, (pose).qx, (pose).qy, (pose).qz, (pose).qw,
           public.st_asbinary(footprint), z_min_m, z_max_m
    from semap.instances_as_of(:map_id, :at, :instance_id, :after, :limit)
    order by instance_id
""")
MAP_OF_INSTANCE = text("""
    select name from semap.map where map_id = semap.map_of_row('instance', :instance_id)
""")
MADE_HERE = text("select cast(current_setting('semap.change_set') as bigint)")
UNDO = text("select semap.undo_change_set(:change_set_id)")


@dataclass(frozen=True)
class ChangeSet:
    """What one transaction changed, in how many rows; `undoes` is the change set that it takes back."""

    change_set_id: int
    made_at: datetime
    author: str
    message: str | None
    undoes: int | None
    rows: int


@dataclass(frozen=True)
class RowChange:
    """A row of a table that was made, changed or deleted; `name` is its key where it has none."""

    table: str
    name: str
    action: Literal["made", "changed", "deleted"]


@dataclass(frozen=True, eq=False)
class PastInstance:
    """An instance as it was; `pose` is map_T_instance, None where its frame was nowhere."""

    instance_id: int
    uid: UUID
    name: str
    alias: str | None
    concept: str
    storey: str | None
    attributes: dict[str, object]
    pose: Pose | None
    footprint: shapely.Geometry | None
    band: HeightBand | None


def sign(connection: Connection, author: str, message: str = "") -> None:
    """Say who changes the map in this transaction, and why."""
    with translated():
        connection.execute(SIGN, {"author": author, "message": message})


def lock_edits(connection: Connection) -> None:
    """Let nobody else edit any map from now on until this transaction ends (sql/020)."""
    with translated():
        connection.execute(select(func.semap.lock_regions_exclusive()))


def list_change_sets(
    connection: Connection, map_name: str | None = None, *, before: int | None = None, limit: int = 100
) -> tuple[ChangeSet, ...]:
    """At most `limit` change sets, the newest first, from the first below `before`.

    raises  NotFound if there is no such map
    """
    map_id = None if map_name is None else map_id_of(connection, map_name)
    with translated():
        rows = connection.execute(LIST_CHANGE_SETS, {"map_id": map_id, "before": before, "limit": limit})
        return tuple(ChangeSet(*row) for row in rows)


def get_change_set(connection: Connection, change_set_id: int) -> ChangeSet:
    """raises NotFound"""
    with translated():
        row = connection.execute(GET_CHANGE_SET, {"change_set_id": change_set_id}).one_or_none()
    if row is None:
        raise NotFound("change set", change_set_id, "List the change sets of the map to see their ids.")
    return ChangeSet(*row)


def rows_of(connection: Connection, change_set_id: int, limit: int = 1000) -> tuple[RowChange, ...]:
    """What a change set did, row by row, at most `limit` of them."""
    with translated():
        rows = connection.execute(ROW_CHANGES, {"change_set_id": change_set_id, "limit": limit})
        return tuple(RowChange(*row) for row in rows)


def undo(connection: Connection, change_set_id: int) -> ChangeSet:
    """Take a change set back, whole, by a change set of its own, which can be undone in turn.

    raises  NotFound, InvalidInput if there is nothing to take back, Conflict if a row was changed since, or
            something that came later would go with it
    """
    # Slow to import, and needed here only: signing and listing should not wait for it.
    from semap.geometry.abstractions import derive  # noqa: PLC0415
    from semap.store.map.description import read_geometries, write_descriptions  # noqa: PLC0415

    get_change_set(connection, change_set_id)
    with translated():
        reshaped = connection.scalar(UNDO, {"change_set_id": change_set_id}) or []
    sources = read_geometries(connection, reshaped)
    write_descriptions(
        connection, [(id_, sources.get(id_, ()), derive(sources.get(id_, ()))) for id_ in reshaped]
    )
    with translated():
        return get_change_set(connection, connection.scalar(MADE_HERE) or change_set_id)


def instances_as_of(
    connection: Connection,
    map_name: str,
    at: datetime,
    *,
    instance_id: int | None = None,
    after: int = 0,
    limit: int = 100,
) -> tuple[PastInstance, ...]:
    """The instances of a map as they were at a time, at most `limit` in the order of their ids.

    raises  NotFound if there is no such map, InvalidInput for a naive time
    """
    if at.tzinfo is None:
        raise InvalidInput("a time without a time zone", "Give it with its offset, such as Z.", "as_of")
    parameters = {
        "map_id": map_id_of(connection, map_name),
        "at": at,
        "instance_id": instance_id,
        "after": after,
        "limit": limit,
    }
    with translated():
        return tuple(_past(row) for row in connection.execute(INSTANCES_AS_OF, parameters))


def instance_as_of(connection: Connection, instance_id: int, at: datetime) -> tuple[str, PastInstance]:
    """An instance as it was at a time, with the name of its map; it may be gone by now.

    raises  NotFound if it was not there at that time
    """
    with translated():
        map_name = connection.scalar(MAP_OF_INSTANCE, {"instance_id": instance_id})
    found = (
        instances_as_of(connection, map_name, at, instance_id=instance_id, after=instance_id - 1, limit=1)
        if map_name is not None
        else ()
    )
    if not found:
        raise NotFound("instance", f"{instance_id} at {at.isoformat()}", "See the changes of its map.")
    return map_name, found[0]


def _past(row: Sequence[Any]) -> PastInstance:
    instance_id, uid, name, alias, concept, storey, attributes = row[:7]
    pose, (wkb, z_min_m, z_max_m) = row[7:14], row[14:]
    return PastInstance(
        instance_id,
        uid,
        name,
        alias,
        concept,
        storey,
        attributes,
        None if pose[0] is None else Pose(*pose),
        None if wkb is None else shapely.from_wkb(bytes(wkb)),
        None if z_min_m is None or z_max_m is None else HeightBand(z_min_m, z_max_m),
    )
