"""The tree of frames of a map: made, moved, re-parented, and asked where one stood in another.

What stands on a frame moves with it in the same transaction. The functions are those of sql/040_frame.sql.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from sqlalchemy import Connection, delete, func, insert, select, text, update

from semap.errors import Conflict, InvalidInput, NotFound
from semap.model.pose import IDENTITY, Pose
from semap.store.database.connection import translated
from semap.store.database.tables import frame, frame_pose, instance
from semap.store.map.maps import map_id_of
from semap.store.map.placement import PARTS, ROOT_FRAME, normalised

Keep = Literal["world", "local"]

FIRST_YEAR, LAST_YEAR = 1800, 9998
"""As for the states of tracks: whatever lies outside is a broken clock."""

FRAMES = """
    select f.frame_id, m.name, f.name, p.name, (n.pose).x_m, (n.pose).y_m, (n.pose).z_m,
           (n.pose).qx, (n.pose).qy, (n.pose).qz, (n.pose).qw,
           not exists (select from semap.frame_pose s where s.frame_id = f.frame_id and s.stamp > '-infinity')
    from semap.frame f
    join semap.map m using (map_id)
    left join semap.frame p on p.frame_id = f.parent_id
    cross join lateral (select semap.pose_at(f.frame_id) as pose) n
"""
LIST_FRAMES = text(
    f"{FRAMES} where m.name = :map_name and f.frame_id > :after order by f.frame_id limit :limit"
)
GET_FRAME = text(f"{FRAMES} where f.frame_id = :frame_id")
TRANSFORM = text("""
    select (t.pose).x_m, (t.pose).y_m, (t.pose).z_m, (t.pose).qx, (t.pose).qy, (t.pose).qz, (t.pose).qw
    from (select semap.transform(:a_id, :b_id, coalesce(cast(:at as timestamptz), 'infinity')) as pose) t
""")
SET_POSE = text("""
    select semap.set_transform(:frame_id, row(:x_m, :y_m, :z_m, :qx, :qy, :qz, :qw)::semap.pose,
                               coalesce(cast(:stamp as timestamptz), '-infinity'))
""")


@dataclass(frozen=True)
class Frame:
    """A frame and where it stands now: `pose` is parent_T_frame; None: it had no pose yet.

    parent     None: it is a root
    is_static  whether it never moves: it has no stamped pose
    """

    frame_id: int
    map: str
    name: str
    parent: str | None
    pose: Pose | None
    is_static: bool


def list_frames(
    connection: Connection, map_name: str, *, after: int = 0, limit: int = 100
) -> tuple[Frame, ...]:
    """At most `limit` frames of a map in the order of their ids, from the first after `after`.

    raises  NotFound if there is no such map
    """
    map_id_of(connection, map_name)
    with translated():
        rows = connection.execute(LIST_FRAMES, {"map_name": map_name, "after": after, "limit": limit})
        return tuple(_frame(row) for row in rows)


def get_frame(connection: Connection, frame_id: int) -> Frame:
    """raises NotFound"""
    with translated():
        row = connection.execute(GET_FRAME, {"frame_id": frame_id}).one_or_none()
    if row is None:
        raise NotFound("frame", frame_id, "List the frames of the map to see their ids.")
    return _frame(row)


def frame_named(connection: Connection, map_name: str, name: str) -> Frame:
    """raises NotFound"""
    map_id = map_id_of(connection, map_name)
    with translated():
        found = connection.scalar(
            select(frame.c.frame_id).where(frame.c.map_id == map_id, frame.c.name == name)
        )
    if found is None:
        raise NotFound(
            "frame", name, f"It was looked for on map {map_name}; storeys and instances have frames."
        )
    return get_frame(connection, found)


def create_frame(
    connection: Connection, map_name: str, name: str, parent: str | None = ROOT_FRAME, pose: Pose = IDENTITY
) -> Frame:
    """A new frame below another one; without a parent a root of its own.

    raises  NotFound if there is no such map or parent, Conflict if the name is taken
    """
    map_id = map_id_of(connection, map_name)
    parent_id = None if parent is None else frame_named(connection, map_name, parent).frame_id
    with translated():
        frame_id = connection.scalar(
            insert(frame).values(map_id=map_id, name=name, parent_id=parent_id).returning(frame.c.frame_id)
        )
    set_pose(connection, int(frame_id or 0), pose)
    return get_frame(connection, int(frame_id or 0))


def set_pose(connection: Connection, frame_id: int, pose: Pose, stamp: datetime | None = None) -> None:
    """Set parent_T_frame from a stamp on; None: as its static pose. What stands on it moves with it.

    The newest stamp counts as now, also where it lies in the future.
    raises  NotFound, InvalidInput for a pose without a rotation or a naive stamp, Conflict for the root, or
            for a static pose of a frame that has stamped ones
    """
    if stamp is not None and stamp.tzinfo is None:
        raise InvalidInput("a stamp without a time zone", "Give it with its offset, such as Z.", "stamp")
    if stamp is not None and not FIRST_YEAR <= stamp.year <= LAST_YEAR:
        raise InvalidInput(f"a stamp in the year {stamp.year}", "Mind the clock of the sensor.", "stamp")
    placed = normalised(pose)
    known = get_frame(connection, frame_id)
    if stamp is None and not known.is_static:
        raise Conflict(
            f"{known.name} has stamped poses, of which the newest counts.",
            "Give the pose with a stamp: POST /frames/{id}/poses.",
        )
    with translated():
        connection.execute(
            SET_POSE,
            {
                "frame_id": frame_id,
                "stamp": stamp,
                **{part: getattr(placed, part) for part in PARTS},
            },
        )


def change_frame(connection: Connection, frame_id: int, parent: str | None, keep: Keep = "world") -> Frame:
    """Put a frame below another one of its map (None: make it a root).

    keep    'world': it stays where it is; 'local': it keeps its pose and moves with its new parent
    raises  NotFound, InvalidInput if the parent stands on the frame itself
    """
    known = get_frame(connection, frame_id)
    _refuse_root(known)
    parent_id = None if parent is None else frame_named(connection, known.map, parent).frame_id
    with translated():
        connection.execute(select(func.semap.change_frame(frame_id, parent_id, keep == "world")))
    return get_frame(connection, frame_id)


def rename_frame(connection: Connection, frame_id: int, name: str) -> Frame:
    """raises NotFound, Conflict if the name is taken or the frame is the map's root"""
    _refuse_root(get_frame(connection, frame_id))
    with translated():
        connection.execute(update(frame).where(frame.c.frame_id == frame_id).values(name=name))
    return get_frame(connection, frame_id)


