"""The replication slot of the rule worker, by which it reads the log."""

from __future__ import annotations

import psycopg

from semap.store.database.connection import translated

MIGRATION_LOCK = 7366


def ensure_slot(connection: psycopg.Connection) -> None:
    """Make the rule worker's replication slot and its first progress where they are missing.

    A slot is an object of the whole server and is not part of a transaction or of a copied database.
    The rules known so far are noted after the slot exists: later ones come through it.
    """
    with translated():
        connection.execute("select pg_advisory_lock(%s)", [MIGRATION_LOCK])
        try:
            connection.execute("select semap.create_rule_slot()")
            connection.execute("select semap.begin_progress()")
        finally:
            connection.execute("select pg_advisory_unlock(%s)", [MIGRATION_LOCK])
