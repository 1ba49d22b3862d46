"""Writes what perception finds: states of persons, lines, tracks that end and amendments, each batch a
transaction.

A batch, the watermarks of both sources and how far the recording has come are committed together. Perception
gives the same again when it is given the same records, so that after a crash the recording is taken from its
beginning and all is passed over that was committed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from typing import TypeVar

import numpy as np
import psycopg
from numpy.typing import NDArray

from semap.errors import Conflict, NotFound
from semap.geometry.error_ellipse import ellipses_of
from semap.model.track_state import COORDINATES
from semap.store.database.connection import translated
from semap.timeline.stamp import day_of, to_datetime
from semap_ingest.pipeline.found import Found, LinesAt
from semap_ingest.pipeline.registration import Registered, persons_source
from semap_ingest.replay import track_uid
from semap_ingest.sensing.track_states import TrackStates

T = TypeVar("T")

ADD_STATES = """
    insert into semap.track_state (track_id, stamp, {names})
    select track_id, stamp, {known}
    from unnest(%s::bigint[], %s::timestamptz[], {arrays}) s (track_id, stamp, {names})
"""
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
FIND_TRACKS = "select name, track_id from semap.track where source_id = %s and name = any (%s)"
END_TRACKS = "select semap.end_tracks(%s, %s::bigint[], %s::timestamptz[])"
ADD_AMENDMENTS = """
    insert into semap.track_amendment (source_id, track_id, other_track_id, kind, since, found)
    select %s, a.* from unnest(%s::bigint[], %s::bigint[], %s::text[], %s::timestamptz[], %s::timestamptz[]) a
    on conflict do nothing
"""
MOVE_WATERMARKS = """
    update semap.source s set watermark = m.stamp
    from unnest(%s::integer[], %s::timestamptz[]) m (source_id, stamp)
    where s.source_id = m.source_id and (s.watermark is null or s.watermark < m.stamp)
"""
HOLD_REGIONS = "select semap.lock_regions_shared()"
"""Before rows: who deletes the map or the source holds the regions when it comes to the recording's row."""
COUNT_RESULTS = """
    update semap.recording set states_done = %s, finished_at = case when %s then clock_timestamp() end
    where recording_id = %s
"""
IS_THERE = "select from semap.recording where recording_id = %s"
END_SOURCES = "update semap.source set ended = true where source_id = any (%s)"
MIDDLE_M = 0.9
"""Height of the middle of a person's body over the floor: within the height band of the room it stands in."""


