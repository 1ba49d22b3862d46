"""Writes tracks to the database, in batches, as fast as they go or at the pace of the recording.

A batch is one transaction: its states by COPY, the tracks that end with it, the watermark of its
source, and how far the recording has come. After a crash, or when the server was away, the replay
goes on after the last batch that was committed; nothing is lost or written twice.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from threading import Event as Signal
from uuid import UUID, uuid5

import numpy as np
import psycopg
from numpy.typing import NDArray
from psycopg.types.json import Jsonb

from semap.errors import Conflict, InvalidInput, NotFound, ServerUnavailable
from semap.geometry.error_ellipse import Ellipses, turned
from semap.geometry.pose import transform_points
from semap.store.database import connect, one_transaction, translated
from semap.store.placement import map_from_named_frame
from semap.store.tracks import described
from semap.timeline.stamp import DAY_US, day_of, to_datetime
from semap_ingest.state_copy import COLUMNS, ELLIPSE_COLUMNS, copy_rows, pack_states
from semap_ingest.state_frame import insert_frame, pack_frame
from semap_ingest.track_file import Tracks

ROLE = "semap_ingest"
COPY_STATES = f"copy semap.track_state ({', '.join(COLUMNS)}) from stdin (format binary)"
COPY_ELLIPSES = f"copy semap.track_state ({', '.join(COLUMNS + ELLIPSE_COLUMNS)}) from stdin (format binary)"
FIND_TRACKS = """
    select k.name, k.track_id, case when k.source_id <> %s then n.name end
    from semap.track k join semap.source n using (source_id)
    where k.source_id = %s and k.name = any (%s) or k.uid = any (%s)
"""
"""Tracks of a source by name, and those that it handed over to another one, with that one's name."""
LARGE_FRAME = 200
"""So many tracks at one stamp are cheaper together than among others."""

FIRST_RETRY_S = 0.05
LAST_RETRY_S = 2.0

Advance = Callable[[int, int], None]
"""Called with the states done and the states in all."""


@dataclass(frozen=True)
class Plan:
    """What to replay, and how.

    realtime   1 is the pace of the recording, 2 twice as fast; None: as fast as it goes
    keep_open  leave the tracks open at their last state, for another file that goes on with them
    concept    what kind of thing each track is; None: what is known of it stays
    attributes of each track; None: likewise
    """

    map_name: str
    source: str
    path: str
    fingerprint: str
    batch_size: int = 1000
    realtime: float | None = None
    keep_open: bool = False
    concept: str | None = None
    attributes: Mapping[str, object] | None = None


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
    late: int


def replay(
    dsn: str,
    plan: Plan,
    tracks: Tracks,
    advance: Advance = lambda done, total: None,
    stop: Signal | None = None,
) -> Replayed:
    """Write all states that are not written yet; a lost server is awaited.

    raises NotFound, where there is no such map; InvalidInput, where there is no such concept or the
    attributes do not follow its schema; Conflict, where other states of these tracks are stored at the same
    stamps, or a track goes on at another source
    """
    concept_id = _concept_id(dsn, plan)
    stop = stop or Signal()
    clock = _Clock(plan.realtime)
    first: _Registered | None = None
    wait_s = FIRST_RETRY_S
    while True:
        try:
            with connect(dsn, ROLE, application="semap ingest", autocommit=False) as connection:
                registered = _register(connection, plan, tracks, concept_id)
                first = first or registered
                written = registered.done
                for written in _write(connection, plan, tracks, registered, clock, stop):
                    wait_s = FIRST_RETRY_S
                    advance(written, len(tracks))
                late = _late(connection, registered.source_id) - first.late
                return Replayed(written - first.done, len(tracks.names), first.done, late)
        except ServerUnavailable:
            if stop.wait(wait_s) or first is None:
                raise
            wait_s = min(wait_s * 2, LAST_RETRY_S)


