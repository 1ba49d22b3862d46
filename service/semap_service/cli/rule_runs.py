"""semap rule test, explain, learn, replay-late: rules over what is stored."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from typing import TYPE_CHECKING, Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.events import sentence
from semap_service.cli.output import counted, print_json
from semap_service.cli.rule_arguments import MapOfRule, MapOption, RuleFile, RuleName, declaration_in
from semap_service.cli.session import AsJson, Dsn, database
from semap_service.cli.stamp import From, To, read_stamp

if TYPE_CHECKING:
    from semap.model.event import Event
    from semap.model.given_up import GivenUp
    from semap.rules.declaration import Declaration
    from semap.store.rules import Rule


def add_to(app: typer.Typer) -> None:
    """The commands, beside those that edit rules."""
    app.command("test")(dry_run)
    app.command("explain")(explain)
    app.command("learn")(learn)
    app.command("replay-late")(replay_late)


def dry_run(
    file: RuleFile,
    map_name: Annotated[str, typer.Option("--map", help="The map whose history it runs over.")],
    start: From = None,
    end: To = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show the events that a rule would have made over stored history; nothing is written."""
    from semap.store.database import connect  # noqa: PLC0415
    from semap.worker import past  # noqa: PLC0415

    declaration = declaration_in(file)
    given_up: list[GivenUp] = []
    with database(dsn) as opened, connect(opened, "semap_read") as connection:
        events = past.dry_run(
            connection, map_name, declaration, start, end, tell=lambda rule, what: given_up.append(what)
        )
    for what in given_up:
        typer.echo(what.as_text(), err=True)
    if as_json:
        print_json([asdict(event) for event in events])
        return
    for number, event in enumerate(events, 1):
        typer.echo(sentence(_line(number, event)))
    typer.echo(f"{counted(len(events), 'event')}; nothing was written.", err=True)


def explain(
    rule: RuleName,
    at: Annotated[
        datetime, typer.Option(parser=read_stamp, metavar="STAMP", help="Such as 2026-01-31T12:00:00Z.")
    ],
    keys: Annotated[
        list[str] | None,
        typer.Option("--key", metavar="NAME=VALUE", help="Of what, such as room=Room07; may be given again."),
    ] = None,
    map_name: MapOfRule = None,
    dsn: Dsn = None,
) -> None:
    """Explain why a rule matched at a time, or how far it matched and which condition failed."""
    from semap.store.database import connect  # noqa: PLC0415
    from semap.worker.why import explain as explain_rule  # noqa: PLC0415

    key = dict(_named(each) for each in keys or ())
    with database(dsn) as opened:
        declaration, found = _declared(opened, rule, map_name)
        with connect(opened, "semap_read") as connection:
            typer.echo(explain_rule(connection, found.map, declaration, at, key).as_text())
    if found.given_up is not None:
        typer.echo(f"Since version {found.version} is in force: {found.given_up.as_text()}")


def learn(
    rule: RuleName,
    start: From = None,
    end: To = None,
    only_show: Annotated[
        bool, typer.Option("--dry-run", help="Show the parameters, and keep the rule.")
    ] = False,
    map_name: MapOfRule = None,
    dsn: Dsn = None,
) -> None:
    """Fit the confidence of a rule to the gaps in stored history, as its next version."""
    from semap.store.database import connect, one_transaction  # noqa: PLC0415
    from semap.worker.past import learnt  # noqa: PLC0415
    from semap_service.database.rule_edit import replace_rule  # noqa: PLC0415

    with database(dsn) as opened:
        declaration, found = _declared(opened, rule, map_name)
        with connect(opened, "semap_read") as connection:
            fitted = learnt(connection, found.map, declaration, start, end)
        version = ""
        if not only_show:
            with one_transaction(opened, "semap_api") as editing:
                done = replace_rule(editing, found.rule_id, fitted)
            version = f" is at version {done.version}"
    parameters = fitted.confidence.parameters if fitted.confidence is not None else {}
    said = ", ".join(f"{name} {value:.4g}" for name, value in parameters.items())
    typer.echo(f"Rule {fitted.name}{version}: {said}.")


def replay_late(map_name: MapOption = None, dsn: Dsn = None) -> None:
    """Evaluate late rows, and add the missing events."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.maps import get_map  # noqa: PLC0415
    from semap.worker.late_replay import replay_late as replay  # noqa: PLC0415

    with database(dsn) as opened:
        if map_name is not None:
            with one_transaction(opened, "semap_read") as connection:
                get_map(connection, map_name)
        done = replay(opened, map_name)
    for name, what in done.given_up.items():
        typer.echo(f"Rule {name}: {what.as_text()}", err=True)
    typer.echo(f"{counted(done.rows, 'late row')} replayed; {counted(done.events, 'event')} added.")


def _declared(dsn: str, rule: str, map_name: str | None) -> tuple[Declaration, Rule]:
    """What a stored rule declares, and the rule itself."""
    from semap.rules.language.reading import parse_declaration  # noqa: PLC0415
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.rules import find_rule  # noqa: PLC0415

    with one_transaction(dsn, "semap_read") as connection:
        found = find_rule(connection, rule, map_name)
    return parse_declaration(found.declaration, found.name), found


def _line(number: int, event: Event) -> dict[str, object]:
    return {
        **asdict(event),
        "seq": number,
        "track": event.track_name,
        "instance": event.instance_name,
        "verdict": None,
        "amended_by": None,
    }


def _named(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise InvalidInput(f"{text!r} names nothing", "Write NAME=VALUE, such as room=Room07.", "--key")
    return name, value
