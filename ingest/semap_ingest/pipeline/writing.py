"""Writes what perception finds: states of persons, lines, tracks that end and amendments, each batch a
transaction.

A batch, the watermarks of both sources and how far the recording has come are committed together. Perception
gives the same again when it is given the same records, so that after a crash the recording is taken from its
beginning and all is passed over that was committed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from uuid import UUID

import numpy as np
import psycopg

from semap.errors import Conflict, NotFound
from semap.store.database import translated
from semap.timeline.stamp import day_of, to_datetime
from semap_ingest.pipeline.found import Found, LinesAt
from semap_ingest.replay import track_uid
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.state_copy import EXTENT_COLUMNS, pack_states

ROLE = "semap_ingest"
COPY_STATES = f"copy semap.track_state ({', '.join(EXTENT_COLUMNS)}) from stdin (format binary)"
ADD_LINES = """
    insert into semap.line_observation
      (source_id, stamp, x1_m, y1_m, x2_m, y2_m, z_m, angle_std_rad, offset_std_m, points)
    select %s, l.* from unnest(%s::timestamptz[], %s::float8[], %s::float8[], %s::float8[], %s::float8[],
                               %s::float8[], %s::float4[], %s::float4[], %s::integer[]) l
"""
ADD_TRACKS = """
    insert into semap.track (uid, source_id, map_id, name)
    select uid, %s, %s, name from unnest(%s::uuid[], %s::text[]) t (uid, name)
    on conflict (source_id, name) do nothing
"""
END_TRACKS = """
    update semap.track k set ended_at = e.stamp
    from unnest(%s::bigint[], %s::timestamptz[]) e (track_id, stamp)
    where k.track_id = e.track_id
"""
ADD_AMENDMENTS = """
    insert into semap.track_amendment (source_id, track_id, other_track_id, kind, since, found)
    select %s, a.* from unnest(%s::bigint[], %s::bigint[], %s::text[], %s::timestamptz[], %s::timestamptz[]) a
    on conflict do nothing
"""
MOVE_WATERMARK = "update semap.source set watermark = greatest(watermark, %s) where source_id = %s"
MIDDLE_M = 0.9
"""Height of the middle of a person's body over the floor: within the height band of the room it stands in."""


@dataclass(frozen=True)
class Registered:
    """The rows that a recording writes to.

    done  results of it that have been committed
    """

    map_id: int
    map_uid: UUID
    persons_id: int
    lines_id: int
    recording_id: int
    done: int
    finished: bool


def register(
    connection: psycopg.Connection, map_name: str, source: str, path: str, fingerprint: str
) -> Registered:
    """Make the two sources and the recording, where they are missing.

    raises  NotFound where there is no such map; Conflict where the source has tracks of another recording
    """
    with translated(), connection.transaction():
        row = connection.execute("select map_id, uid from semap.map where name = %s", [map_name]).fetchone()
        if row is None:
            raise NotFound("map", map_name, "List them: semap map list")
        map_id, map_uid = row
        persons_id, lines_id = (
            _source(connection, map_id, f"{source}/{part}") for part in ("persons", "lines")
        )
        other = connection.execute(
            "select path from semap.recording where source_id = %s and fingerprint <> %s",
            [persons_id, fingerprint],
        ).fetchone()
        if other is not None:
            raise Conflict(
                f"The source {source} has the tracks of another recording already: {other[0]}",
                "Give this one a source of its own (--source NAME).",
            )
        connection.execute(
            "insert into semap.recording (source_id, fingerprint, path) values (%s, %s, %s)"
            " on conflict (source_id, fingerprint) do nothing",
            [persons_id, fingerprint, path],
        )
        recording_id, done, finished = _row(
            connection,
            "select recording_id, states_done, finished_at is not null from semap.recording"
            " where source_id = %s and fingerprint = %s",
            [persons_id, fingerprint],
        )
    return Registered(map_id, map_uid, persons_id, lines_id, recording_id, done, bool(finished))