def delete_frame(connection: Connection, frame_id: int) -> None:
    """raises NotFound, Conflict if something stands on it"""
    known = get_frame(connection, frame_id)
    _refuse_root(known)
    with translated():
        standing = connection.scalars(
            select(instance.c.name)
            .where(instance.c.frame_id == frame_id)
            .union(select(frame.c.name).where(frame.c.parent_id == frame_id))
            .limit(5)
        ).all()
        if standing:
            raise Conflict(
                f"{known.name} carries other things: {', '.join(standing)}.", "Move or delete these first."
            )
        connection.execute(delete(frame).where(frame.c.frame_id == frame_id))


def list_poses(
    connection: Connection, frame_id: int, *, after: datetime | None = None, limit: int = 100
) -> tuple[tuple[datetime | None, Pose], ...]:
    """At most `limit` poses of a frame by stamp, from the first after `after`; None: the static one."""
    get_frame(connection, frame_id)
    found = (
        select(
            func.nullif(frame_pose.c.stamp, text("'-infinity'::timestamptz")),
            *(frame_pose.c[part] for part in PARTS),
        )
        .where(frame_pose.c.frame_id == frame_id)
        .order_by(frame_pose.c.stamp)
        .limit(limit)
    )
    if after is not None:
        found = found.where(frame_pose.c.stamp > after)
    with translated():
        return tuple((stamp, Pose(*pose)) for stamp, *pose in connection.execute(found))


def transform(connection: Connection, a_id: int, b_id: int, at: datetime | None = None) -> Pose:
    """a_T_b between any two frames of one tree, now or at a past time: maps points of b to a.

    raises  NotFound, InvalidInput if they are in different trees, or one was nowhere at that time
    """
    for frame_id in (a_id, b_id):
        get_frame(connection, frame_id)
    with translated():
        row = connection.execute(TRANSFORM, {"a_id": a_id, "b_id": b_id, "at": at}).one()
    return Pose(*row)


def _refuse_root(known: Frame) -> None:
    if known.parent is None and known.name == ROOT_FRAME:
        raise Conflict("The root frame of a map stays as it is.", "Work with a frame below it.")


def _frame(row: Sequence[Any]) -> Frame:
    frame_id, map_name, name, parent, *pose, is_static = row
    return Frame(frame_id, map_name, name, parent, None if pose[0] is None else Pose(*pose), is_static)
