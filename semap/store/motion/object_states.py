"""States of objects: a door opened, a light went on. They stand beside tracks as what rules may read."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, func, select, text, update
from sqlalchemy.dialects.postgresql import insert as upsert

from semap.errors import InvalidInput
from semap.model.object_state import NewObjectState, ObjectState
from semap.store.database.connection import translated
from semap.store.database.tables import map_, object_state, source
from semap.store.map.maps import map_id_of
from semap.timeline.stamp import require_usual

ADD_STATES = text("""
    insert into semap.object_state (source_id, instance_name, property, value, stamp, attributes)
    select :source_id, s.instance, s.property, s.value, s.stamp, s.attributes
    from jsonb_to_recordset(cast(:states as jsonb))
      as s (instance text, property text, value text, stamp timestamptz, attributes jsonb)
    order by s.stamp
    on conflict (uid) do nothing
    returning object_state_id
""")
LACKING = text("""
    select n.name from unnest(cast(:names as text[])) n (name)
    where not exists (select from semap.instance i where i.map_id = :map_id and i.name = n.name)
    order by 1
""")


def list_object_states(
    connection: Connection,
    *,
    map_name: str | None = None,
    instance: str | None = None,
    property_name: str | None = None,
    after: int = 0,
    limit: int = 100,
) -> tuple[ObjectState, ...]:
    """At most `limit` states in the order of their arrival, from the first after `after`."""
    found = _STATES.where(object_state.c.object_state_id > after)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    if instance is not None:
        found = found.where(object_state.c.instance_name == instance)
    if property_name is not None:
        found = found.where(object_state.c.property == property_name)
    with translated():
        rows = connection.execute(found.order_by(object_state.c.object_state_id).limit(limit))
        return tuple(_state(row) for row in rows)


def add_object_states(
    connection: Connection,
    map_name: str,
    source_name: str,
    states: Sequence[NewObjectState],
    *,
    watermark: datetime | None = None,
) -> tuple[int, ...]:
    """Write states that a source saw; returns the ids of those not known before.

    The source is made where it is missing.

    watermark  the source gives no state up to this stamp after these; it does not go back
    raises     NotFound if there is no such map or no such instance on it, InvalidInput
    """
    rows = [_row(each) for each in states]
    map_id = map_id_of(connection, map_name)
    with translated():
        connection.execute(select(func.semap.lock_regions_shared()))
        source_id = _source_id(connection, map_id, source_name)
        added = connection.scalars(ADD_STATES, {"source_id": source_id, "states": json.dumps(rows)}).all()
        if watermark is not None:
            connection.execute(
                update(source)
                .where(source.c.source_id == source_id)
                .values(watermark=func.greatest(source.c.watermark, watermark))
            )
    return tuple(sorted(added))


def names_of_no_instance(connection: Connection, map_name: str, names: Sequence[str]) -> Sequence[str]:
    """Which of these names no instance on the map has, in their order.

    raises  NotFound if there is no such map
    """
    asked = {"map_id": map_id_of(connection, map_name), "names": list(names)}
    with translated():
        return connection.scalars(LACKING, asked).all()


def hold_back_source(connection: Connection, map_name: str, source_name: str) -> None:
    """Let rules wait with the states of a source for those of others: it says watermarks, and none yet.

    The source is made where it is missing.

    raises  NotFound if there is no such map
    """
    map_id = map_id_of(connection, map_name)
    with translated():
        source_id = _source_id(connection, map_id, source_name)
        connection.execute(
            update(source)
            .where(source.c.source_id == source_id, source.c.watermark.is_(None))
            .values(watermark="-infinity")
        )


def end_source(connection: Connection, map_name: str, source_name: str) -> None:
    """Nothing more is to come of a source for now: rules do not wait for it until its watermark moves.

    raises  NotFound if there is no such map
    """
    map_id = map_id_of(connection, map_name)
    with translated():
        connection.execute(
            update(source).where(source.c.map_id == map_id, source.c.name == source_name).values(ended=True)
        )


def _row(state: NewObjectState) -> dict[str, object]:
    if not state.property:
        raise InvalidInput("a property without a name", "Name the property, such as door.", "property")
    return {
        "instance": state.instance,
        "property": state.property,
        "value": state.value,
        "stamp": require_usual(state.stamp, "stamp").isoformat(),
        "attributes": dict(state.attributes),
    }


def _source_id(connection: Connection, map_id: int, name: str) -> int:
    known = select(source.c.source_id).where(source.c.map_id == map_id, source.c.name == name)
    found = connection.scalar(known)
    if found is None:
        made = upsert(source).values(map_id=map_id, name=name)
        connection.execute(made.on_conflict_do_nothing(index_elements=["map_id", "name"]))
        found = connection.scalar(known)
    assert found is not None  # noqa: S101  (it was there, or this statement made it)
    return int(found)


def _state(row: Sequence[Any]) -> ObjectState:
    return ObjectState(*row)


_STATES = (
    select(
        object_state.c.object_state_id,
        object_state.c.uid,
        map_.c.name,
        source.c.name,
        object_state.c.instance_id,
        object_state.c.instance_name,
        object_state.c.property,
        object_state.c.value,
        object_state.c.previous,
        object_state.c.stamp,
        object_state.c.since,
        object_state.c.attributes,
    )
    .join(map_, map_.c.map_id == object_state.c.map_id)
    .join(source, source.c.source_id == object_state.c.source_id)
)
