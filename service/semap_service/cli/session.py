"""The database that a command works on: the user's own by SEMAP_DSN, else semap's own server."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from sqlalchemy import Connection

Dsn = Annotated[
    str | None,
    typer.Option(
        "--dsn",
        envvar="SEMAP_DSN",
        show_default=False,
        metavar="DSN",
        help="A PostGIS server of your own, as 'host=... dbname=...' or postgresql://...",
    ),
]
MapName = Annotated[str, typer.Argument(metavar="MAP", help="Name of the map.")]
Cell = Annotated[
    float,
    typer.Option(
        help="Side of the cells of the spatial index [m]: 4 for a building, 100 for a farm.", min=0.1
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]

DATABASE = "semap"


@contextmanager
def database(dsn: str | None, map_name: str | None = None) -> Iterator[str]:
    """The DSN of a database whose schema is up to date.

    semap's own is started, made and migrated as needed; the user's own is only checked.

    map_name  of what is to be done: the database is that of the shard where this map is, or is to be made
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.places import shard_of  # noqa: PLC0415
    from semap.store.operate.schema import require_current  # noqa: PLC0415

    with nullcontext(dsn) if dsn is not None else own_database() as opened:
        with one_transaction(opened) as connection:
            if dsn is not None:
                require_current(connection)
            shard = None if map_name is None else shard_of(connection, map_name)
        if shard is None or shard.dsn is None:
            yield opened
            return
        with one_transaction(shard.dsn) as connection:
            require_current(connection)
        yield shard.dsn


@contextmanager
def own_database(name: str = DATABASE) -> Iterator[str]:
    """The DSN of a database in semap's own server."""
    from semap.cluster import default_home, lease  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.schema import is_current, migrate  # noqa: PLC0415

    with lease(default_home()) as cluster:
        if not cluster.has_database(name):
            cluster.create_database(name)
        own = cluster.dsn(name)
        with one_transaction(own) as connection:
            current = is_current(connection)
        if not current:
            migrate(own)
        yield own


@contextmanager
def signed_edit(dsn: str, message: str) -> Iterator[Connection]:
    """A transaction that changes the map; its history says which user of this machine did what."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.history import sign  # noqa: PLC0415

    with one_transaction(dsn, "semap_api") as connection:
        sign(connection, user(), message)
        yield connection


def user() -> str:
    """Who runs this command, as the machine knows them."""
    import getpass  # noqa: PLC0415

    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "semap"