class Writer:
    """Mutable: the ids of tracks that are known, and the days that have their partitions."""

    def __init__(
        self, connection: psycopg.Connection, registered: Registered, source: str, floor_z_m: float
    ) -> None:
        self._connection = connection
        self._registered = registered
        self._source = persons_source(source)
        self._middle_m = floor_z_m + MIDDLE_M
        self._ids: dict[int, int] = {}
        self._days: set[int] = set()

    def commit(self, batch: Sequence[Found], done: int, *, is_over: bool = False) -> None:
        """Write a batch in one transaction.

        done     results of the recording that are in with it
        is_over  nothing more is to come: rules do not wait for these sources
        raises   NotFound where the source was deleted meanwhile
        """
        states = [each.states for found in batch for each in found.persons]
        lines = [each for found in batch for each in found.lines if len(each.lines)]
        self._make_partitions(
            [*(each.stamp_us for each in states if len(each)), *(each.lines.stamp_us for each in lines)]
        )
        try:
            self._learn_tracks(states)
            with _at_one_go(self._connection) as cursor:
                cursor.execute(HOLD_REGIONS)
                counted = self._connection.execute(
                    COUNT_RESULTS, [done, is_over, self._registered.recording_id]
                )
                self._write_states(cursor, states)
                self._write_lines(cursor, lines)
                self._move_watermarks(cursor, batch)
                if is_over:
                    self._end_sources(cursor)
            is_there = counted.rowcount > 0
        except Conflict:
            is_there = self._is_there()
            if is_there:
                raise
        if not is_there:
            raise NotFound("source", f"{self._source} any more", "It was deleted: give the command again.")

    def _is_there(self) -> bool:
        with translated(), self._connection.transaction():
            found = self._connection.execute(IS_THERE, [self._registered.recording_id]).fetchone()
        return found is not None

    def end_sources(self) -> None:
        """Let rules not wait for these sources, though the recording is not over."""
        with translated(), self._connection.transaction(), self._connection.cursor() as cursor:
            self._end_sources(cursor)

    def _end_sources(self, cursor: psycopg.Cursor) -> None:
        cursor.execute(END_SOURCES, [[self._registered.persons_id, self._registered.lines_id]])

    def _write_states(self, cursor: psycopg.Cursor, states: Sequence[TrackStates]) -> None:
        # at the moment at which that turned out: the one at which they were seen last may be past already
        ended = [(self._ids[track], to_datetime(each.stamp_us)) for each in states for track, _ in each.ended]
        amendments = [one for each in states for one in each.amendments]
        seen = [each for each in states if len(each)]
        if seen:
            values = {name: each.tolist() for name, each in columns_of(seen, self._middle_m).items()}
            statement = ADD_STATES.format(
                names=", ".join(values),
                known=", ".join(f"nullif({name}, 'NaN')" for name in values),
                arrays=", ".join(
                    "%s::float8[]" if name in COORDINATES else "%s::float4[]" for name in values
                ),
            )
            cursor.execute(statement, [*self._keys(seen), *values.values()])
        if ended:
            cursor.execute(
                END_TRACKS,
                [
                    self._registered.persons_id,
                    [track_id for track_id, _ in ended],
                    [stamp for _, stamp in ended],
                ],
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

    def _learn_tracks(self, states: Sequence[TrackStates]) -> None:
        """Learn the ids of tracks; those that are not there yet are made, which by itself tells nothing."""
        numbers = {
            *(int(track) for each in states for track in each.track),
            *(track for each in states for track, _ in each.ended),
            *(track for each in states for one in each.amendments for track in (one.track, one.other)),
        }
        new = sorted(numbers - self._ids.keys())
        if not new:
            return
        names = [f"person {track}" for track in new]
        uids = [track_uid(self._registered.map_uid, self._source, name) for name in names]
        with translated(), self._connection.transaction(), self._connection.cursor() as cursor:
            cursor.execute(ADD_TRACKS, [self._registered.persons_id, self._registered.map_id, uids, names])
            cursor.execute(FIND_TRACKS, [self._registered.persons_id, names])
            ids: dict[str, int] = dict(cursor.fetchall())
        self._ids.update((track, ids[name]) for track, name in zip(new, names, strict=True))

    def _keys(self, states: Sequence[TrackStates]) -> tuple[list[int], list[datetime]]:
        """Ids of the tracks, and stamps."""
        return (
            [self._ids[int(track)] for each in states for track in each.track],
            _repeated([to_datetime(each.stamp_us) for each in states], [len(each) for each in states]),
        )

    def _write_lines(self, cursor: psycopg.Cursor, found: Sequence[LinesAt]) -> None:
        if not found:
            return
        ends = np.concatenate([each.lines.ends_m for each in found]).reshape(-1, 4)
        counts = [len(each.lines) for each in found]
        cursor.execute(
            ADD_LINES,
            [
                self._registered.lines_id,
                _repeated([to_datetime(each.lines.stamp_us) for each in found], counts),
                *(ends[:, column].tolist() for column in range(4)),
                _repeated([each.z_m for each in found], counts),
                np.concatenate([each.lines.angle_std_rad for each in found]).tolist(),
                np.concatenate([each.lines.offset_std_m for each in found]).tolist(),
                np.concatenate([each.lines.points for each in found]).tolist(),
            ],
        )

    def _move_watermarks(self, cursor: psycopg.Cursor, batch: Sequence[Found]) -> None:
        marks_us = {
            self._registered.persons_id: [found.persons_watermark_us for found in batch],
            self._registered.lines_id: [found.lines_watermark_us for found in batch],
        }
        latest = {
            source_id: to_datetime(max(mark for mark in marks if mark is not None))
            for source_id, marks in marks_us.items()
            if any(mark is not None for mark in marks)
        }
        if latest:
            cursor.execute(MOVE_WATERMARKS, [list(latest), list(latest.values())])

    def _make_partitions(self, stamps_us: Sequence[int]) -> None:
        days = {day_of(stamp_us).toordinal(): day_of(stamp_us) for stamp_us in stamps_us}
        new = [day for number, day in days.items() if number not in self._days]
        if new:
            with translated(), self._connection.transaction():
                self._connection.execute("select semap.ensure_partitions(%s::date[])", [new])
            self._days |= days.keys()


@contextmanager
def _at_one_go(connection: psycopg.Connection) -> Iterator[psycopg.Cursor]:
    """A transaction whose statements are sent without waiting for their answers: what they cost is one way
    to the server and back, however many they are."""
    with translated():
        try:
            with connection.pipeline(), connection.transaction(), connection.cursor() as cursor:
                yield cursor
        except psycopg.Error:
            with suppress(psycopg.Error):  # it may be gone
                connection.rollback()
            raise


def _repeated(values: Sequence[T], counts: Sequence[int]) -> list[T]:
    return [value for value, count in zip(values, counts, strict=True) for _ in range(count)]


def columns_of(states: Sequence[TrackStates], middle_m: float) -> dict[str, NDArray[np.float64]]:
    """The columns of a state that perception knows, by name; NaN: not of this one.

    middle_m  height of the middle of a person's body
    """
    velocity = np.concatenate([each.velocity_mps for each in states])
    covariance = np.concatenate([each.covariance_m2 for each in states])
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    x_m, y_m = np.concatenate([each.position_m for each in states]).T
    length_m, width_m = np.concatenate([each.extent_m for each in states]).T
    return {
        "x_m": x_m,
        "y_m": y_m,
        "z_m": np.full(len(x_m), middle_m),
        **ellipses_of(xx, xy, yy)._asdict(),
        "heading_rad": np.concatenate([each.heading_rad for each in states]),
        "speed_mps": np.hypot(velocity[:, 0], velocity[:, 1]),
        "length_m": length_m,
        "width_m": width_m,
    }
