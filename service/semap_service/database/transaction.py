"""The transaction of a request: to read, to write, or to edit what is there.

It has the PostgreSQL role of what the request needs, whatever more the caller may do, and sees the caller's
maps only. What is written is signed: the change set in the history of the map says who asked for it and why.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Annotated

from fastapi import Depends, Header, Request
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.requests import HTTPConnection

from semap.errors import AccessRefused, ChangedMeanwhile, NotFound, NotPermitted, ServerUnavailable
from semap.store.database.connection import translated
from semap.store.database.role import enter
from semap.store.map.history import lock_edits, sign
from semap.store.map.places import Shard
from semap_service.context.caller import Scope, acting, current_caller
from semap_service.database.shards import Shards
from semap_service.http.etag import Representation, etag_of, names

Current = Callable[[Connection], Representation | tuple[Callable[[], Representation], ...]]
"""What a reader would be sent now, or each of its forms."""

ROLES: dict[Scope, str] = {
    "read": "semap_read",
    "ingest": "semap_ingest",
    "write": "semap_api",
    "admin": "semap_admin",
}
"""Of callers for all maps; those who are restricted to maps have others, with _map behind."""


def _shards(connection: HTTPConnection) -> Shards:
    shards: Shards = connection.app.state.shards
    return shards


def _engine(connection: HTTPConnection) -> Engine:
    """The database of what a request is about: of one shard, where a list asks each of them."""
    shard: Shard | None = connection.scope.get("state", {}).get("shard")
    shards = _shards(connection)
    return shards.of_request(connection) if shard is None else shards.engine(shard)


def _directory(connection: HTTPConnection) -> Engine:
    engine: Engine = connection.app.state.engine
    return engine


Everywhere = Annotated[Shards, Depends(_shards)]
Database = Annotated[Engine, Depends(_engine)]
Directory = Annotated[Engine, Depends(_directory)]
"""What is kept for all maps together."""


@contextmanager
def transaction(engine: Engine) -> Iterator[Connection]:
    """One transaction, committed at the end and before anything is answered.

    raises  ServerUnavailable if the server does not answer, or all connections are taken; AccessRefused where
            a caller of some maps asks for what belongs to all; RuntimeError where nobody is acting
    """
    whose = acting()
    try:
        with translated(), engine.begin() as connection:
            enter(connection, ROLES[whose.scope], whose.caller.map_ids, whose.statement_s)
            yield connection
    except NotPermitted as error:
        if whose.caller.map_ids is None:
            raise
        raise AccessRefused(
            f"{whose.caller.name} may not do this: it is not about its maps alone.",
            "Use a token for all maps.",
        ) from error
    except PoolTimeoutError as error:
        raise ServerUnavailable(
            "All connections to the database are in use.", "Try again in a moment."
        ) from error


def on_whole_map(connection: Connection) -> None:
    """Let what follows in a transaction use every index, for a caller who is restricted to maps.

    Under row-level security PostgreSQL cannot look a shape up by its index. So a statement that is about one
    map, which was found under it, with ids of things that were found under it, may go on without.
    """
    whose = acting()
    if whose.caller.map_ids is not None:
        enter(connection, ROLES[whose.scope])


@dataclass(frozen=True)
class Writing:
    """A request that adds something."""

    engine: Engine
    author: str
    message: str
    shards: Shards | None = None

    def to(self, map_name: str, *, is_new: bool = False) -> Writing:
        """The same where a map is that the body names; with `is_new`, or where it is to be made."""
        if self.shards is None:
            return self
        found = self.shards.of_new_map(map_name) if is_new else self.shards.of_map(map_name)
        return replace(self, engine=found)

    @contextmanager
    def begin(self) -> Iterator[Connection]:
        """One signed transaction, committed at the end and before anything is answered."""
        with transaction(self.engine) as connection:
            sign(connection, self.author, self.message)
            yield connection


def _writing(
    request: Request,
    engine: Database,
    shards: Everywhere,
    author: Annotated[
        str | None,
        Header(
            alias="Semap-Author",
            max_length=200,
            description="Who makes this change, for the history of the map, which names the token beside it."
            " [default: the name of the token, or the address]",
        ),
    ] = None,
    message: Annotated[
        str, Header(alias="Semap-Message", max_length=1000, description="Why, for the history of the map.")
    ] = "",
) -> Writing:
    signature = _signature(request, _text(author) if author else None)
    return Writing(engine, signature, _text(message), shards)


def _signature(request: Request, author: str | None) -> str:
    """Who signs: as the caller says, beside the name of the token, which nobody can make up."""
    caller = current_caller()
    if caller.token_id is not None:
        return caller.name if author is None else f"{author} ({caller.name})"
    return author or ("unknown" if request.client is None else request.client.host)


Write = Annotated[Writing, Depends(_writing)]


@dataclass(frozen=True)
class Editing:
    """A request that changes or deletes something, if it still is what If-Match names."""

    writing: Writing
    if_match: str | None
    may_create: bool

    @contextmanager
    def begin(self, current: Current) -> Iterator[Connection]:
        """One signed transaction in which nobody else edits from the comparison on.

        current  reads what is to be changed
        raises   ChangedMeanwhile if that is not what If-Match names
        """
        with self.writing.begin() as connection:
            if self.if_match is not None:
                lock_edits(connection)
                self._compare(connection, current)
            yield connection

    def _compare(self, connection: Connection, current: Current) -> None:
        try:
            present = current(connection)
        except NotFound as error:
            if not self.may_create:
                raise
            raise ChangedMeanwhile(f"{error} If-Match requires one.", "Send it without If-Match.") from error
        forms = present if isinstance(present, tuple) else (lambda: present,)
        if not any(names(self.if_match or "", etag_of(form())) for form in forms):
            raise ChangedMeanwhile(
                "It was changed since it was read: If-Match names another state.",
                "Read it again, look at what changed, and send the change with its new ETag.",
            )


def _editing(
    request: Request,
    writing: Write,
    if_match: Annotated[
        str | None,
        Header(
            alias="If-Match",
            max_length=1000,
            description="The ETag of what was read; the change is refused (412) if it is another now.",
        ),
    ] = None,
) -> Editing:
    return Editing(writing, if_match, request.method == "PUT")


Edit = Annotated[Editing, Depends(_editing)]


def _text(header: str) -> str:
    """The text of a header: UTF-8 where it is that, as programs send it, else ISO 8859-1 (RFC 9110, 5.5)."""
    try:
        return header.encode("latin-1").decode()
    except UnicodeError:
        return header
