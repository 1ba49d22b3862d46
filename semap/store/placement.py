"""Frames of a map as statements within the caller's transaction: made, placed, and where they stand.

A frame placed here is static: its pose holds from the beginning of time. Where a frame has stamped
poses too, the newest counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select, text

from semap.errors import InvalidInput, NotFound
from semap.geometry.abstractions import FARTHEST_M
from semap.geometry.pose import pose_from_matrix
from semap.model.pose import IDENTITY, Pose
from semap.store.database import translated
from semap.store.tables import frame, map_

ROOT_FRAME = "map"
LONG = 1e100
TINY = 1e-30
PARTS = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")

INSERT_FRAMES = text("""
    insert into semap.frame (map_id, name, parent_id)
    select :map_id, name, parent_id from unnest(cast(:names as text[]), cast(:parent_ids as bigint[]))
      as v (name, parent_id)
    returning name, frame_id
""")
INSERT_POSES = text("""
    insert into semap.frame_pose (frame_id, x_m, y_m, z_m, qx, qy, qz, qw)
    select * from unnest(cast(:frame_ids as bigint[]),
      cast(:x_m as float8[]), cast(:y_m as float8[]), cast(:z_m as float8[]),
      cast(:qx as float8[]), cast(:qy as float8[]), cast(:qz as float8[]), cast(:qw as float8[]))
    on conflict (frame_id, stamp) do update
    set x_m = excluded.x_m, y_m = excluded.y_m, z_m = excluded.z_m,
        qx = excluded.qx, qy = excluded.qy, qz = excluded.qz, qw = excluded.qw
""")
CHAINS = text("""
    with recursive chain (start_id, frame_id, parent_id, depth) as (
      select frame_id, frame_id, parent_id, 0 from semap.frame where frame_id = any (:frame_ids)
      union all
      select c.start_id, f.frame_id, f.parent_id, c.depth + 1
      from semap.frame f join chain c on f.frame_id = c.parent_id
    )
    select c.start_id, p.x_m, p.y_m, p.z_m, p.qx, p.qy, p.qz, p.qw
    from chain c
    cross join lateral (
      select * from semap.frame_pose p where p.frame_id = c.frame_id order by stamp desc limit 1
    ) p
    order by c.start_id, c.depth
""")


@dataclass(frozen=True)
class Placed:
    """A frame to be made: its name, its parent, and parent_T_frame."""

    name: str
    parent_id: int | None
    pose: Pose = IDENTITY


def normalised(pose: Pose) -> Pose:
    """The same pose with a unit quaternion.

    raises  InvalidInput if the quaternion has no length or a part is not finite
    """
    place_m = [pose.x_m, pose.y_m, pose.z_m]
    turn = [pose.qx, pose.qy, pose.qz, pose.qw]
    largest = max(map(abs, turn))
    if math.isfinite(largest) and largest > LONG:
        turn = [part / largest for part in turn]  # so that no square of it overflows
    # PostgreSQL refuses products that underflow
    place_m = [0.0 if abs(part) < TINY else part for part in place_m]
    turn = [0.0 if abs(part) < TINY else part for part in turn]
    length = math.hypot(*turn)
    if max(map(abs, place_m)) > FARTHEST_M:
        raise InvalidInput(f"a pose beyond {FARTHEST_M:g} m", "Mind the unit, or anchor the map.", "pose")
    if not all(map(math.isfinite, (*place_m, *turn))) or length < 1e-9:
        raise InvalidInput(
            "a pose whose quaternion has no length, or with numbers that are not finite",
            "Give a unit quaternion, such as qx 0, qy 0, qz 0, qw 1.",
            "pose",
        )
    if abs(length - 1) > 1e-12:
        turn = [part / length for part in turn]
    return Pose(*map(float, (*place_m, *turn)))


def insert_frames(connection: Connection, map_id: int, frames: Sequence[Placed]) -> dict[str, int]:
    """Make frames; returns their ids by name.

    raises  Conflict if a name is taken
    """
    with translated():
        rows = connection.execute(
            INSERT_FRAMES,
            {
                "map_id": map_id,
                "names": [frame.name for frame in frames],
                "parent_ids": [frame.parent_id for frame in frames],
            },
        )
        ids: dict[str, int] = dict(rows.all())
    place_frames(connection, {ids[frame.name]: frame.pose for frame in frames})
    return ids


def place_frames(connection: Connection, poses: dict[int, Pose]) -> None:
    """Set the static pose of each frame in its parent.

    raises  InvalidInput for a pose without a rotation
    """
    placed = [normalised(pose) for pose in poses.values()]
    columns = {name: [getattr(pose, name) for pose in placed] for name in PARTS}
    with translated():
        connection.execute(INSERT_POSES, {"frame_ids": list(poses), **columns})


def map_from_frames(connection: Connection, frame_ids: Sequence[int]) -> dict[int, NDArray[np.float64]]:
    """map_T_frame of each frame, (4, 4) float64, by id."""
    matrices: dict[int, NDArray[np.float64]] = {}
    with translated():
        rows = connection.execute(CHAINS, {"frame_ids": list(frame_ids)}).all()
    for frame_id, *pose in rows:
        matrices[frame_id] = Pose(*pose).matrix() @ matrices.get(frame_id, np.eye(4))
    return matrices


def map_from_named_frame(connection: Connection, map_name: str, name: str) -> NDArray[np.float64]:
    """map_T_frame of the frame of a name, (4, 4) float64.

    raises  NotFound
    """
    named = (
        select(frame.c.frame_id)
        .join(map_, map_.c.map_id == frame.c.map_id)
        .where(map_.c.name == map_name, frame.c.name == name)
    )
    with translated():
        frame_id = connection.scalar(named)
    if frame_id is None:
        raise NotFound(
            "frame", name, f"It was looked for on map {map_name}; storeys and instances have frames."
        )
    return map_from_frames(connection, [frame_id])[frame_id]


def inverse(parent_T_child: NDArray[np.float64]) -> NDArray[np.float64]:
    """child_T_parent of a rigid motion, (4, 4)."""
    rotation = parent_T_child[:3, :3].T
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ parent_T_child[:3, 3]
    return matrix


def pose_in(map_T_parent: NDArray[np.float64], map_T_child: Pose) -> Pose:
    """parent_T_child of a frame whose pose in the map is given; exact where the parent is not turned."""
    child = normalised(map_T_child)
    if np.array_equal(map_T_parent[:3, :3], np.eye(3)):
        x_m, y_m, z_m = (float(part) for part in map_T_parent[:3, 3])
        return Pose(child.x_m - x_m, child.y_m - y_m, child.z_m - z_m, child.qx, child.qy, child.qz, child.qw)
    return pose_from_matrix(inverse(map_T_parent) @ child.matrix())
