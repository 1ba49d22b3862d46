"""Where an instance is: its pose, what carries it, the rooms around it, and what holds to others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, text

from semap.errors import NotFound
from semap.model.pose import Pose
from semap.store.database.connection import translated

INSTANCE = text("""
    select i.instance_id, i.name, m.name as map, i.frame_id
    from semap.instance i join semap.map m using (map_id) where i.instance_id = :instance_id
""")
CHAIN = text("""
    with recursive chain (frame_id, name, parent_id, depth) as (
      select frame_id, name, parent_id, 0 from semap.frame where frame_id = :frame_id
      union all
      select f.frame_id, f.name, f.parent_id, c.depth + 1
      from chain c join semap.frame f on f.frame_id = c.parent_id
    )
    select c.frame_id, c.name, p.x_m, p.y_m, p.z_m, p.qx, p.qy, p.qz, p.qw
    from chain c left join lateral (select (semap.pose_at(c.frame_id, :at)).*) p on true
    order by c.depth
""")
POSE = text("""
    select (pose).x_m, (pose).y_m, (pose).z_m, (pose).qx, (pose).qy, (pose).qz, (pose).qw
    from semap.frames_in_root(array[cast(:frame_id as bigint)], :at) p
    join semap.frame r on r.frame_id = p.root_id and r.name = 'map'
""")
ROOMS = text("select instance_id, name from semap.rooms_around(:instance_id, :at)")
RELATIONS = text("""
    select r.relation, r.instance_id, i.name, r.distance_m
    from semap.relations_of(:instance_id, :near_m) r join semap.instance i using (instance_id)
    order by r.distance_m nulls first, r.instance_id, r.relation limit :limit
""")
TRACKS = text("""
    select n.track_id, t.name, r.query_name, n.since
    from semap.relation n
    join semap.region r using (query_id, instance_id)
    join semap.track t using (track_id)
    where n.instance_id = :instance_id and n.confirmed
    order by n.track_id, r.query_name limit :limit
""")
FOREVER = "infinity"


@dataclass(frozen=True)
class Named:
    """An instance by id and name."""

    instance_id: int
    name: str


@dataclass(frozen=True)
class CarryingFrame:
    """A frame on the way to the root, with its pose in the next one; None where it was nowhere then."""

    frame_id: int
    name: str
    pose: Pose | None


@dataclass(frozen=True)
class Whereabouts:
    """Where an instance was.

    pose    map_T_instance; None: its frame hangs under another root than `map`, or was nowhere then
    rooms   that contain it, the smallest first
    frames  its own, the one that carries it, and so on
    """

    instance_id: int
    name: str
    map: str
    pose: Pose | None
    rooms: tuple[Named, ...]
    frames: tuple[CarryingFrame, ...]


@dataclass(frozen=True)
class HeldRelation:
    """What holds from an instance to another one; [m] between their footprints, None where one has none."""

    relation: str
    instance_id: int
    instance: str
    distance_m: float | None


@dataclass(frozen=True)
class HeldTrack:
    """A track that is in the instance, as a continuous query sees it."""

    track_id: int
    name: str
    query: str
    since: datetime


def whereabouts(connection: Connection, instance_id: int, at: datetime | None = None) -> Whereabouts:
    """Where an instance was at a time; None: where it is.

    raises  NotFound
    """
    asked = {"instance_id": instance_id, "at": FOREVER if at is None else at}
    found = _instance(connection, instance_id)
    asked["frame_id"] = found.frame_id
    with translated():
        pose = connection.execute(POSE, asked).one_or_none()
        return Whereabouts(
            found.instance_id,
            found.name,
            found.map,
            None if pose is None else _pose(pose),
            tuple(Named(*row) for row in connection.execute(ROOMS, asked)),
            tuple(
                CarryingFrame(frame_id, name, _pose(pose))
                for frame_id, name, *pose in connection.execute(CHAIN, asked)
            ),
        )


def relations_of(
    connection: Connection, instance_id: int, *, near_m: float, limit: int
) -> tuple[HeldRelation, ...]:
    """What holds between an instance and others, at most `limit`, the nearest first.

    near_m  up to which distance another one is near
    raises  NotFound
    """
    _instance(connection, instance_id)
    asked = {"instance_id": instance_id, "near_m": near_m, "limit": limit}
    with translated():
        return tuple(HeldRelation(*row) for row in connection.execute(RELATIONS, asked))


def tracks_in(connection: Connection, instance_id: int, limit: int) -> tuple[HeldTrack, ...]:
    """Which tracks are in an instance, at most `limit` in the order of their ids."""
    asked = {"instance_id": instance_id, "limit": limit}
    with translated():
        return tuple(HeldTrack(*row) for row in connection.execute(TRACKS, asked))


def _instance(connection: Connection, instance_id: int) -> Any:
    with translated():
        found = connection.execute(INSTANCE, {"instance_id": instance_id}).one_or_none()
    if found is None:
        raise NotFound("instance", instance_id, "List the instances to see their ids.")
    return found


def _pose(row: Sequence[Any]) -> Pose | None:
    return None if row[0] is None else Pose(*row)
