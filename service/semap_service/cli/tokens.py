"""semap token"""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Annotated

import typer

from semap_service.cli.output import print_json, print_rows, say
from semap_service.cli.session import AsJson, Dsn, database, user

if TYPE_CHECKING:
    from semap.store.operate.tokens import Token

UNITS = {"m": timedelta(minutes=1), "h": timedelta(hours=1), "d": timedelta(days=1), "y": timedelta(days=365)}
LONGEST = timedelta(days=365 * 100)

Name = Annotated[str, typer.Argument(metavar="NAME", help="The name of its holder or use.")]


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Who may call the service: make, list and revoke tokens.")
    app.command("add")(add)
    app.command("list")(list_)
    app.command("revoke")(revoke)
    return app


def add(
    name: Name,
    scope: Annotated[
        list[str] | None,
        typer.Option(
            "--scope",
            help="read, write (maps, rules, imports), ingest (data of sources) or admin (all)."
            " More than once. [default: read]",
        ),
    ] = None,
    map_name: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="MAP", help="The only map it is for. More than once. [default: all]"),
    ] = None,
    expires: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="After 90d, 12h or 30m, or at 2027-01-31T12:00:00Z."),
    ] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Make a token. It is shown only this once."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.tokens import add_token  # noqa: PLC0415

    expires_at = None if expires is None else _expiry(expires, datetime.now(UTC))
    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        made, secret = add_token(
            connection,
            name,
            scope or ["read"],
            maps=map_name or None,
            expires_at=expires_at,
            created_by=f"semap token by {user()}",
        )
    if as_json:
        print_json({**_row(made), "token": secret})
        return
    say(secret)
    say("It is not shown again. Send it as: Authorization: Bearer TOKEN", err=True)


def list_(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the tokens, also those that have expired or were revoked."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.tokens import list_tokens  # noqa: PLC0415

    found: list[Token] = []
    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        while page := list_tokens(connection, after=found[-1].token_id if found else 0, limit=1000):
            found += page
    rows = [_row(each) if as_json else {**_row(each), **_shown(each)} for each in found]
    print_rows(rows, as_json, "There is no token. Make one: semap token add NAME --scope admin")


def revoke(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the token, or its id.")],
    dsn: Dsn = None,
) -> None:
    """Revoke a token. Its feeds and jobs end within seconds."""
    from semap.errors import NotFound  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.tokens import revoke_token, token_id_of  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        try:
            token_id = token_id_of(connection, name)
        except NotFound:
            if not re.fullmatch(r"[0-9]{1,9}", name):
                raise
            token_id = int(name)
        revoked = revoke_token(connection, token_id)
    say(f"{revoked.name} is revoked.")


def _expiry(text: str, now: datetime) -> datetime:
    """raises InvalidInput"""
    from semap.errors import InvalidInput  # noqa: PLC0415

    told = re.fullmatch(r"([0-9]{1,8})([mhdy])", text)
    if told is not None:
        after = int(told[1]) * UNITS[told[2]]
        if after <= LONGEST:
            return now + after
    try:
        at = datetime.fromisoformat(text)
    except ValueError:
        at = None
    if at is None or at.tzinfo is None:
        raise InvalidInput(
            f"{text} is no time", "Give 90d, 12h, 30m, or a time such as 2027-01-31T12:00:00Z.", "--expires"
        )
    return at


def _row(token: Token) -> dict[str, object]:
    return {
        "id": token.token_id,
        "name": token.name,
        "begins": token.hint,
        "scopes": list(token.scopes),
        "maps": None if token.maps is None else list(token.maps),
        "created_at": token.created_at,
        "created_by": token.created_by,
        "expires_at": token.expires_at,
        "last_used_at": token.last_used_at,
        "revoked_at": token.revoked_at,
    }


def _shown(token: Token) -> dict[str, object]:
    """What is a list, for people."""
    maps = "all" if token.maps is None else " ".join(token.maps) or "none"
    return {"scopes": " ".join(token.scopes), "maps": maps}
