"""Connections to the database, and its errors in semap's words.

A connection takes a role (semap_read, semap_ingest, semap_worker, semap_api), so that PostgreSQL
refuses a write that skips a stage; without one it has the rights of the DSN's own user.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import psycopg
from psycopg import errors, sql
from sqlalchemy import Connection, Engine, create_engine, text
from sqlalchemy.exc import DBAPIError

from semap.errors import Conflict, DatabaseError, InvalidInput, NotFound, SemapError, ServerUnavailable

CONNECT_TIMEOUT_S = 10


def connect(
    dsn: str, role: str | None = None, *, application: str = "semap", autocommit: bool = True
) -> psycopg.Connection:
    """A psycopg connection in UTC, acting as `role`.

    raises ServerUnavailable if the server does not answer
    """
    with translated():
        connection = psycopg.connect(
            dsn,
            autocommit=True,
            application_name=application,
            connect_timeout=CONNECT_TIMEOUT_S,
            options="-c timezone=UTC -c datestyle=ISO",
        )
        if role is not None:
            connection.execute(sql.SQL("set role {}").format(sql.Identifier(role)))
        connection.autocommit = autocommit
    return connection


def open_engine(dsn: str, role: str | None = None, *, application: str = "semap", size: int = 10) -> Engine:
    """An SQLAlchemy engine with a pool of such connections; a broken one is replaced before use."""
    return create_engine(
        "postgresql+psycopg://",
        creator=lambda: connect(dsn, role, application=application, autocommit=False),
        pool_size=size,
        max_overflow=size,
        pool_pre_ping=True,
    )


@contextmanager
def one_transaction(dsn: str, role: str | None = None, *, application: str = "semap") -> Iterator[Connection]:
    """An SQLAlchemy connection in a transaction of its own: committed at the end, or nothing."""
    engine = open_engine(dsn, role, application=application, size=1)
    try:
        with translated(), engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()


def see_one_state(connection: Connection) -> None:
    """Let every statement of a transaction that only reads see the same state; to be its first statement."""
    with translated():
        connection.execute(text("set transaction isolation level repeatable read, read only"))


@contextmanager
def translated() -> Iterator[None]:
    """Raise semap's errors instead of the driver's."""
    try:
        yield
    except DBAPIError as error:
        if isinstance(error.orig, psycopg.Error):
            raise _translation(error.orig) from error
        raise
    except psycopg.Error as error:
        raise _translation(error) from error


def _translation(error: psycopg.Error) -> SemapError:
    message = error.diag.message_primary or str(error).strip()
    remedy = error.diag.message_hint or ""
    match error:
        case errors.UniqueViolation():
            return Conflict(error.diag.message_detail or message, remedy or "Choose another name.")
        case errors.ForeignKeyViolation():
            return Conflict(error.diag.message_detail or message, remedy)
        case errors.NoDataFound():
            return NotFound.said(message, remedy)
        case errors.CheckViolation() | errors.NotNullViolation() | errors.ProgramLimitExceeded():
            return InvalidInput(message, remedy)
        case errors.DataError() | errors.CardinalityViolation():
            return InvalidInput(message, remedy)
        case errors.InternalError_() if message.startswith("GEOS"):
            return InvalidInput(message, remedy or "Give shapes and numbers that geometry can be made of.")
        case errors.InsufficientPrivilege():
            return DatabaseError(message, remedy or "Use a role that may do this.")
        case errors.UndefinedTable() | errors.InvalidSchemaName() | errors.UndefinedFunction():
            return DatabaseError(message, "The schema is missing or out of date: run `semap db migrate`.")
        case errors.SerializationFailure() | errors.DeadlockDetected():
            return ServerUnavailable(message, "Try again.")
        case psycopg.OperationalError() | errors.AdminShutdown():
            return ServerUnavailable(message, "See that the server runs and that SEMAP_DSN is right.")
        case _:
            return DatabaseError(message, remedy)
