"""semap shard, and semap map place"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Annotated

import typer

from semap_service.cli.output import counted, print_rows, say
from semap_service.cli.session import DATABASE, AsJson, Dsn, MapName, database, own_database

ShardName = Annotated[str, typer.Argument(metavar="NAME", help="Name of the shard.")]
ShardDsn = Annotated[
    str,
    typer.Option(
        "--dsn",
        metavar="DSN",
        show_default=False,
        help="Its database, without maps, as the service and the workers reach it. A password is kept in the "
        "directory; one in ~/.pgpass of whoever runs these need not be given.",
    ),
]
Directory = Annotated[
    str | None,
    typer.Option(
        "--directory",
        envvar="SEMAP_DSN",
        metavar="DSN",
        show_default=False,
        help="The database that knows all shards.",
    ),
]


def commands() -> typer.Typer:
    app = typer.Typer(
        no_args_is_help=True,
        help="Shards: databases that share the maps of one service, and which there are.",
    )
    app.command("add")(add)
    app.command("list")(list_all)
    app.command("drain")(drain)
    return app


def add(name: ShardName, dsn: ShardDsn, directory: Directory = None) -> None:
    """Let a database be a shard, whose maps the service of the directory answers for.

    Its schema is made. Added again by the same name it is found under the new DSN. Each shard needs a rule
    worker: semap work --dsn DSN
    """
    from semap.store.operate.shards import add_shard  # noqa: PLC0415

    with database(directory) as opened:
        add_shard(opened, name, dsn)
    say(f"{name} is a shard. Run its rule worker, and place maps: semap map place MAP --shard {name}")


def list_all(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the shards; passwords are not shown."""
    from semap.store.database.connection import address_of, one_transaction  # noqa: PLC0415
    from semap.store.map.places import list_shards  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        rows = [
            {
                "name": each.name,
                "maps": each.maps,
                "draining": each.draining,
                "database": address_of(each.dsn or opened),
            }
            for each in list_shards(connection)
        ]
    print_rows(rows, as_json, "")


def drain(
    name: ShardName,
    undo: Annotated[bool, typer.Option("--undo", help="Place new maps there again.")] = False,
    dsn: Dsn = None,
) -> None:
    """Place no new map on a shard; those that it has stay."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.shards import drain_shard  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        found = drain_shard(connection, name, draining=not undo)
    if undo:
        say(f"{name} takes new maps.")
    else:
        say(f"{name} takes no new map; it has {counted(found.maps, 'map')}.")


@contextmanager
def where_made(dsn: str | None, map_name: str) -> Iterator[str]:
    """The database where a map is, or where a new one of that name is to be made."""
    from semap.store.operate.shards import place_new_map  # noqa: PLC0415

    with database(dsn) as opened:
        shard = place_new_map(opened, map_name)
        yield opened if shard is None or shard.dsn is None else shard.dsn


@contextmanager
def own_shards(directory: str, count: int, *, is_own: bool) -> Iterator[list[str]]:
    """The shards beside the directory in semap's own server: those that there are, and as many as are wanted.

    is_own   whether that server is the directory's
    raises   InvalidInput where shards are wanted on another server
    """
    from semap.cluster import Cluster, default_home  # noqa: PLC0415
    from semap.errors import InvalidInput  # noqa: PLC0415
    from semap.store.operate.shards import add_shard  # noqa: PLC0415

    if not is_own and count > 1:
        raise InvalidInput(
            "shards of a server of your own are databases that you make",
            "Add each: semap shard add NAME --dsn DSN",
            "--shards",
        )
    with ExitStack() as stack:
        found: list[str] = []
        number = 2
        while is_own and (number <= count or Cluster(default_home()).has_database(_own_name(number))):
            found.append(stack.enter_context(own_database(_own_name(number))))
            add_shard(directory, f"shard-{number}", found[-1])
            number += 1
        yield found


def _own_name(number: int) -> str:
    return f"{DATABASE}_shard_{number}"


def place(
    name: MapName,
    shard: Annotated[str, typer.Option(help="Name of the shard.", show_default=False)],
    dsn: Dsn = None,
) -> None:
    """Say on which shard a map is to be made, before it is.

    A map that was made already does not move: export it, delete it, place it, and import it there.
    """
    from semap.store.operate.shards import place_map  # noqa: PLC0415

    with database(dsn) as opened:
        place_map(opened, name, shard)
    say(f"Map {name} is placed on {shard}.")
