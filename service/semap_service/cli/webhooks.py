"""semap webhook"""

from __future__ import annotations

from typing import Annotated

import typer

from semap_service.cli.output import print_json, print_rows, say
from semap_service.cli.session import AsJson, Dsn, database, user

WebhookId = Annotated[
    int, typer.Argument(metavar="WEBHOOK", min=1, max=2**31 - 1, help="Number of the webhook.")
]


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Events that are sent to web addresses.")
    app.command("add")(add)
    app.command("list")(list_)
    app.command("pause")(pause)
    app.command("resume")(resume)
    app.command("remove")(remove)
    app.command("dead-letters")(dead_letters)
    app.command("resend")(resend)
    return app


def add(
    url: Annotated[str, typer.Argument(metavar="URL", help="Where each event is sent by POST.")],
    map_name: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="MAP", help="Only events of this map. More than once. [default: all]"),
    ] = None,
    event_type: Annotated[str | None, typer.Option("--type", help="Only events of this type.")] = None,
    rule: Annotated[str | None, typer.Option(help="Only events of this rule.")] = None,
    cql2: Annotated[
        str | None, typer.Option("--filter", metavar="CQL2", help="Only events that match this.")
    ] = None,
    description: Annotated[str, typer.Option(help="For people.")] = "",
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Send events from now on, signed with a secret that is shown once, here.

    An address of a private network is sent to only by a service that runs with --allow-private-webhooks.
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.event_selection import Selection  # noqa: PLC0415
    from semap.store.event.webhooks import create_webhook  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap_service.webhooks.address import require_url  # noqa: PLC0415
    from semap_service.webhooks.signature import new_secret, shown  # noqa: PLC0415

    require_url(url, allow_private=True)
    Selection(filter=cql2).check()
    secret = new_secret()
    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        for name in map_name or ():
            get_map(connection, name)
        values = {
            "url": url,
            "description": description,
            "maps": map_name or None,
            "event_type": event_type,
            "rule_name": rule,
            "filter": cql2,
            "created_by": user(),
        }
        webhook_id = create_webhook(connection, values, secret)
    if as_json:
        print_json({"id": webhook_id, "secret": shown(secret)})
        return
    say(shown(secret))
    say(f"That is the secret of webhook {webhook_id}. It is not shown again.", err=True)


def list_(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the webhooks, and the state of their deliveries."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.webhooks import list_webhooks  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        found = list_webhooks(connection, limit=1000)
    if as_json:
        print_json([vars(each) for each in found])
        return
    rows = [
        {
            "webhook": each.webhook_id,
            "url": each.url,
            "state": each.state,
            "delivered": each.delivered_count,
            "dead letters": each.dead_letters,
            "last delivered": each.last_delivered_at,
            "last error": each.last_error[:60],
        }
        for each in found
    ]
    print_rows(rows, as_json, "There is no webhook. Make one: semap webhook add URL")


def pause(webhook: WebhookId, dsn: Dsn = None) -> None:
    """Pause a webhook. Events of the meantime are sent after it is resumed."""
    _set_state(webhook, "paused", dsn)


def resume(webhook: WebhookId, dsn: Dsn = None) -> None:
    """Resume a webhook, also one that semap disabled."""
    _set_state(webhook, "active", dsn)


def remove(webhook: WebhookId, dsn: Dsn = None) -> None:
    """Remove a webhook, with its dead letters."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.webhooks import delete_webhook  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        delete_webhook(connection, webhook)
    say(f"Webhook {webhook} is removed.")


def dead_letters(
    webhook: WebhookId,
    limit: Annotated[int, typer.Option(min=1, max=10_000, help="At most so many.")] = 100,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """List events that the receiver did not accept."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.webhooks import list_dead_letters  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        found = list_dead_letters(connection, webhook, limit=limit)
    print_rows([vars(each) for each in found], as_json, "The receiver took everything.")


def resend(
    webhook: WebhookId,
    letter: Annotated[
        int | None, typer.Option(metavar="DEAD_LETTER", min=1, help="Only this one. [default: all]")
    ] = None,
    dsn: Dsn = None,
) -> None:
    """Have dead letters sent again by the service, the oldest first."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.webhooks import ask_resend  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        asked = ask_resend(connection, webhook, letter)
    say(f"{asked} to be sent again.")


def _set_state(webhook: int, state: str, dsn: str | None) -> None:
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.webhooks import change_webhook  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        change_webhook(connection, webhook, {"state": state})
    say(f"Webhook {webhook} is {state}.")
