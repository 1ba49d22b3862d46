"""semap rule"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from semap.errors import InvalidInput, NotFound
from semap_service.cli import rule_runs
from semap_service.cli.output import print_json, print_rows, say
from semap_service.cli.rule_arguments import MapOfRule, MapOption, RuleFile, RuleName, declaration_in
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from semap.store.event.rules import Rule

Backfill = Annotated[
    str | None,
    typer.Option(
        metavar="FROM", help="Run over what was stored from this stamp on as well, or over `all` of it."
    ),
]


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Rules: which events are made of what.")
    app.command("list")(list_all)
    app.command("show")(show)
    app.command("describe")(describe)
    app.command("versions")(versions)
    app.command("template")(template)
    app.command("add")(add)
    app.command("replace")(replace)
    app.command("enable")(enable)
    app.command("disable")(disable)
    app.command("delete")(delete)
    app.command("late")(late)
    rule_runs.add_to(app)
    return app


def list_all(map_name: MapOption = None, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the rules."""
    from semap.store.event.rules import list_rules  # noqa: PLC0415

    with _reading(dsn, map_name) as connection:
        _require_map(connection, map_name)
        found = list_rules(connection, map_name=map_name, limit=None)
    rows = [asdict(each) for each in found]
    if not as_json:
        shown = ("rule_id", "map", "name", "version", "enabled")
        rows = [
            {**{name: row[name] for name in shown}, "makes": _made_by(row["declaration"])} for row in rows
        ]
    print_rows(rows, as_json, "No rules. A map brings one with it: semap map import BUILDING.geojson")
    for each in found:
        if each.given_up is not None:
            say(f"Rule {each.name}: {each.given_up.as_text()}", err=True)


def _made_by(declaration: Mapping[str, object]) -> str:
    """The types of the events that a rule makes."""
    emit = declaration["emit"]
    return ", ".join(map(str, emit.values())) if isinstance(emit, Mapping) else str(emit)


def show(
    rule: RuleName,
    map_name: MapOfRule = None,
    form: Annotated[
        Literal["json", "yaml", "sql"],
        typer.Option("--as", help="yaml and sql are what `rule add` takes; sql of row patterns only."),
    ] = "json",
    dsn: Dsn = None,
) -> None:
    """Show a rule."""
    from semap.rules.language.reading import parse_declaration  # noqa: PLC0415
    from semap.rules.language.sql_written import write_sql  # noqa: PLC0415
    from semap.rules.language.written import write_rule  # noqa: PLC0415
    from semap.store.event.rules import find_rule  # noqa: PLC0415

    with _reading(dsn, map_name) as connection:
        found = find_rule(connection, rule, map_name)
        if form == "json":
            print_json(asdict(found))
        elif form == "yaml":
            say(write_rule(found.name, found.declaration).rstrip())
        else:
            say(write_sql(parse_declaration(found.declaration, found.name)))


def describe(
    rule: Annotated[
        str | None, typer.Argument(metavar="[RULE]", help="Name or number of a stored rule; or give --file.")
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option(help="A rule as YAML, JSON or SQL; - reads standard input.", allow_dash=True),
    ] = None,
    map_name: MapOfRule = None,
    dsn: Dsn = None,
) -> None:
    """Say in one sentence what a rule does, as it was read."""
    from semap.rules.language.described import describe as said_of  # noqa: PLC0415
    from semap.rules.language.reading import parse_declaration  # noqa: PLC0415
    from semap.store.event.rules import find_rule  # noqa: PLC0415

    if (rule is None) == (file is None):
        raise InvalidInput("one rule is needed", "Give the name of one, or --file FILE.", "RULE")
    if file is not None:
        say(said_of(declaration_in(file)))
        return
    with _reading(dsn, map_name) as connection:
        found = find_rule(connection, str(rule), map_name)
    say(said_of(parse_declaration(found.declaration, found.name)))


