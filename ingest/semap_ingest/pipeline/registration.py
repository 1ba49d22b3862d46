"""The rows that a recording writes to: two sources and the recording, held by one process at a time."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Event as Signal
from uuid import UUID

import psycopg

from semap.errors import Conflict, NotFound
from semap.store.database.connection import translated

LOCK = 7368
"""First key of the advisory lock that keeps a second process from the same source."""
TRIES = 50
RETRY_S = 0.1
"""The server may take a while to see that a process is gone and to let go of its lock."""
FIND_RECORDINGS = """
    select r.path, r.fingerprint, r.states_done, r.finished_at is not null
    from semap.recording r join semap.source s using (source_id) where s.map_id = %s and s.name = %s
"""


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


@dataclass(frozen=True)
class Found:
    """What is known of a recording before anything of it is written; done and finished as in `Registered`."""

    map_id: int
    map_uid: UUID
    done: int
    finished: bool


def look_up(
    connection: psycopg.Connection, map_name: str, source: str, fingerprint: str, stop: Signal
) -> Found:
    """Keep others from the source as long as the connection lasts, and see how far the recording is in.

    raises  NotFound where there is no such map; Conflict where the source has tracks of another recording, or
            another process holds it
    """
    with translated(), connection.transaction():
        row = connection.execute("select map_id, uid from semap.map where name = %s", [map_name]).fetchone()
    if row is None:
        raise NotFound("map", map_name, "List them: semap map list")
    map_id, map_uid = row
    _hold(connection, map_id, source, stop)
    # read when no other process writes any more
    with translated(), connection.transaction():
        rows = connection.execute(FIND_RECORDINGS, [map_id, persons_source(source)]).fetchall()
    for path, known, done, _ in rows:
        # one of which nothing was found is no other
        if known != fingerprint and done > 0:
            raise Conflict(
                f"The source {source} has the tracks of another recording already, or of the same one looked"
                f" at in another way: {path}",
                "Give this one a source of its own (--source NAME).",
            )
    own = next(((done, finished) for _, known, done, finished in rows if known == fingerprint), (0, False))
    return Found(map_id, map_uid, *own)


def register(
    connection: psycopg.Connection, found: Found, source: str, path: str, fingerprint: str
) -> Registered:
    """Make the two sources and the recording, where they are missing."""
    with translated(), connection.transaction():
        persons_id, lines_id = (
            _source(connection, found.map_id, name) for name in (persons_source(source), lines_source(source))
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
    return Registered(found.map_id, found.map_uid, persons_id, lines_id, recording_id, done, bool(finished))


def _hold(connection: psycopg.Connection, map_id: int, source: str, stop: Signal) -> None:
    for _ in range(TRIES):
        with translated(), connection.transaction():
            (is_held,) = _row(
                connection, "select pg_try_advisory_lock(%s, hashtext(%s) | 1)", [LOCK, f"{map_id}/{source}"]
            )
        if is_held:
            return
        if stop.wait(RETRY_S):
            break
    raise Conflict(
        f"Another process is bringing in a recording as the source {source}.",
        "Wait until it is done, or end it.",
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
