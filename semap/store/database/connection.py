"""Connections to the database, and its errors in semap's words.

A connection takes a role (semap_read, semap_ingest, semap_worker, semap_api, semap_admin), so that PostgreSQL
refuses a write that skips a stage; without one it has the rights of the DSN's own user.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress

import psycopg
from psycopg import errors, sql
from psycopg.conninfo import conninfo_to_dict
from sqlalchemy import Connection, Engine, create_engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool

from semap.errors import (
    Conflict,
    DatabaseError,
    InUse,
    InvalidInput,
    NotFound,
    NotPermitted,
    SemapError,
    ServerUnavailable,
    StatementTooLong,
)

CONNECT_TIMEOUT_S = 10
MOST_NAMES = 10
PARTS_OF_AN_ADDRESS = ("service", "host", "hostaddr", "port", "dbname")


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
            client_encoding="UTF8",  # else a database without an encoding has no texts
            # a look-up over many partitions looks dear, and is over long before it would be compiled
            options="-c timezone=UTC -c datestyle=ISO -c jit=off",
        )
        try:
            if role is not None:
                connection.execute(sql.SQL("set role {}").format(sql.Identifier(role)))
            connection.autocommit = autocommit
        except BaseException:
            connection.close()
            raise
    return connection


def listen(
    dsn: str, channel: str, role: str | None = None, *, application: str = "semap"
) -> psycopg.Connection:
    """Such a connection that is told of what is notified on a channel."""
    connection = connect(dsn, role, application=application)
    with translated():
        try:
            connection.execute(sql.SQL("listen {}").format(sql.Identifier(channel)))
        except BaseException:
            connection.close()
            raise
    return connection


def wait_for_notice(listening: psycopg.Connection, at_most_s: float) -> bool:
    """Whether something was notified before the time was over."""
    with translated():
        return next(iter(listening.notifies(timeout=at_most_s, stop_after=1)), None) is not None


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
def one_session(dsn: str, role: str | None = None, *, application: str = "semap") -> Iterator[Engine]:
    """An engine for one transaction after the other, which is disposed of at the end."""
    engine = open_engine(dsn, role, application=application, size=1)
    try:
        yield engine
    finally:
        engine.dispose()


def own_session(
    dsn: str, role: str | None = None, *, application: str = "semap", statement_s: int | None = None
) -> Connection:
    """An SQLAlchemy connection with its own session until it is closed; each statement commits.

    statement_s  a statement that takes longer is cancelled; None: no limit
    raises       ServerUnavailable if the server does not answer
    """
    engine = create_engine(
        "postgresql+psycopg://",
        creator=lambda: connect(dsn, role, application=application),
        poolclass=NullPool,
        isolation_level="AUTOCOMMIT",
    )
    with translated():
        connection = engine.connect()
        if statement_s is not None:
            connection.execute(text(f"set statement_timeout = '{statement_s}s'"))
    return connection


@contextmanager
def one_transaction(dsn: str, role: str | None = None, *, application: str = "semap") -> Iterator[Connection]:
    """An SQLAlchemy connection in a transaction of its own: committed at the end, or nothing."""
    with (
        one_session(dsn, role, application=application) as engine,
        translated(),
        engine.begin() as connection,
    ):
        yield connection


def is_open(connection: Connection) -> bool:
    """Whether a session of its own, and with it what it holds, is still there."""
    if connection.closed or connection.invalidated:
        return False
    try:
        connection.execute(text("select 1"))
    except DBAPIError:
        return False
    return True


def driver_of(connection: Connection) -> psycopg.Connection:
    """The driver's connection, in the same transaction: for what follows the log, asked about the past."""
    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)  # noqa: S101  (the only driver there is)
    return driver


def canceller(connection: Connection, within_s: float) -> Callable[[], None]:
    """What cancels from another thread the statement that runs here."""
    driver = driver_of(connection)

    def cancel() -> None:
        if not driver.closed:
            with suppress(psycopg.Error):
                driver.cancel_safe(timeout=within_s)

    return cancel


def address_of(dsn: str) -> str:
    """Which database a DSN means, without its password or who logs in."""
    try:
        said = conninfo_to_dict(dsn)
    except psycopg.Error:
        return "a DSN that PostgreSQL does not read"
    return " ".join(f"{part}={said[part]}" for part in PARTS_OF_AN_ADDRESS if said.get(part))


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
            raise _translation(error.orig, error.params) from error
        raise
    except psycopg.Error as error:
        raise _translation(error) from error


def _translation(error: psycopg.Error, parameters: object = None) -> SemapError:
    message = error.diag.message_primary or str(error).strip()
    remedy = error.diag.message_hint or ""
    match error:
        case errors.UniqueViolation():
            said = error.diag.message_detail if error.diag.constraint_name else message
            return Conflict(said or _taken(error, parameters), remedy or "Choose another name.")
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
            return NotPermitted(message, remedy or "Use a role that may do this.")
        case errors.QueryCanceled():
            return StatementTooLong(
                "It takes the database too long.", remedy or "Ask for less: a smaller limit, area or span."
            )
        case errors.UndefinedTable() | errors.InvalidSchemaName() | errors.UndefinedFunction():
            return DatabaseError(message, "The schema is missing or out of date: run `semap db migrate`.")
        case errors.SerializationFailure() | errors.DeadlockDetected() | errors.LockNotAvailable():
            return InUse(message, "Try again.")
        case psycopg.OperationalError() | errors.AdminShutdown():
            return ServerUnavailable(
                message, remedy or "See that the server runs and that SEMAP_DSN is right."
            )
        case _:
            return DatabaseError(message, remedy)


def _taken(error: errors.UniqueViolation, parameters: object) -> str:
    """What PostgreSQL does not say where a table has row-level security: which name is taken."""
    sets = parameters if isinstance(parameters, list | tuple) else [parameters]
    named = [
        value
        for each in sets
        if isinstance(each, Mapping)
        for key, value in each.items()
        if str(key).partition("__")[0] in ("name", "names")
    ]
    names = [str(name) for each in named for name in (each if isinstance(each, list) else [each])]
    what = (error.diag.table_name or "thing").replace("_", " ")
    if not names or "name" not in (error.diag.constraint_name or ""):
        return f"There is such a {what} already ({error.diag.constraint_name})."
    if len(names) == 1:
        return f"There is a {what} {names[0]} already."
    return f"There is a {what} already of one of these names: {', '.join(names[:MOST_NAMES])}."