def in_map_frame(dsn: str, map_name: str, frame: str, tracks: Tracks) -> Tracks:
    """The same tracks with positions in the map's frame; a state without a height has z 0 in `frame`.

    raises NotFound, where there is no such frame
    """
    with one_transaction(dsn, ROLE, application="semap ingest") as connection:
        matrix = map_from_named_frame(connection, map_name, frame)
    points = np.column_stack([tracks.x_m, tracks.y_m, np.nan_to_num(tracks.z_m)])
    x_m, y_m, z_m = transform_points(matrix, points).T
    ellipses = turned(Ellipses(tracks.std_m, tracks.std_across_m, tracks.std_yaw_rad), matrix[:2, :2])
    return replace(tracks, x_m=x_m, y_m=y_m, z_m=z_m, **ellipses._asdict())


def _concept_id(dsn: str, plan: Plan) -> int | None:
    """raises InvalidInput"""
    if plan.concept is None:
        return None
    with one_transaction(dsn, ROLE, application="semap ingest") as connection:
        return described(connection, f"a track of {plan.source}", plan.concept, plan.attributes or {})


def _register(
    connection: psycopg.Connection, plan: Plan, tracks: Tracks, concept_id: int | None
) -> _Registered:
    """Make the partitions, the source, the recording and its tracks, where they are missing."""
    days = [day_of(int(day) * DAY_US) for day in np.unique(tracks.stamp_us // DAY_US)]
    with translated(), connection.transaction():
        connection.execute("select semap.ensure_partitions(%s::date[])", [days])
    with translated(), connection.transaction():
        row = connection.execute(
            "select map_id, uid from semap.map where name = %s", [plan.map_name]
        ).fetchone()
        if row is None:
            raise NotFound("map", plan.map_name, "List them: semap map list")
        map_id, map_uid = row
        connection.execute(
            "insert into semap.source (map_id, name, watermark) values (%s, %s, '-infinity')"
            " on conflict (map_id, name) do nothing",
            [map_id, plan.source],
        )
        source_id, late = _one(
            connection,
            "select source_id, late_states from semap.source where map_id = %s and name = %s for update",
            [map_id, plan.source],
        )
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
            "insert into semap.track (uid, source_id, map_id, name)"
            " select uid, %s, %s, name from unnest(%s::uuid[], %s::text[]) as track (uid, name)"
            " on conflict do nothing",
            [source_id, map_id, uids, list(tracks.names)],
        )
        rows = connection.execute(FIND_TRACKS, [source_id, source_id, list(tracks.names), uids]).fetchall()
        ids: dict[str, int] = {name: track_id for name, track_id, _ in rows}
    elsewhere = {name: other for name, _, other in rows if other is not None}
    for name in (tracks.names[number] for number in np.unique(tracks.track[done:]) if elsewhere):
        if name in elsewhere:
            raise Conflict(
                f"The track {name} of the source {plan.source} was handed over to {elsewhere[name]}.",
                f"Bring in what else is known of it as the source {elsewhere[name]}.",
            )
    # by itself, since it keeps all others out before it locks a row
    with translated(), connection.transaction():
        _describe(connection, plan, source_id, tracks, concept_id)
    track_ids = np.array([ids[name] for name in tracks.names], dtype=np.int64)
    return _Registered(recording_id, source_id, track_ids, done, late)


def _describe(
    connection: psycopg.Connection, plan: Plan, source_id: int, tracks: Tracks, concept_id: int | None
) -> None:
    """Say of new tracks and of those that are there what the plan says of all."""
    if concept_id is None and plan.attributes is None:
        return
    given = None if plan.attributes is None else Jsonb(dict(plan.attributes))
    connection.execute(
        "update semap.track set concept_id = coalesce(%(concept)s, concept_id),"
        " attributes = coalesce(%(attributes)s, attributes)"
        " where source_id = %(source)s and name = any (%(names)s)"
        " and (concept_id, attributes) is distinct from"
        " (coalesce(%(concept)s, concept_id), coalesce(%(attributes)s, attributes))",
        {"concept": concept_id, "attributes": given, "source": source_id, "names": list(tracks.names)},
    )


def track_uid(map_uid: UUID, source: str, name: str) -> UUID:
    """The identity of a track: the same whenever its recording is replayed on a map of that name."""
    return uuid5(map_uid, f"{source}/{name}")


def _write(
    connection: psycopg.Connection,
    plan: Plan,
    tracks: Tracks,
    registered: _Registered,
    clock: _Clock,
    stop: Signal,
) -> Iterator[int]:
    """Write batch after batch; yields the states done after each commit."""
    is_last = np.zeros(len(tracks), dtype=np.bool_)
    if not plan.keep_open:
        is_last[len(tracks) - 1 - np.unique(tracks.track[::-1], return_index=True)[1]] = True
    done = registered.done
    while done < len(tracks) and not stop.is_set():
        rows = _next_batch(tracks, done, plan.batch_size, clock.due(tracks.stamp_us, done, stop))
        write = _writer(tracks, registered, rows, is_last[rows])
        is_over = rows.stop == len(tracks) and not plan.keep_open
        _commit(connection, plan, registered, write, rows.stop, _watermark_us(tracks, rows.stop), is_over)
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
    stamp_us = tracks.stamp_us[rows]
    track_ids = registered.track_ids[tracks.track[rows]]
    is_frame = len(stamp_us) > 1 and bool((stamp_us == stamp_us[0]).all()) and not is_last.any()
    # frames of the same tracks follow one another in the same order
    order = np.argsort(track_ids) if is_frame else np.arange(len(track_ids))
    x_m, y_m, z_m, std_m, across_m, yaw_rad = (
        each[rows][order]
        for each in (
            tracks.x_m, tracks.y_m, tracks.z_m, tracks.std_m, tracks.std_across_m, tracks.std_yaw_rad
        )
    )  # fmt: skip
    ellipse = None if np.isnan(across_m).all() else (across_m, yaw_rad)
    if is_frame:
        source_id, one_us = registered.source_id, int(stamp_us[0])
        frame = pack_frame(source_id, one_us, track_ids[order], x_m, y_m, z_m, std_m, ellipse=ellipse)
        return partial(insert_frame, row=frame)
    data = pack_states(track_ids, stamp_us, x_m, y_m, z_m, std_m, is_last, ellipse=ellipse)
    return partial(copy_rows, COPY_ELLIPSES if ellipse else COPY_STATES, data=data)


def _watermark_us(tracks: Tracks, done: int) -> int:
    """Up to where no state is still to come."""
    return int(tracks.stamp_us[-1] if done == len(tracks) else tracks.stamp_us[done] - 1)


def _commit(
    connection: psycopg.Connection,
    plan: Plan,
    registered: _Registered,
    write: Callable[[psycopg.Cursor], None],
    done: int,
    watermark_us: int,
    is_over: bool,
) -> None:
    """One batch, how far the recording has come with it, and the watermark of its source.

    is_over  nothing more is to come of the source for now: rules do not wait for it
    """
    with translated(), connection.transaction(), connection.cursor() as cursor:
        try:
            write(cursor)
        except psycopg.errors.UniqueViolation as error:
            raise Conflict(
                f"States of the source {plan.source} are stored already: {error.diag.message_detail}",
                "Give this recording a source of its own (--source NAME).",
            ) from error
        cursor.execute(
            "update semap.recording set states_done = %s,"
            " finished_at = case when %s = states_total then clock_timestamp() end where recording_id = %s",
            [done, done, registered.recording_id],
        )
        cursor.execute(
            "update semap.source set watermark = greatest(watermark, %s) where source_id = %s",
            [to_datetime(watermark_us), registered.source_id],
        )
        if is_over:
            cursor.execute(
                "update semap.source set ended = true where source_id = %s", [registered.source_id]
            )


def _late(connection: psycopg.Connection, source_id: int) -> int:
    with translated(), connection.transaction():
        (late,) = _one(connection, "select late_states from semap.source where source_id = %s", [source_id])
    return int(late)


def _one(connection: psycopg.Connection, statement: str, parameters: list[object]) -> tuple[int, ...]:
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
