"""The transaction of a request."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

from fastapi import Depends
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.requests import HTTPConnection

from semap.errors import ServerUnavailable
from semap.store.database import translated


def _engine(connection: HTTPConnection) -> Engine:
    engine: Engine = connection.app.state.engine
    return engine


Database = Annotated[Engine, Depends(_engine)]


@contextmanager
def transaction(engine: Engine) -> Iterator[Connection]:
    """One transaction, committed at the end and before anything is answered.

    raises  ServerUnavailable if the server does not answer, or all connections are taken
    """
    try:
        with translated(), engine.begin() as connection:
            yield connection
    except PoolTimeoutError as error:
        raise ServerUnavailable(
            "All connections to the database are in use.", "Try again in a moment."
        ) from error