class Writer:
    """Mutable: the ids of tracks that are known, and the days that have their partitions."""

    def __init__(
        self, connection: psycopg.Connection, registered: Registered, source: str, floor_z_m: float
    ) -> None:
        self._connection = connection
        self._registered = registered
        self._source = f"{source}/persons"
        self._middle_m = floor_z_m + MIDDLE_M
        self._ids: dict[int, int] = {}
        self._days: set[int] = set()

    def commit(self, batch: Sequence[Found], done: int, *, is_over: bool = False) -> None:
        """Write a batch in one transaction.

        done     results of the recording that are in with it
        is_over  nothing more is to come: rules do not wait for these sources
        """
        states = [each.states for found in batch for each in found.persons]
        lines = [each for found in batch for each in found.lines if len(each.lines)]
        self._make_partitions([*(each.stamp_us for each in states), *(each.lines.stamp_us for each in lines)])
        with translated(), self._connection.transaction(), self._connection.cursor() as cursor:
            self._write_states(cursor, states)
            self._write_lines(cursor, lines)
            self._move_watermarks(cursor, batch)
            cursor.execute(
                "update semap.recording set states_done = %s,"
                " finished_at = case when %s then clock_timestamp() end where recording_id = %s",
                [done, is_over, self._registered.recording_id],
            )
            if is_over:
                cursor.execute(
                    "update semap.source set ended = true where source_id = any (%s)",
                    [[self._registered.persons_id, self._registered.lines_id]],
                )

    def _write_states(self, cursor: psycopg.Cursor, states: Sequence[TrackStates]) -> None:
        ended = [one for each in states for one in each.ended]
        amendments = [one for each in states for one in each.amendments]
        self._add_tracks(
            cursor,
            {
                *(int(track) for each in states for track in each.track),
                *(track for track, _ in ended),
                *(track for one in amendments for track in (one.track, one.other)),
            },
        )
        seen = [each for each in states if len(each)]
        if seen:
            with cursor.copy(COPY_STATES) as copy:
                copy.write(self._pack(seen))
        if ended:
            cursor.execute(
                END_TRACKS, [[self._ids[track] for track, _ in ended], [to_datetime(at) for _, at in ended]]
            )
        if amendments:
            cursor.execute(
                ADD_AMENDMENTS,
                [
                    self._registered.persons_id,
                    [self._ids[one.track] for one in amendments],
                    [self._ids[one.other] for one in amendments],
                    [one.kind for one in amendments],
                    [to_datetime(one.since_us) for one in amendments],
                    [to_datetime(one.found_us) for one in amendments],
                ],
            )

    def _add_tracks(self, cursor: psycopg.Cursor, numbers: Collection[int]) -> None:
        """Learn the ids of tracks; those that are not there yet are made."""
        new = sorted(number for number in numbers if number not in self._ids)
        if not new:
            return
        names = [f"person {track}" for track in new]
        uids = [track_uid(self._registered.map_uid, self._source, name) for name in names]
        cursor.execute(ADD_TRACKS, [self._registered.persons_id, self._registered.map_id, uids, names])
        cursor.execute(
            "select name, track_id from semap.track where source_id = %s and name = any (%s)",
            [self._registered.persons_id, names],
        )
        ids: dict[str, int] = dict(cursor.fetchall())
        self._ids.update((track, ids[name]) for track, name in zip(new, names, strict=True))

    def _pack(self, states: Sequence[TrackStates]) -> bytes:
        position = np.concatenate([each.position_m for each in states])
        velocity = np.concatenate([each.velocity_mps for each in states])
        covariance = np.concatenate([each.covariance_m2 for each in states])
        extent = np.concatenate([each.extent_m for each in states])
        count = len(position)
        return pack_states(
            np.array([self._ids[int(t)] for each in states for t in each.track], dtype=np.int64),
            np.concatenate([np.full(len(each), each.stamp_us) for each in states]),
            position[:, 0],
            position[:, 1],
            np.full(count, self._middle_m),
            # of one axis: what a circle of the same area as the ellipse has
            np.linalg.det(covariance) ** 0.25,
            np.zeros(count, dtype=np.bool_),
            heading_rad=np.concatenate([each.heading_rad for each in states]),
            speed_mps=np.hypot(velocity[:, 0], velocity[:, 1]),
            length_m=extent[:, 0],
            width_m=extent[:, 1],
        )

    def _write_lines(self, cursor: psycopg.Cursor, found: Sequence[LinesAt]) -> None:
        if not found:
            return
        ends = np.concatenate([each.lines.ends_m for each in found]).reshape(-1, 4)
        cursor.execute(
            ADD_LINES,
            [
                self._registered.lines_id,
                [to_datetime(each.lines.stamp_us) for each in found for _ in range(len(each.lines))],
                *(ends[:, column].tolist() for column in range(4)),
                [each.z_m for each in found for _ in range(len(each.lines))],
                np.concatenate([each.lines.angle_std_rad for each in found]).tolist(),
                np.concatenate([each.lines.offset_std_m for each in found]).tolist(),
                np.concatenate([each.lines.points for each in found]).tolist(),
            ],
        )

    def _move_watermarks(self, cursor: psycopg.Cursor, batch: Sequence[Found]) -> None:
        for source_id, marks in (
            (self._registered.persons_id, [found.persons_watermark_us for found in batch]),
            (self._registered.lines_id, [found.lines_watermark_us for found in batch]),
        ):
            known = [mark for mark in marks if mark is not None]
            if known:
                cursor.execute(MOVE_WATERMARK, [to_datetime(max(known)), source_id])

    def _make_partitions(self, stamps_us: Sequence[int]) -> None:
        days = {day_of(stamp_us).toordinal(): day_of(stamp_us) for stamp_us in stamps_us}
        new = [day for number, day in days.items() if number not in self._days]
        if new:
            with translated(), self._connection.transaction():
                self._connection.execute("select semap.ensure_partitions(%s::date[])", [new])
            self._days |= days.keys()


def _source(connection: psycopg.Connection, map_id: int, name: str) -> int:
    connection.execute(
        "insert into semap.source (map_id, name) values (%s, %s) on conflict (map_id, name) do nothing",
        [map_id, name],
    )
    (source_id,) = _row(
        connection, "select source_id from semap.source where map_id = %s and name = %s", [map_id, name]
    )
    return source_id


def _row(connection: psycopg.Connection, statement: str, parameters: list[object]) -> tuple[int, ...]:
    row = connection.execute(statement, parameters).fetchone()
    assert row is not None  # noqa: S101  (it was there, or a statement before made it)
    return tuple(row)
