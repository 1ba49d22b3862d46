"""The rows that a recording writes to: two sources and the recording, held by one process at a time."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Event as Signal
from uuid import UUID

import psycopg

from semap.errors import Conflict, NotFound
from semap.store.database import translated

LOCK = 7368
"""First key of the advisory lock that keeps a second process from the same source."""
TRIES = 50
RETRY_S = 0.1
"""The server may take a while to see that a process is gone and to let go of its lock."""


@dataclass(frozen=True)
class Registered:
    """done  results of the recording that have been committed"""

    map_id: int
    map_uid: UUID
    persons_id: int
    lines_id: int
    recording_id: int
    done: int
    finished: bool


def persons_source(source: str) -> str:
    return f"{source}/persons"


def lines_source(source: str) -> str:
    return f"{source}/lines"


def register(
    connection: psycopg.Connection, map_name: str, source: str, path: str, fingerprint: str, stop: Signal
) -> Registered:
    """Make the two sources and the recording, where they are missing, and hold them as long as the connection
    lasts.

    raises  NotFound where there is no such map; Conflict where the source has tracks of another recording, or
            another process holds it
    """
    with translated(), connection.transaction():
        row = connection.execute("select map_id, uid from semap.map where name = %s", [map_name]).fetchone()
        if row is None:
            raise NotFound("map", map_name, "List them: semap map list")
        map_id, map_uid = row
        persons_id, lines_id = (
            _source(connection, map_id, name) for name in (persons_source(source), lines_source(source))
        )
    _hold(connection, persons_id, source, stop)
    # read when no other process writes any more
    with translated(), connection.transaction():
        _require_no_other(connection, persons_id, source, fingerprint)
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


def _hold(connection: psycopg.Connection, persons_id: int, source: str, stop: Signal) -> None:
    for _ in range(TRIES):
        with translated(), connection.transaction():
            (is_held,) = _row(connection, "select pg_try_advisory_lock(%s, %s)", [LOCK, persons_id])
        if is_held:
            return
        if stop.wait(RETRY_S):
            break
    raise Conflict(
        f"Another process is bringing in a recording as the source {source}.",
        "Wait until it is done, or end it.",
    )


def _require_no_other(connection: psycopg.Connection, persons_id: int, source: str, fingerprint: str) -> None:
    """One of which nothing was found is no other."""
    row = connection.execute(
        "select path from semap.recording where source_id = %s and fingerprint <> %s and states_done > 0",
        [persons_id, fingerprint],
    ).fetchone()
    if row is not None:
        raise Conflict(
            f"The source {source} has the tracks of another recording already, or of the same one looked at"
            f" in another way: {row[0]}",
            "Give this one a source of its own (--source NAME).",
        )


def _source(connection: psycopg.Connection, map_id: int, name: str) -> int:
    connection.execute(
        "insert into semap.source (map_id, name, watermark) values (%s, %s, '-infinity')"
        " on conflict (map_id, name) do nothing",
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
