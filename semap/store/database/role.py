"""Which PostgreSQL role a transaction has, and which maps it sees (sql/910_access.sql)."""

from __future__ import annotations

from collections.abc import Collection

from sqlalchemy import Connection

from semap.store.database.connection import translated


def enter(
    connection: Connection,
    role: str,
    map_ids: Collection[int] | None = None,
    statement_s: float | None = None,
) -> None:
    """Begin a transaction; nothing in its statements is of the caller's making.

    `set local` takes no snapshot, so that the isolation level can still be chosen after it.

    map_ids      the only maps that it sees; None: all
    statement_s  a statement that takes longer is cancelled; None: no limit
    """
    statements = [f"set local role {role}"]
    if map_ids is not None:
        ids = ",".join(str(int(each)) for each in sorted(map_ids))
        statements = [f"set local role {role}_map", f"set local semap.maps = '{{{ids}}}'"]
    if statement_s is not None:
        statements.append(f"set local statement_timeout = {int(statement_s * 1000)}")
    with translated():
        connection.exec_driver_sql("; ".join(statements))
