"""A rule worker in a thread, and the events that it wrote."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event as Signal
from threading import Thread
from unittest.mock import patch

import psycopg
from patience import moment

from semap.store.database.connection import connect
from semap.worker import rule_worker
from semap.worker.rule_worker import work

PATIENCE_S = 20.0
EVENTS = """
    select seq, event_id::text, type, cause, track_name, instance_name, stamp, since, rule_version
    from semap.event order by seq
"""


@contextmanager
def running_worker(dsn: str) -> Iterator[Thread]:
    """It commits and stops sooner than a worker at work, for whoever waits for it."""
    stop = Signal()
    thread = Thread(target=work, args=(dsn, stop), daemon=True)
    with patch.multiple(rule_worker, QUIET_COMMIT_S=0.05, RECEIVE_S=0.05):
        thread.start()
        try:
            yield thread
        finally:
            stop.set()
            thread.join(PATIENCE_S)
            assert not thread.is_alive()


def events(dsn: str) -> list[tuple]:
    with connect(dsn) as connection:
        return connection.execute(EVENTS).fetchall()


def await_events(dsn: str, count: int) -> list[tuple]:
    """All events as soon as there are `count`."""
    with connect(dsn) as connection:
        connection.execute("listen semap_event")
        deadline_s = time.monotonic() + PATIENCE_S
        while (there := _count(connection)) < count:
            assert time.monotonic() < deadline_s, f"only {there} of {count} events came"
            next(iter(connection.notifies(timeout=0.5, stop_after=1)), None)
        assert there == count
    return events(dsn)


def await_event_of(dsn: str, track: str, kind: str) -> list[tuple]:
    """All events as soon as there is one of this track and type."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not any(row[2] == kind and row[4] == track for row in events(dsn)):
        assert time.monotonic() < deadline_s
        moment()
    return events(dsn)


def await_events_of(dsn: str, map_id: int, count: int) -> list[tuple]:
    """Id, type, stamp and names of the events of a map as soon as there are `count`, in their order."""
    deadline_s = time.monotonic() + PATIENCE_S
    with connect(dsn) as connection:
        while True:
            rows = connection.execute(
                "select event_id, type, cause, stamp, since, track_name, instance_name from semap.event"
                " where map_id = %s order by seq", [map_id],
            ).fetchall()  # fmt: skip
            if len(rows) >= count:
                return rows
            assert time.monotonic() < deadline_s
            moment()


def await_progress(dsn: str) -> None:
    """Until the worker has committed everything that is in the log now."""
    with connect(dsn) as connection:
        (end,) = connection.execute("select pg_current_wal_insert_lsn()::text").fetchone()
        # a change of its own at the end, so that there is something to commit after all others
        connection.execute("update semap.source set idle = idle")
        deadline_s = time.monotonic() + PATIENCE_S
        while not connection.execute(
            "select lsn >= %s::pg_lsn from semap.progress where worker = 'rules'", [end]
        ).fetchone()[0]:
            assert time.monotonic() < deadline_s
            moment()


def lose_slot(dsn: str) -> None:
    """Drop the worker's slot, as soon as the server has noticed that the worker is gone."""
    deadline_s = time.monotonic() + PATIENCE_S
    with connect(dsn) as connection:
        while connection.execute(
            "select active from pg_replication_slots where slot_name = semap.rule_slot()"
        ).fetchone()[0]:
            assert time.monotonic() < deadline_s
            moment()
        connection.execute("select pg_drop_replication_slot(semap.rule_slot())")


def _count(connection: psycopg.Connection) -> int:
    row = connection.execute("select count(*) from semap.event").fetchone()
    assert row is not None
    return row[0]
