"""What keeps a database that grows in shape: partitions ahead, and what is old dropped.

All of it is done in short steps, each a transaction of its own, so that it may end at any moment and the next
time goes on. A step that needs a lock on a whole table waits for it only shortly, since everybody who comes
after waits as well; it tries again, and at last leaves it for the next time. The steps are functions of the
database (sql/144), which do nothing that the settings do not say.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import date
from threading import Event as Signal
from typing import Any

from sqlalchemy import Connection, TextClause, text

from semap.errors import InUse
from semap.store.database.connection import own_session, translated
from semap.store.operate.retention import WORDS, Kind

log = logging.getLogger(__name__)

ROLE = "semap_worker"
MAINTENANCE_LOCK = 7370
LOCK_MS = 200
PAUSE_S = 0.5
ATTEMPTS = 20
DAYS_AHEAD = 3
ROWS_AT_ONCE = 2000
TABLES: dict[str, Kind] = {"state_chunk": "states", "line_observation": "lines"}

AHEAD = text("""
    select array(
      select day from (select (clock_timestamp() at time zone 'UTC')::date + n as day
                       from generate_series(0, :days) n) ahead
      where exists (
        select from unnest(cast(:tables as text[])) t (name)
        where to_regclass(format('semap.%s_%s', name, to_char(day, 'YYYYMMDD'))) is null)
      order by day)
""")
MAKE = text("select semap.ensure_partitions(cast(:days as date[]))")
PAST = text("""
    select d.day, d.day < (semap.kept_since(:kind) at time zone 'UTC')::date
    from semap.day_partitions() d
    where d.of_table = :table and d.day < (clock_timestamp() at time zone 'UTC')::date order by d.day
""")
EMPTY = """
    select not exists (select from semap.{table} where {stamp} >= cast(:day as timestamptz)
                                                   and {stamp} < cast(:day as timestamptz) + interval '24 h')
"""
STAMPS = {"state_chunk": "from_stamp", "line_observation": "stamp"}
DROP_DAY = text("select semap.drop_day(:table, :day)")
DROP_ROWS = text("select semap.drop_rows(:kind, :most)")
DROP_REQUESTS = text("""
    with dropped as (
      delete from semap.query_request where answered_at < clock_timestamp() - interval '1 day' returning 1)
    select count(*) from dropped
""")
OLD_ROWS = text("""
    select kind, count(*)
    from (
      select 'states' as kind from semap.state_chunk_default where from_stamp < semap.kept_since('states')
      union all
      select 'lines' from semap.line_observation_default where stamp < semap.kept_since('lines')
      union all
      select 'lines' from semap.camera_report where stamp < semap.kept_since('lines')
      union all
      select 'changes' from semap.relation_change where stamp < semap.kept_since('changes')
      union all
      select 'events' from semap.event where stamp < semap.kept_since('events')) old
    group by kind
