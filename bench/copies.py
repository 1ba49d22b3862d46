"""Databases beside the one of a benchmark: copies of it, for the cases that are measured in turn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import psycopg
from psycopg.conninfo import conninfo_to_dict, make_conninfo
from psycopg.sql import SQL, Identifier

from semap.store.database.connection import connect

CREATE = "create database {} template {} strategy file_copy"
DROP_SLOTS = """
    select pg_drop_replication_slot(slot_name) from pg_replication_slots
    where database = current_database() and not active
"""


def without_slots(dsn: str) -> None:
    """Let nobody wait for the log of what is written, which the server would keep."""
    with connect(dsn) as connection:
        connection.execute(DROP_SLOTS)


@contextmanager
def copied(dsn: str, title: str) -> Iterator[str]:
    """A copy of a database that nobody is connected to; it is dropped at the end, whoever is connected to it.

    title  of the copy, among those of one database
    """
    source = str(conninfo_to_dict(dsn)["dbname"])
    name = f"{source}_{title}"
    with psycopg.connect(make_conninfo(dsn, dbname="postgres"), autocommit=True) as session:
        session.execute(SQL(CREATE).format(Identifier(name), Identifier(source)))
        try:
            yield make_conninfo(dsn, dbname=name)
        finally:
            session.execute(SQL("drop database {} with (force)").format(Identifier(name)))
