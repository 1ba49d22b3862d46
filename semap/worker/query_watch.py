"""A continuous query as a live table: what holds, and then each change of it, none missed and none twice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

import psycopg

from semap.model.relation import Amendment, Cause, Direction, Kind
from semap.replication.pgoutput import Change
from semap.replication.snapshot import begin_at_snapshot
from semap.replication.stream import start
from semap.store.database.connection import connect, translated
from semap.timeline.stamp import parse_stamp, to_datetime

PUBLICATIONS = ("semap_change",)
HOLDS = """
    select track_id, track, subject_instance_id, subject_instance, instance_id, instance, object_track_id,
           object_track, since
    from semap.relation_now where query_id = %s
    order by object, subject, track_id, subject_instance_id
"""


@dataclass(frozen=True)
class Delta:
    """A relation that holds (`kind` None), or that began or ended, or a line that was crossed.

    The subject is a track or an instance, the object an instance or a track.

    at         when the boundary was crossed; of one that holds, since when
    known      when that was known; None of one that holds
    x_m, y_m   where it was crossed, if that is known [m, map frame]
    direction  of a line that was crossed, seen along it
    door       by which it came in or went out, if that is known
    amendment  of a change of the past, since states came late: it is `added`, or what was told is
               `retracted`
    """

    kind: Kind | None
    cause: Cause | None
    track_id: int | None
    track: str | None
    subject_instance_id: int | None
    subject_instance: str | None
    instance_id: int | None
    instance: str | None
    object_track_id: int | None
    object_track: str | None
    at: datetime
    known: datetime | None = None
    x_m: float | None = None
    y_m: float | None = None
    direction: Direction | None = None
    door: str | None = None
    amendment: Amendment | None = None

    @property
    def subject(self) -> str:
        """The name of the subject, whichever kind it is."""
        return self.track or self.subject_instance or ""

    @property
    def object(self) -> str:
        """The name of the object, whichever kind it is."""
        return self.instance or self.object_track or ""


def watch_query(dsn: str, query_id: int, patience_s: float = 0.5) -> Iterator[Delta | None]:
    """What holds, then None, then each change as it is committed; None again where nothing came for a while.

    raises  ServerUnavailable when the server is gone: what follows is unknown then
    """
    beginning = begin_at_snapshot(dsn, "watch")
    try:
        yield from _held(dsn, beginning.snapshot, query_id)
        yield None
        stream = start(beginning.connection, beginning.slot, PUBLICATIONS, beginning.lsn)
        while True:
            transactions = stream.receive(patience_s)
            for transaction in transactions:
                yield from (_delta(each) for each in transaction.changes if _is_of(each, query_id))
                stream.acknowledge(transaction.end_lsn)
            if not transactions:
                yield None
    finally:
        beginning.connection.finish()


def _held(dsn: str, snapshot: str, query_id: int) -> list[Delta]:
    with connect(dsn, "semap_read", application="semap watch", autocommit=False) as connection, translated():
        connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        connection.execute(psycopg.sql.SQL("set transaction snapshot {}").format(snapshot))
        return [Delta(None, None, *row) for row in connection.execute(HOLDS, [query_id])]


def _is_of(change: Change, query_id: int) -> bool:
    return (
        change.table == "relation_change"
        and change.operation == "insert"
        and change.row["query_id"] == str(query_id)
    )


def _delta(change: Change) -> Delta:
    row = change.row

    def stamp(column: str) -> datetime:
        return to_datetime(parse_stamp(row[column] or ""))

    def number(column: str) -> int | None:
        text = row[column]
        return None if text is None else int(text)

    def metres(column: str) -> float | None:
        text = row[column]
        return None if text is None else float(text)

    return Delta(
        row["kind"],  # type: ignore[arg-type]
        row["cause"],  # type: ignore[arg-type]
        number("track_id"),
        row["track_name"],
        number("subject_instance_id"),
        row["subject_instance_name"],
        number("instance_id"),
        row["instance_name"],
        number("object_track_id"),
        row["object_track_name"],
        stamp("transition_at"),
        stamp("stamp"),
        metres("x_m"),
        metres("y_m"),
        row["direction"],  # type: ignore[arg-type]
        row["door_name"],
        row.get("amendment"),  # type: ignore[arg-type]
    )