def versions(rule: RuleName, map_name: MapOfRule = None, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the versions of a rule from the first on; --json shows all that each declared."""
    from semap.store.event.rules import find_rule, list_versions  # noqa: PLC0415

    with _reading(dsn, map_name) as connection:
        rule_id = find_rule(connection, rule, map_name).rule_id
        rows = [asdict(found) for found in list_versions(connection, rule_id)]
    if not as_json:
        rows = [
            {
                **{name: row[name] for name in ("version", "name", "declared_at")},
                "makes": _made_by(row["declaration"]),
            }
            for row in rows
        ]
    print_rows(rows, as_json, "No versions.")


def template(
    name: Annotated[str | None, typer.Argument(help="The template; without one, all are listed.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="A parameter of it; may be given again."),
    ] = None,
) -> None:
    """Print a ready rule, to be used as it is or to be edited.

    For example: semap rule template dwell --set room=Kitchen | semap rule add - --map office
    """
    from semap.rules.language.template import TEMPLATES, fill  # noqa: PLC0415

    if name is None:
        for each in TEMPLATES.values():
            say(f"{each.name}: {each.sentence}")
            for parameter in each.parameters:
                setting = shlex.quote(f"{parameter.name}={parameter.default}")
                say(f"    --set {setting}    {parameter.meaning}")
        return
    given = dict(_setting(each) for each in settings or ())
    say(fill(name, **given).rstrip())


def _setting(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise InvalidInput(f"{text!r} sets nothing", "Write NAME=VALUE.", "--set")
    return name, value


def add(
    file: RuleFile,
    map_name: Annotated[str, typer.Option("--map", help="The map it is for.")],
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace the rule of this name if there is one.")
    ] = False,
    backfill: Backfill = None,
    dsn: Dsn = None,
) -> None:
    """Add a rule. It applies to new rows, and with --backfill to stored ones, too.

    For example, both edges of a query in one declaration:

        name: kitchen_visits
        input: track_in_room
        emit: {began: came, ended: went}
    """
    from semap.store.event.rules import find_rule  # noqa: PLC0415
    from semap_service.database.rule_edit import add_rule, backfill_stamp, replace_rule  # noqa: PLC0415

    declaration = declaration_in(file)
    since = None if backfill is None else backfill_stamp(backfill)
    with _editing(dsn, map_name) as connection:
        try:
            known = find_rule(connection, declaration.name, map_name) if replace else None
        except NotFound as error:
            if error.kind != "rule":
                raise
            known = None
        if known is not None:
            done = replace_rule(connection, known.rule_id, declaration, since)
        else:
            done = add_rule(connection, map_name, declaration, since)
    _say(done, "made" if known is None else "replaced")


def replace(
    rule: RuleName,
    file: RuleFile,
    map_name: MapOfRule = None,
    backfill: Backfill = None,
    dsn: Dsn = None,
) -> None:
    """Replace the declaration of a rule by a new version; the state of the former one is dropped."""
    from semap.store.event.rules import find_rule  # noqa: PLC0415
    from semap_service.database.rule_edit import backfill_stamp, replace_rule  # noqa: PLC0415

    since = None if backfill is None else backfill_stamp(backfill)
    with _editing(dsn, map_name) as connection:
        known = find_rule(connection, rule, map_name)
        done = replace_rule(connection, known.rule_id, declaration_in(file, known.name), since)
    _say(done, "replaced")


def enable(rule: RuleName, map_name: MapOfRule = None, dsn: Dsn = None) -> None:
    """Enable a rule: it makes events from now on."""
    _enable(rule, map_name, True, dsn)


def disable(rule: RuleName, map_name: MapOfRule = None, dsn: Dsn = None) -> None:
    """Disable a rule: it makes no events."""
    _enable(rule, map_name, False, dsn)


def delete(rule: RuleName, map_name: MapOfRule = None, dsn: Dsn = None) -> None:
    """Delete a rule that no other reads; the events that it made stay."""
    from semap.store.event.rules import find_rule  # noqa: PLC0415
    from semap_service.database.rule_edit import delete_rule  # noqa: PLC0415

    with _editing(dsn, map_name) as connection:
        known = find_rule(connection, rule, map_name)
        delete_rule(connection, known.rule_id)
    say(f"Rule {known.rule_id} deleted: {known.name}.")


def late(map_name: MapOption = None, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """Count late rows, which came behind the watermark, by map and input."""
    from semap.store.event.late_rows import count_late_rows  # noqa: PLC0415

    with _reading(dsn, map_name) as connection:
        _require_map(connection, map_name)
        rows = [asdict(found) for found in count_late_rows(connection, map_name=map_name)]
    print_rows(rows, as_json, "No row came late.")


def _require_map(connection: Connection, map_name: str | None) -> None:
    """raises NotFound for a name that is no map's"""
    from semap.store.map.maps import get_map  # noqa: PLC0415

    if map_name is not None:
        get_map(connection, map_name)


def _enable(rule: str, map_name: str | None, enabled: bool, dsn: str | None) -> None:
    from semap.store.event.rules import enable_rule, find_rule  # noqa: PLC0415

    with _editing(dsn, map_name) as connection:
        done = enable_rule(connection, find_rule(connection, rule, map_name).rule_id, enabled)
    say(f"Rule {done.name} is {'enabled' if done.enabled else 'disabled'}.")


def _say(done: Rule, what: str) -> None:
    over = f", over {', '.join(done.queries)}" if done.queries else ""
    past = "" if done.backfill_from is None else "; it runs over the past as well"
    say(f"Rule {done.rule_id} {what}: {done.name}, version {done.version}{over}{past}.")


@contextmanager
def _reading(dsn: str | None, map_name: str | None) -> Iterator[Connection]:
    from semap.store.database.connection import one_transaction  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        yield connection


@contextmanager
def _editing(dsn: str | None, map_name: str | None) -> Iterator[Connection]:
    from semap.store.database.connection import one_transaction  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_api") as connection:
        yield connection
