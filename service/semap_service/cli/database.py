"""semap db"""

from __future__ import annotations

from typing import Annotated

import typer

from semap_service.cli import storage
from semap_service.cli.output import print_json, say
from semap_service.cli.session import DATABASE, AsJson, Dsn, own_database


def commands() -> typer.Typer:
    app = typer.Typer(
        no_args_is_help=True, help="Look after the database: migrate, keep in shape, start, stop."
    )
    app.command("migrate")(migrate)
    app.command("status")(status)
    app.command("start")(start)
    app.command("stop")(stop)
    app.command("resync")(resync)
    app.command("size")(storage.size)
    app.command("retention")(storage.retention)
    app.command("maintain")(storage.maintain)
    return app


def migrate(dsn: Dsn = None) -> None:
    """Create or update semap's schema. Safe to run at any time, also twice at once."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.preflight import require_fit  # noqa: PLC0415
    from semap.store.operate.schema import head_version  # noqa: PLC0415
    from semap.store.operate.schema import migrate as bring_up_to_date  # noqa: PLC0415

    if dsn is None:
        with own_database():
            say(f"The schema is at version {head_version()}.")
        return
    with one_transaction(dsn) as connection:
        require_fit(connection)
    done = bring_up_to_date(dsn)
    before = done.version_before or "nothing"
    say(f"The schema is at version {done.version} (before: {before}).")


def status(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """Show where the database is, its schema, and how far the rule worker has come."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.status import read_status  # noqa: PLC0415
    from semap_service.cli.session import database  # noqa: PLC0415
    from semap_service.operations.redaction import redacted  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        report = {"dsn": redacted(opened), **vars(read_status(connection))}
    if as_json:
        print_json(report)
        return
    for name, value in report.items():
        say(f"{name.replace('_', ' '):<20} {'-' if value is None else value}")


def start() -> None:
    """Start semap's own server and keep it running until `semap db stop`."""
    from semap.cluster import default_home, keep_running  # noqa: PLC0415

    cluster = keep_running(default_home())
    with own_database():
        say(f"Running. psql '{cluster.dsn(DATABASE)}'")


def stop(
    force: Annotated[bool, typer.Option("--force", help="Stop it although commands still use it.")] = False,
) -> None:
    """Stop semap's own server; without --force as soon as no command uses it."""
    from semap.cluster import default_home, stop_keeping  # noqa: PLC0415

    stopped = stop_keeping(default_home(), force=force)
    say("Stopped." if stopped else "It stops as soon as the last command that uses it has ended.")


def resync(dsn: Dsn = None) -> None:
    """Make a lost replication slot again and catch up from the tables.

    Needed where the slot was dropped, grew too old, or the database is a restored copy. Stop the rule
    worker first.
    """
    from semap.worker.resync import resync as catch_up  # noqa: PLC0415
    from semap_service.cli.session import database  # noqa: PLC0415

    with database(dsn) as opened:
        made = catch_up(opened)
    say(f"The slot is there; {made} events were caught up.")
