"""A continuous query as a live table: what holds, and then each change of it, none missed and none twice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

import psycopg

from semap.model.relation import Cause, Kind
from semap.replication.pgoutput import Change
from semap.replication.snapshot import begin_at_snapshot
from semap.replication.stream import start
from semap.store.database import connect, translated
from semap.timeline.stamp import parse_stamp, to_datetime

PUBLICATIONS = ("semap_change",)
HOLDS = """
    select n.track_id, t.name, n.instance_id, r.instance_name, n.since
    from semap.relation n join semap.region r using (region_id) join semap.track t using (track_id)
    where n.query_id = %s order by r.instance_name, t.name, n.track_id
"""


@dataclass(frozen=True)
class Delta:
    """A relation that holds (`kind` None), or that began or ended.

    at     when the boundary was crossed; of one that holds, since when
    known  when that was known; None of one that holds
    """

    kind: Kind | None
    cause: Cause | None
    track_id: int
    track: str
    instance_id: int
    instance: str
    at: datetime
    known: datetime | None = None


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

    return Delta(
        row["kind"],  # type: ignore[arg-type]
        row["cause"],  # type: ignore[arg-type]
        int(row["track_id"] or 0),
        row["track_name"] or "",
        int(row["instance_id"] or 0),
        row["instance_name"] or "",
        stamp("edge_at"),
        stamp("stamp"),
    )
