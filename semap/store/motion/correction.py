"""Corrects what is known of the past after late states (sql/148), so many of them in a transaction."""

from __future__ import annotations

from sqlalchemy import Connection, text

from semap.store.database.connection import own_session, translated


def correct_some(connection: Connection, map_id: int | None = None) -> int:
    """Correct some of what is known of the past of a map, or of any; of how many late states.

    raises SemapError if the database refuses it
    """
    with translated():
        return int(connection.scalar(text("select semap.correct_some(:map_id)"), {"map_id": map_id}) or 0)


def correct_past(dsn: str, role: str | None = None) -> None:
    """Correct all that is known of the past, as a worker does; at once with one if it runs."""
    with own_session(dsn, role, application="semap correct") as connection:
        while correct_some(connection):
            pass
