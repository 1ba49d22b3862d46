"""Corrects what is known of the past after late states (sql/148), so many of them in a transaction."""

from __future__ import annotations

import psycopg

from semap.store.database.connection import connect, translated


def correct_some(connection: psycopg.Connection, map_id: int | None = None) -> int:
    """Correct some of what is known of the past of a map, or of any; of how many late states.

    raises SemapError if the database refuses it
    """
    with translated():
        (states,) = connection.execute("select semap.correct_some(%s)", [map_id]).fetchone() or (0,)
    return int(states)


def correct_past(dsn: str, role: str | None = None) -> None:
    """Correct all that is known of the past, as a worker does; at once with one if it runs."""
    with connect(dsn, role, application="semap correct") as connection:
        while correct_some(connection):
            pass
