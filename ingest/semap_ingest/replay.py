"""Writes tracks to the database, in batches, as fast as they go or at the pace of the recording.

A batch is one transaction: its states by COPY, the tracks that end with it, the watermark of its
source, and how far the recording has come. After a crash, or when the server was away, the replay
goes on after the last batch that was committed; nothing is lost or written twice.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from threading import Event as Signal
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray
from psycopg.types.json import Jsonb

from semap.errors import Conflict, InvalidInput, ServerUnavailable
from semap.geometry.error_ellipse import Ellipses, turned
from semap.geometry.pose import transform_points
from semap.store.database.backoff import Patience
from semap.store.database.connection import connect, one_transaction, translated
from semap.store.database.name import require_plain_name
from semap.store.map.placement import map_from_named_frame
from semap.store.motion.tracks import described
from semap.timeline.stamp import DAY_US, day_of, to_datetime
from semap_ingest.standing import Plan, Standing, look_up, stored_already, track_uid
from semap_ingest.state_batch import state_writer
from semap_ingest.track_file import REACH_M, Tracks

__all__ = ["Plan", "Replayed", "in_map_frame", "replay", "track_uid"]

log = logging.getLogger(__name__)

ROLE = "semap_ingest"
LARGE_FRAME = 200
"""So many tracks at one stamp are cheaper together than among others."""

Advance = Callable[[int, int], None]
"""Called with the states done and the states in all."""


@dataclass(frozen=True)
class Replayed:
    """What a replay did; `resumed_at` states had been written before."""

    states: int
    tracks: int
    resumed_at: int
    late: int


@dataclass(frozen=True)
class _Registered:
    recording_id: int
    source_id: int
    track_ids: NDArray[np.int64]
    done: int


def replay(
    dsn: str,
    plan: Plan,
    tracks: Tracks,
    advance: Advance = lambda done, total: None,
    stop: Signal | None = None,
) -> Replayed:
    """Write all states that are not written yet; a lost server is awaited.

    What is refused leaves no trace: the source and its tracks are made with the first states.

    raises NotFound, where there is no such map; InvalidInput, where there is no such concept or the
    attributes do not follow its schema; Conflict, where other states of these tracks are stored at the same
    stamps, or a track goes on at another source
    """
    require_plain_name(plan.source, "--source")
    concept_id = _concept_id(dsn, plan)
    stop = stop or Signal()
    clock = _Clock(plan.realtime)
    first: Standing | None = None
    patience = Patience(log, "states wait")
    while True:
        try:
            with connect(dsn, ROLE, application="semap ingest", autocommit=False) as connection:
                standing = look_up(connection, plan, tracks)
                first = first or standing
                _prepare(connection, plan, tracks, standing, concept_id)
                written = standing.done
                for written in _write(connection, plan, tracks, concept_id, clock, stop):
                    patience.restored()
                    advance(written, len(tracks))
                late = _late(connection, standing.map_id, plan.source) - first.late
                return Replayed(written - first.done, len(tracks.names), first.done, late)
        except ServerUnavailable as error:
            if first is None or patience.wait(error, stop):
                raise


def in_map_frame(dsn: str, map_name: str, frame: str, tracks: Tracks) -> Tracks:
    """The same tracks with positions in the map's frame; a state without a height has z 0 in `frame`.

    raises NotFound, where there is no such frame; InvalidInput, where it lies too far away
    """
    with one_transaction(dsn, ROLE, application="semap ingest") as connection:
        matrix = map_from_named_frame(connection, map_name, frame)
    points = np.column_stack([tracks.x_m, tracks.y_m, np.nan_to_num(tracks.z_m)])
    x_m, y_m, z_m = transform_points(matrix, points).T
    if max(np.abs(each).max(initial=0.0) for each in (x_m, y_m, z_m)) > REACH_M:
        raise InvalidInput(
            f"in the map its places lie beyond the {REACH_M:,.0f} m from the origin that semap holds",
            "Check the pose of the frame, and --unit.",
            f"--frame {frame}",
        )
    ellipses = turned(Ellipses(tracks.std_m, tracks.std_across_m, tracks.std_yaw_rad), matrix[:2, :2])
    return replace(tracks, x_m=x_m, y_m=y_m, z_m=z_m, **ellipses._asdict())


def _concept_id(dsn: str, plan: Plan) -> int | None:
    """raises InvalidInput"""
    if plan.concept is None:
        return None
    with one_transaction(dsn, ROLE, application="semap ingest") as connection:
        return described(connection, f"a track of {plan.source}", plan.concept, plan.attributes or {})


def _prepare(
    connection: psycopg.Connection, plan: Plan, tracks: Tracks, standing: Standing, concept_id: int | None
) -> None:
    """Make the partitions, and describe the tracks that are there; each by itself."""
    days = [day_of(int(day) * DAY_US) for day in np.unique(tracks.stamp_us // DAY_US)]
    with translated(), connection.transaction():
        connection.execute("select semap.ensure_partitions(%s::date[])", [days])
    if standing.source_id is not None:
        with translated(), connection.transaction():
            _describe(connection, plan, standing.source_id, tracks, concept_id)


def _register(
    connection: psycopg.Connection, plan: Plan, tracks: Tracks, concept_id: int | None
) -> _Registered:
    """Make the source, the recording and its tracks, where they are missing, within a transaction."""
    connection.execute("select semap.lock_regions_shared()")
    map_id, map_uid = _one(connection, "select map_id, uid from semap.map where name = %s", [plan.map_name])
    connection.execute(
        "insert into semap.source (map_id, name, watermark) values (%s, %s, '-infinity')"
        " on conflict (map_id, name) do nothing",
        [map_id, plan.source],
    )
    (source_id,) = _one(
        connection,
        "select source_id from semap.source where map_id = %s and name = %s",
        [map_id, plan.source],
    )
    connection.execute("select semap.lock_source(%s)", [source_id])
    connection.execute(
        "insert into semap.recording (source_id, fingerprint, path, states_total) values (%s, %s, %s, %s)"
        " on conflict (source_id, fingerprint) do nothing",
        [source_id, plan.fingerprint, plan.path, len(tracks)],
    )
    recording_id, done = _one(
        connection,
        "select recording_id, states_done from semap.recording where source_id = %s and fingerprint = %s",
        [source_id, plan.fingerprint],
    )
    uids = [track_uid(map_uid, plan.source, name) for name in tracks.names]
    connection.execute(
        "insert into semap.track (uid, source_id, map_id, name, concept_id, attributes)"
        " select uid, %s, %s, name, %s, coalesce(%s::jsonb, '{}')"
        " from unnest(%s::uuid[], %s::text[]) t (uid, name) on conflict do nothing",
        [source_id, map_id, concept_id, _attributes(plan), uids, list(tracks.names)],
    )
    rows = connection.execute(
        "select name, track_id from semap.track where source_id = %s and name = any (%s)",
        [source_id, list(tracks.names)],
    ).fetchall()
    ids: dict[str, int] = dict(rows)
    if len(ids) < len(tracks.names):
        raise Conflict(f"Tracks of the source {plan.source} are handed over just now.", "Try again.")
    track_ids = np.array([ids[name] for name in tracks.names], dtype=np.int64)
    return _Registered(recording_id, source_id, track_ids, done)


def _attributes(plan: Plan) -> Jsonb | None:
    return None if plan.attributes is None else Jsonb(dict(plan.attributes))


def _describe(
    connection: psycopg.Connection, plan: Plan, source_id: int, tracks: Tracks, concept_id: int | None
) -> None:
    """Say of new tracks and of those that are there what the plan says of all."""
    if concept_id is None and plan.attributes is None:
        return
    connection.execute(
        "update semap.track set concept_id = coalesce(%(concept)s, concept_id),"
        " attributes = coalesce(%(attributes)s, attributes)"
        " where source_id = %(source)s and name = any (%(names)s)"
        " and (concept_id, attributes) is distinct from"
        " (coalesce(%(concept)s, concept_id), coalesce(%(attributes)s, attributes))",
        {
            "concept": concept_id,
            "attributes": _attributes(plan),
            "source": source_id,
            "names": list(tracks.names),
        },
    )


def _write(
    connection: psycopg.Connection,
    plan: Plan,
    tracks: Tracks,
    concept_id: int | None,
    clock: _Clock,
    stop: Signal,
) -> Iterator[int]:
    """Write batch after batch; yields the states done after each commit."""
    is_last = np.zeros(len(tracks), dtype=np.bool_)
    if not plan.keep_open:
        is_last[len(tracks) - 1 - np.unique(tracks.track[::-1], return_index=True)[1]] = True
    registered: _Registered | None = None
    done = 0
    while done < len(tracks) and not stop.is_set():
        due = clock.due(tracks.stamp_us, done, stop) if registered else 0
        with translated(), connection.transaction(), connection.cursor() as cursor:
            if registered is None:
                registered = _register(connection, plan, tracks, concept_id)
                done = registered.done
                if done == len(tracks):
                    return
                due = clock.due(tracks.stamp_us, done, stop)
            rows = _next_batch(tracks, done, plan.batch_size, due)
            _store(cursor, plan, tracks, registered, rows, is_last[rows])
        done = rows.stop
        yield done


def _next_batch(tracks: Tracks, done: int, batch_size: int, due: int) -> slice:
    """What comes after `done`, of what is due; a large frame is a batch by itself, and is not cut."""
    same_stamp = int(np.searchsorted(tracks.stamp_us, tracks.stamp_us[done], side="right"))
    if same_stamp - done >= LARGE_FRAME and same_stamp <= due:
        return slice(done, same_stamp)
    return slice(done, min(done + batch_size, due))


def _writer(
    tracks: Tracks, registered: _Registered, rows: slice, is_last: NDArray[np.bool_]
) -> Callable[[psycopg.Cursor], None]:
    """What writes these states."""
    std_m, across_m, yaw_rad = (
        each[rows] for each in (tracks.std_m, tracks.std_across_m, tracks.std_yaw_rad)
    )
    ellipse = {} if np.isnan(across_m).all() else {"std_across_m": across_m, "std_yaw_rad": yaw_rad}
    return state_writer(
        registered.source_id,
        registered.track_ids[tracks.track[rows]],
        tracks.stamp_us[rows],
        tracks.x_m[rows],
        tracks.y_m[rows],
        tracks.z_m[rows],
        is_last,
        std_m=std_m,
        **ellipse,
    )


def _watermark_us(tracks: Tracks, done: int) -> int:
    """Up to where no state is still to come."""
    return int(tracks.stamp_us[-1] if done == len(tracks) else tracks.stamp_us[done] - 1)


def _store(
    cursor: psycopg.Cursor,
    plan: Plan,
    tracks: Tracks,
    registered: _Registered,
    rows: slice,
    is_last: NDArray[np.bool_],
) -> None:
    """One batch, how far the recording has come with it, and the watermark of its source."""
    try:
        _writer(tracks, registered, rows, is_last)(cursor)
    except psycopg.errors.UniqueViolation as error:
        raise stored_already(plan, error.diag.message_detail or "") from error
    cursor.execute(
        "update semap.recording set states_done = %s,"
        " finished_at = case when %s = states_total then clock_timestamp() end where recording_id = %s",
        [rows.stop, rows.stop, registered.recording_id],
    )
    # after the last, nothing more is to come of the source for now: rules do not wait for it
    is_over = rows.stop == len(tracks) and not plan.keep_open
    cursor.execute(
        "update semap.source set watermark = greatest(watermark, %s) where source_id = %s",
        [to_datetime(_watermark_us(tracks, rows.stop)), registered.source_id],
    )
    if is_over:
        cursor.execute("update semap.source set ended = true where source_id = %s", [registered.source_id])


def _late(connection: psycopg.Connection, map_id: int, source: str) -> int:
    with translated(), connection.transaction():
        (late,) = _one(
            connection,
            "select late_states from semap.source where map_id = %s and name = %s",
            [map_id, source],
        )
    return int(late)


def _one(connection: psycopg.Connection, statement: str, parameters: list[object]) -> tuple[Any, ...]:
    row = connection.execute(statement, parameters).fetchone()
    if row is None:
        raise InvalidInput(f"No row for {statement}", "This is a fault of semap; please report it.")
    return tuple(row)


class _Clock:
    """Which states are due. At a pace, the first state is due at once and the rest follow it."""

    def __init__(self, realtime: float | None) -> None:
        self._realtime = realtime
        self._started_s: float | None = None
        self._first_us = 0

    def due(self, stamp_us: NDArray[np.int64], done: int, stop: Signal) -> int:
        """How many states from the front are due; waits for the next one where none is."""
        if self._realtime is None:
            return len(stamp_us)
        if self._started_s is None:
            self._started_s, self._first_us = time.monotonic(), int(stamp_us[done])
        next_s = (int(stamp_us[done]) - self._first_us) / 1e6 / self._realtime
        wait_s = self._started_s + next_s - time.monotonic()
        if wait_s > 0:
            stop.wait(wait_s)
        now_us = self._first_us + (time.monotonic() - self._started_s) * 1e6 * self._realtime
        return max(int(np.searchsorted(stamp_us, now_us, side="right")), done + 1)
