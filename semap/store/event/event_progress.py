"""How far events are made: what the rule worker has read of the log."""

from __future__ import annotations

from sqlalchemy import Connection, text

from semap.store.database.connection import translated


def end_of_log(connection: Connection) -> str:
    """Where the log ends now; a change of nothing follows, so that the worker has something to commit."""
    with translated():
        lsn: str = connection.scalars(text("select pg_current_wal_insert_lsn()::text")).one()
        connection.execute(text("update semap.source set ended = ended"))
    return lsn


def has_read(connection: Connection, lsn: str) -> bool:
    """Whether the worker has committed all that was in the log before."""
    with translated():
        asked = text("select bool_and(lsn >= cast(:lsn as pg_lsn)) from semap.progress")
        return bool(connection.scalar(asked, {"lsn": lsn}))
