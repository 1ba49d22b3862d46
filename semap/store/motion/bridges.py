"""Bridges: how far each has come, committed with what it brings in, and what it says of itself.

A bridge is held by one process at a time, which has an advisory lock as long as its connection lasts. What is
certain whatever becomes of that connection is the position: it moves from where its bridge saw it, or not at
all.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Literal, TypeAlias

from sqlalchemy import Connection, text

from semap.errors import Conflict, NotFound
from semap.store.database.connection import translated

Position: TypeAlias = Mapping[str, object]
"""A value of JSON that its reader understands."""
Way: TypeAlias = Literal["in", "out", "changes", "client"]

LOCK = 7376
"""First key of the advisory lock that keeps a second process from the same bridge."""
HOLD = text("select pg_try_advisory_lock(:lock, hashtext(:bridge))")
MAKE = text("""
    insert into semap.bridge_position (map_id, name, way) values (:map_id, :name, :way)
    on conflict (map_id, name, way) do nothing
""")
READ = text(
    "select position from semap.bridge_position where map_id = :map_id and name = :name and way = :way"
)
MOVE = text("""
    update semap.bridge_position set position = cast(:now as jsonb), moved_at = clock_timestamp()
    where map_id = :map_id and name = :name and way = :way
      and position is not distinct from cast(:was as jsonb)
""")
TELL = text("""
    insert into semap.bridge as b (map_id, name, kind, state, trouble, lag_s, received, committed, delivered,
                                   dropped, refused, reconnects, refusals, started_at)
    select map_id, :name, :kind, :state, :trouble, :lag_s, :received, :committed,
           :delivered, :dropped, :refused, :reconnects, cast(:refusals as jsonb), :started_at
    from semap.map where map_id = :map_id
    on conflict (map_id, name) do update
    set kind = excluded.kind, state = excluded.state, trouble = excluded.trouble, lag_s = excluded.lag_s,
        received = excluded.received, committed = excluded.committed, delivered = excluded.delivered,
        dropped = excluded.dropped, refused = excluded.refused, reconnects = excluded.reconnects,
        refusals = excluded.refusals, started_at = excluded.started_at, told_at = clock_timestamp()
""")
FREE = text("select pg_try_advisory_xact_lock(:lock, hashtext(:bridge))")
FORGET = text("""
    with position as (
      delete from semap.bridge_position where map_id = :map_id and name = :name and way <> 'client'
      returning name
    ), bridge as (
      delete from semap.bridge where map_id = :map_id and name = :name returning name
    )
    select exists (table position union all table bridge)
""")
LIST = text("""
    select b.kind, b.state, b.trouble, b.lag_s, b.received, b.committed, b.delivered, b.dropped, b.refused,
           b.reconnects, b.refusals, b.started_at, b.told_at, m.name, b.name
    from semap.bridge b join semap.map m using (map_id)
    where m.name = :map or :map is null order by m.name, b.name limit :limit
""")


@dataclass(frozen=True)
class Place:
    """Whose position it is."""

    map_id: int
    name: str
    way: Way


@dataclass(frozen=True)
class BridgeReport:
    """What a bridge says of itself; counts are since it was started.

    state      connected; waiting for its peer or the database; ended
    trouble    why it waits, in words
    lag_s      how long the oldest record that came in has waited, or the last one had; None: nothing yet
    received, committed  records that came in, and those of them that are stored
    delivered  events that were given out
    dropped    records of a live source that nothing could keep
    refused    records that cannot be used, in all; refusals: by the reason
    """

    kind: str
    state: str
    trouble: str
    lag_s: float | None
    received: int
    committed: int
    delivered: int
    dropped: int
    refused: int
    reconnects: int
    refusals: Mapping[str, int]
    started_at: datetime


@dataclass(frozen=True)
class Bridge(BridgeReport):
    """A bridge, and when it last spoke."""

    told_at: datetime
    map: str
    name: str


def hold_bridge(connection: Connection, map_id: int, name: str) -> bool:
    """Keep others from a bridge as long as the connection lasts; False where another process holds it."""
    with translated():
        return bool(connection.scalar(HOLD, {"lock": LOCK, "bridge": f"{map_id}/{name}"}))


def read_position(connection: Connection, place: Place) -> Position | None:
    """Where a bridge is; None at its beginning."""
    with translated():
        found: Position | None = connection.scalar(READ, asdict(place))
        return found


def move_position(connection: Connection, place: Place, was: Position | None, now: Position) -> None:
    """Move a position, within the transaction that writes what lies before it.

    was     where its reader saw it
    raises  Conflict where it is elsewhere, so that somebody else moved it, or the map is gone
    """
    values = {**asdict(place), "was": None if was is None else json.dumps(was), "now": json.dumps(now)}
    with translated():
        if was is None:
            connection.execute(MAKE, asdict(place))
        if connection.execute(MOVE, values).rowcount == 0:
            raise Conflict(
                f"The position of the bridge {place.name} was moved by somebody else meanwhile.",
                "Run one bridge of a name for each map; give the other one a name of its own.",
            )


def tell_bridge(connection: Connection, map_id: int, name: str, report: BridgeReport) -> None:
    """Write what a bridge says of itself; raises NotFound where its map was deleted."""
    values = {**asdict(report), "refusals": json.dumps(dict(report.refusals))}
    with translated():
        if connection.execute(TELL, {"map_id": map_id, "name": name, **values}).rowcount == 0:
            raise NotFound("map", "that this bridge ran on any more", "It was deleted.")


def forget_bridge(connection: Connection, map_id: int, name: str) -> None:
    """Delete what is known of a bridge, its positions too; it begins anew where it runs again.

    raises  Conflict while it runs; NotFound where none of the name has run
    """
    with translated():
        if not connection.scalar(FREE, {"lock": LOCK, "bridge": f"{map_id}/{name}"}):
            raise Conflict(f"The bridge {name} runs.", "Stop it first.")
        if not connection.scalar(FORGET, {"map_id": map_id, "name": name}):
            raise NotFound("bridge", name, "See: semap bridge list")


def list_bridges(
    connection: Connection, *, map_name: str | None = None, limit: int = 100
) -> tuple[Bridge, ...]:
    """At most `limit` bridges that have ever run, by map and name."""
    with translated():
        rows = connection.execute(LIST, {"map": map_name, "limit": limit}).all()
    return tuple(Bridge(*row) for row in rows)