""")
Advance = Callable[[str], None]


@dataclass
class Maintained:
    """What was done, or would be in a dry run.

    made_days    days ahead for which there were no partitions
    dropped_days whole days of a table: not kept any longer, or empty
    dropped_rows by kind; a chunk of states counts as one
    put_off      what was in use for so long that it is left for the next time
    is_busy      somebody else is at it, and nothing was done
    """

    made_days: list[date] = field(default_factory=list)
    dropped_days: dict[str, list[date]] = field(default_factory=dict)
    dropped_rows: dict[str, int] = field(default_factory=dict)
    put_off: list[str] = field(default_factory=list)
    is_busy: bool = False


def maintain(
    dsn: str, advance: Advance = lambda _: None, stop: Signal | None = None, *, dry_run: bool = False
) -> Maintained:
    """Do all that is due now; one process at a time does.

    advance  is told what is being done
    stop     ends it after the step that is under way
    """
    with own_session(dsn, ROLE, application="semap maintain") as connection, translated():
        if dry_run:
            return _look(connection)
        with _alone(connection) as is_alone:
            if not is_alone:
                return Maintained(is_busy=True)
            return _Maintenance(connection, advance, stop or Signal()).run()


@contextmanager
def _alone(connection: Connection) -> Iterator[bool]:
    lock = {"lock": MAINTENANCE_LOCK}
    taken = connection.scalar(text("select pg_try_advisory_lock(:lock, 0)"), lock)
    try:
        yield bool(taken)
    finally:
        if taken and not connection.invalidated:
            connection.execute(text("select pg_advisory_unlock(:lock, 0)"), lock)


class _Maintenance:
    """Mutable: what has been done so far."""

    def __init__(self, connection: Connection, advance: Advance, stop: Signal) -> None:
        self._connection = connection
        self._advance = advance
        self._stop = stop
        self._done = Maintained()

    def run(self) -> Maintained:
        steps = (
            self._make_ahead,
            self._drop_days,
            self._drop_empty,
            self._drop_rows,
            self._drop_requests,
        )
        self._connection.execute(text(f"set lock_timeout = {LOCK_MS}"))
        for step in steps:
            if not self._stop.is_set():
                step()
        return self._done

    def _make_ahead(self) -> None:
        days = _missing_days(self._connection)
        if days and self._connection.scalar(MAKE, {"days": days}):
            self._done.made_days = days
        elif days:
            self._put_off("new partitions")

    def _drop_days(self) -> None:
        for table in TABLES:
            for day, is_old in _past_days(self._connection, table):
                if is_old:
                    self._drop_day(table, day)

    def _drop_empty(self) -> None:
        for table in TABLES:
            for day, is_old in _past_days(self._connection, table):
                if not is_old and self._connection.scalar(
                    text(EMPTY.format(table=table, stamp=STAMPS[table])), {"day": f"{day}T00:00Z"}
                ):
                    self._drop_day(table, day)

    def _drop_day(self, table: str, day: date) -> None:
        if self._stop.is_set():
            return
        if self._patiently(f"{WORDS[TABLES[table]]} of {day}", DROP_DAY, {"table": table, "day": day}):
            self._done.dropped_days.setdefault(table, []).append(day)

    def _drop_rows(self) -> None:
        for kind, words in WORDS.items():
            dropped = 0
            while not self._stop.is_set():
                rows = self._patiently(words, DROP_ROWS, {"kind": kind, "most": ROWS_AT_ONCE})
                if not rows:
                    break
                dropped += rows
                self._advance(f"dropping {words}: {dropped}")
            if dropped:
                self._done.dropped_rows[kind] = dropped

    def _drop_requests(self) -> None:
        """What was asked for in SQL and has been answered for a day, which no setting says anything of."""
        self._patiently("requests for queries", DROP_REQUESTS, {})

    def _patiently(self, what: str, statement: TextClause, parameters: Mapping[str, object]) -> Any:
        """What a step says; None where others used what it needs each time that it was tried."""
        for _ in range(ATTEMPTS):
            try:
                with translated():
                    return self._connection.scalar(statement, parameters)
            except InUse:
                if self._stop.wait(PAUSE_S):
                    break
        self._put_off(what)
        return None

    def _put_off(self, what: str) -> None:
        log.info("In use, and left for the next time: %s.", what)
        self._done.put_off.append(what)


def _look(connection: Connection) -> Maintained:
    """What would be done now."""
    found = Maintained(made_days=_missing_days(connection))
    for table in TABLES:
        if old := [day for day, is_old in _past_days(connection, table) if is_old]:
            found.dropped_days[table] = old
    found.dropped_rows = dict(connection.execute(OLD_ROWS).all())
    return found


def _missing_days(connection: Connection) -> list[date]:
    return list(connection.scalar(AHEAD, {"days": DAYS_AHEAD, "tables": list(TABLES)}) or ())


def _past_days(connection: Connection, table: str) -> list[tuple[date, bool]]:
    """Days of the past that have a partition, and whether they are not kept any longer."""
    found = connection.execute(PAST, {"kind": TABLES[table], "table": table})
    return [(day, bool(is_old)) for day, is_old in found]
