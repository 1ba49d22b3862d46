"""Whether the service can do its work now: each thing that it needs, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import Connection, text

from semap.errors import NotPermitted, SemapError
from semap.store.database.connection import translated
from semap.store.operate.schema import head_version

SILENT_S = 30.0
"""A worker that has not said for so long that it is at work does none; it says so each five seconds."""

# by way of JSON, since an older schema has no such column
STATE = text("""
    select (select version_num from semap.schema_version), s.active,
           greatest(pg_wal_lsn_diff(pg_current_wal_lsn(), s.confirmed_flush_lsn), 0)::bigint,
           extract(epoch from clock_timestamp() - nullif(
             (select (to_jsonb(p) ->> 'alive_at')::timestamptz from semap.progress p where worker = 'rules'),
             '-infinity'))::double precision
    from (select semap.rule_slot() as name) wanted
    left join pg_replication_slots s on s.slot_name = wanted.name
""")
WRITE = text(
    "create temporary table semap_writes on commit drop as"
    " select repeat('x', 100) from generate_series(1, 1000)"
)

Lack = tuple[str, str]
"""What is not ready, and why."""


@dataclass(frozen=True)
class WorkerState:
    """How the rule worker does, by the clock of the database.

    version     of the schema
    has_reader  whether somebody reads its slot; None: there is none
    lag_bytes   of the log that it has not confirmed
    silent_s    since it last said that it is at work; None: it never did
    """

    version: str
    has_reader: bool | None
    lag_bytes: int
    silent_s: float | None

    @property
    def is_at_work(self) -> bool:
        return bool(self.has_reader) and self.silent_s is not None and self.silent_s < SILENT_S


def read_state(connection: Connection) -> WorkerState:
    """What the database says of the worker."""
    with translated():
        version, has_reader, lag_bytes, silent_s = connection.execute(STATE).one()
    return WorkerState(version, has_reader, lag_bytes or 0, silent_s)


def lacks(connection: Connection, feed_connected: bool) -> list[Lack]:
    """What the service waits for; nothing: it is ready."""
    state = read_state(connection)
    found = []
    if state.version != head_version():
        found.append(("schema", f"is {state.version}, not {head_version()}: run semap db migrate"))
    if not feed_connected:
        found.append(("feed", "is not connected to the database"))
    if state.has_reader is None:
        found.append(("slot", "of the rule worker is missing: run semap db resync"))
    elif not state.is_at_work:
        found.append(("worker", _why_not(state)))
        found += _write_fault(connection)
    return found


def _why_not(state: WorkerState) -> str:
    since = "" if state.silent_s is None else f", and was last at work {state.silent_s:.0f} s ago"
    if not state.has_reader:
        return f"does not run, or cannot do its work{since}: start semap work, or see its log"
    return f"runs and makes no progress{since}: see its log, and restart it if it hangs"


def _write_fault(connection: Connection) -> list[Lack]:
    """Why the server cannot write, in its own words: a full disk, for instance, is what stops a worker."""
    attempt = connection.begin_nested()
    try:
        with translated():
            connection.execute(WRITE)
    except NotPermitted:
        return []
    except SemapError as error:
        return [("database", f"cannot write: {error}")]
    finally:
        attempt.rollback()
    return []
