"""Whether the service can do its work now: each thing that it needs, and what is wrong with it."""

from __future__ import annotations

from sqlalchemy import Connection, text

from semap.store.database import translated
from semap.store.schema import head_version

STATE = text("""
    select (select version_num from semap.schema_version),
           s.active, pg_wal_lsn_diff(pg_current_wal_lsn(), s.confirmed_flush_lsn)
    from (select semap.rule_slot() as name) wanted
    left join pg_replication_slots s on s.slot_name = wanted.name
""")

Lack = tuple[str, str]
"""What is not ready, and why."""


def read_state(connection: Connection) -> tuple[str, bool | None, int]:
    """The version of the schema, whether a worker reads its slot (None: there is none), its lag in bytes."""
    with translated():
        version, running, lag_bytes = connection.execute(STATE).one()
    return version, running, max(0, int(lag_bytes or 0))


def lacks(connection: Connection, feed_connected: bool) -> list[Lack]:
    """What the service waits for; nothing: it is ready."""
    version, running, _ = read_state(connection)
    found = []
    if version != head_version():
        found.append(("schema", f"is {version}, not {head_version()}: run semap db migrate"))
    if not feed_connected:
        found.append(("feed", "is not connected to the database"))
    if running is None:
        found.append(("slot", "of the rule worker is missing: run semap db resync"))
    elif not running:
        found.append(("worker", "does not run: start semap work"))
    return found
