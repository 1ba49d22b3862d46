"""semap rule"""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.output import print_json, print_rows
from semap_service.cli.session import AsJson, Dsn, database

MapOption = Annotated[str | None, typer.Option("--map", help="Only those of this map.")]
RuleId = Annotated[
    int, typer.Argument(metavar="ID", help="Number of the rule, as `semap rule list` shows it.")
]


def commands() -> typer.Typer:
    app = typer.Typer(
        no_args_is_help=True, help="Rules: which events are made of which changes of relations."
    )
    app.command("list")(list_all)
    app.command("show")(show)
    app.command("add")(add)
    app.command("enable")(enable)
    app.command("disable")(disable)
    app.command("delete")(delete)
    return app


def list_all(map_name: MapOption = None, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the rules."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.rules import list_rules  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        rows = [asdict(found) for found in list_rules(connection, map_name=map_name, limit=1000)]
    print_rows(rows, as_json, "No rules. A map brings one with it: semap map import BUILDING.geojson")


def show(rule_id: RuleId, dsn: Dsn = None) -> None:
    """Show a rule as JSON."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.rules import get_rule  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        print_json(asdict(get_rule(connection, rule_id)))


def add(
    file: Annotated[
        Path, typer.Argument(help="The rule as YAML or JSON; - reads standard input.", allow_dash=True)
    ],
    map_name: Annotated[str, typer.Option("--map", help="The map it is for.")],
    dsn: Dsn = None,
) -> None:
    """Add a rule. It is in force from its place in the log on.

    For example, both edges of a query in one declaration:

        name: kitchen_visits
        input: track_in_room
        emit: {began: came, ended: went}
    """
    from semap.rules.declaration import parse_declaration  # noqa: PLC0415
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.rules import add_rule  # noqa: PLC0415

    declaration = parse_declaration(_document(file))
    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        made = add_rule(connection, map_name, declaration)
    typer.echo(f"Rule {made.rule_id} made: {made.name}, over the query {made.query}.")


def _document(file: Path) -> object:
    import yaml  # noqa: PLC0415

    try:
        return yaml.safe_load(sys.stdin.read() if str(file) == "-" else file.read_text())
    except OSError as error:
        raise InvalidInput(f"{file} cannot be read: {error.strerror}", "Check the path.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InvalidInput(
            f"not YAML or JSON: {error}", "Mend the file; see `semap rule add --help`.", str(file)
        ) from error


def enable(rule_id: RuleId, dsn: Dsn = None) -> None:
    """Let a rule make events again, from now on."""
    _enable(rule_id, True, dsn)


def disable(rule_id: RuleId, dsn: Dsn = None) -> None:
    """Let a rule make no events."""
    _enable(rule_id, False, dsn)


def _enable(rule_id: int, enabled: bool, dsn: str | None) -> None:
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.rules import enable_rule  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        done = enable_rule(connection, rule_id, enabled)
    typer.echo(f"Rule {done.name} is {'enabled' if done.enabled else 'disabled'}.")


def delete(rule_id: RuleId, dsn: Dsn = None) -> None:
    """Delete a rule; the events that it made stay."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.rules import delete_rule  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        delete_rule(connection, rule_id)
    typer.echo(f"Rule {rule_id} deleted.")
