"""What was said of a map from one moment to before another, by its stamps; not all of it in memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from operator import attrgetter
from typing import Any

from sqlalchemy import Connection, text

from semap.model.pose import Pose
from semap.store.database.connection import translated
from semap.store.map.maps import map_id_of
from semap.store.motion.live import ShownTrack

PAGE = 5_000

STATES = text("""
    select s.track_id, t.name, s.stamp, s.x_m, s.y_m, s.z_m, s.heading_rad, s.speed_mps,
           s.length_m, s.width_m, s.std_m, s.std_across_m, s.std_yaw_rad, s.is_last
    from semap.states_of_map(:map_id, :from, :to) s join semap.track t using (track_id)
    where s.stamp < :to order by s.stamp, s.track_id
""")
ENDS = text("""
    select ended_at, track_id from semap.track
    where map_id = :map_id and ended_at >= :from and ended_at < :to order by ended_at, track_id
""")
LINES = text("""
    select s.name, l.stamp, l.x1_m, l.y1_m, l.x2_m, l.y2_m, l.z_m
    from semap.line_observation l join semap.source s using (source_id)
    where s.map_id = :map_id and l.stamp >= :from and l.stamp < :to order by l.stamp, s.name
""")
POSES = text("""
    select p.stamp, f.name, above.name, p.x_m, p.y_m, p.z_m, p.qx, p.qy, p.qz, p.qw
    from semap.frame_pose p join semap.frame f using (frame_id)
    join semap.frame above on above.frame_id = f.parent_id
    where f.map_id = :map_id and p.stamp >= :from and p.stamp < :to order by p.stamp, f.name
""")


@dataclass(frozen=True)
class Seen:
    """Who was seen at a stamp; ended: ids of those for whom it was the last time."""

    stamp: datetime
    tracks: tuple[ShownTrack, ...]
    ended: tuple[int, ...]


@dataclass(frozen=True)
class SeenLines:
    """Straight lines that a source saw at once: x and y of both ends, and z [m, map frame]."""

    stamp: datetime
    source: str
    ends_m: tuple[tuple[float, float, float, float, float | None], ...]


@dataclass(frozen=True)
class Moved:
    """parent_T_frame from a stamp on."""

    stamp: datetime
    frame: str
    parent: str
    pose: Pose


def states_between(connection: Connection, map_name: str, start: datetime, end: datetime) -> Iterator[Seen]:
    """raises NotFound where there is no such map"""
    for stamp, rows in groupby(_rows(connection, STATES, map_name, start, end), attrgetter("stamp")):
        found = list(rows)
        yield Seen(
            stamp,
            tuple(ShownTrack(*[*row[:-1], ()]) for row in found),
            tuple(row.track_id for row in found if row.is_last),
        )


def ends_between(connection: Connection, map_name: str, start: datetime, end: datetime) -> Iterator[Seen]:
    """Tracks that ended, whether they said a last state or not; raises NotFound"""
    for row in _rows(connection, ENDS, map_name, start, end):
        yield Seen(row.ended_at, (), (row.track_id,))


def lines_between(
    connection: Connection, map_name: str, start: datetime, end: datetime
) -> Iterator[SeenLines]:
    """raises NotFound where there is no such map"""
    rows = _rows(connection, LINES, map_name, start, end)
    for (stamp, source), found in groupby(rows, attrgetter("stamp", "name")):
        yield SeenLines(stamp, source, tuple(tuple(row[2:]) for row in found))


def moves_between(connection: Connection, map_name: str, start: datetime, end: datetime) -> Iterator[Moved]:
    """raises NotFound where there is no such map"""
    for stamp, frame, parent, *pose in _rows(connection, POSES, map_name, start, end):
        yield Moved(stamp, frame, parent, Pose(*pose))


def _rows(
    connection: Connection, statement: Any, map_name: str, start: datetime, end: datetime
) -> Iterator[Any]:
    asked = {"map_id": map_id_of(connection, map_name), "from": start, "to": end}
    with translated():
        yield from connection.execute(statement, asked, execution_options={"yield_per": PAGE})
