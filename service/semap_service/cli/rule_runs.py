"""semap rule test, explain, verify, learn, mine, replay-late: rules over what is stored."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semap.errors import InvalidInput
from semap_service.cli.events import sentence
from semap_service.cli.output import counted, print_json, say
from semap_service.cli.rule_arguments import MapOfRule, MapOption, RuleFile, RuleName, declaration_in
from semap_service.cli.session import AsJson, Dsn, database
from semap_service.cli.stamp import From, To, read_stamp
from semap_service.cli.written_file import written

if TYPE_CHECKING:
    from semap.model.event import Event
    from semap.model.given_up import GivenUp
    from semap.rules.declaration import Declaration
    from semap.store.event.rules import Rule


def add_to(app: typer.Typer) -> None:
    """The commands, beside those that edit rules."""
    app.command("test")(dry_run)
    app.command("explain")(explain)
    app.command("verify")(verify)
    app.command("learn")(learn)
    app.command("mine")(mine)
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
    from semap.store.database.connection import connect  # noqa: PLC0415
    from semap.worker import past  # noqa: PLC0415

    declaration = declaration_in(file)
    given_up: list[GivenUp] = []
    with database(dsn, map_name) as opened, connect(opened, "semap_read") as connection:
        events = past.dry_run(
            connection, map_name, declaration, start, end, tell=lambda rule, what: given_up.append(what)
        )
    for what in given_up:
        say(what.as_text(), err=True)
    if as_json:
        print_json([asdict(event) for event in events])
        return
    for number, event in enumerate(events, 1):
        typer.echo(sentence(_line(number, event)))
    say(f"{counted(len(events), 'event')}; nothing was written.", err=True)


def explain(
    rule: RuleName,
    at: Annotated[
        datetime | None,
        typer.Option(
            parser=read_stamp, metavar="STAMP", help="Such as 2026-01-31T12:00:00Z; or give a span."
        ),
    ] = None,
    start: From = None,
    end: To = None,
    keys: Annotated[
        list[str] | None,
        typer.Option(
            "--key",
            metavar="NAME=VALUE",
            help="Of what, such as room=Room07; may be given again. Without one, of all keys.",
        ),
    ] = None,
    certificate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write what it rests on, for `semap rule verify`; - is standard output.",
            allow_dash=True,
        ),
    ] = None,
    map_name: MapOfRule = None,
    dsn: Dsn = None,
) -> None:
    """Explain why a rule matched at a time, or how far it matched and which condition failed.

    Of all keys, or of a span of time: its events, and the attempts that came furthest, each with the row or
    the silence that ended it.
    """
    from semap.store.database.connection import connect  # noqa: PLC0415
    from semap.worker import why  # noqa: PLC0415

    key = dict(_named(each) for each in keys or ())
    span = _span(at, start, end)
    with database(dsn, map_name) as opened:
        declaration, found = _declared(opened, rule, map_name)
        with connect(opened, "semap_read") as connection:
            if certificate is None and at is not None and set(key) == set(declaration.partition_by):
                say(why.explain(connection, found.map, declaration, at, key).as_text())
            else:
                _certified(
                    why.certify(connection, found.map, declaration, span, key, found.version), certificate
                )
    if found.given_up is not None:
        is_piped = str(certificate) == "-"
        say(f"Since version {found.version} is in force: {found.given_up.as_text()}", err=is_piped)


def _span(at: datetime | None, start: datetime | None, end: datetime | None) -> tuple[datetime, datetime]:
    if at is not None and start is None and end is None:
        return at, at
    if at is not None or start is None or end is None:
        raise InvalidInput("a moment is needed, or a span", "Give --at, or --from and --to.", "--at")
    if end <= start:
        raise InvalidInput("it ends before it begins", "Give the earlier stamp first.", "--to")
    return start, end


def _certified(document: dict[str, object], file: Path | None) -> None:
    """What a certificate says, as its checker reads it; and the certificate itself where it is wanted."""
    from semap.certificate import Wrong  # noqa: PLC0415

    if file is not None and str(file) == "-":
        print_json(document)
        return
    if file is not None:
        with written(file) as draft:
            draft.write_text(json.dumps(document, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
    try:
        lines = _checked(document)
    except Wrong as error:
        remedy = (
            "Where the rule gave something up, ask for a shorter span; else report it with its certificate."
        )
        raise InvalidInput(f"engine and checker do not agree: {error}", remedy) from error
    for line in lines:
        say(line)


def _checked(document: Any) -> list[str]:
    """What a certificate says.

    raises Wrong, where it does not hold; InvalidInput, where that is too much work
    """
    from semap.certificate import Unable  # noqa: PLC0415
    from semap.certificate import verify as check  # noqa: PLC0415

    try:
        return check(document)
    except Unable as error:
        raise InvalidInput(f"it cannot be checked: {error}", "Ask for a shorter span, or one key.") from error


def verify(
    file: Annotated[
        Path,
        typer.Argument(help="Of `explain --certificate`; - is standard input.", allow_dash=True),
    ],
    stored: Annotated[
        bool, typer.Option("--stored", help="Also compare its rule and its rows with what the database has.")
    ] = False,
    dsn: Dsn = None,
) -> None:
    """Check a certificate by itself: whether what it claims follows from the rule and the rows in it.

    The checker is one file that knows nothing of the engine, and runs alone: python -m semap.certificate FILE
    """
    from semap.certificate import Wrong  # noqa: PLC0415

    try:
        text = sys.stdin.read() if str(file) == "-" else file.read_text(encoding="utf-8")
        document = json.loads(text)
        lines = _checked(document)
    except OSError as error:
        raise InvalidInput(f"{file} cannot be read: {error.strerror}", "Check the path.") from error
    except ValueError as error:
        what = str(error) if isinstance(error, Wrong) else "it is no JSON"
        raise InvalidInput(f"the certificate does not hold: {what}", "Trust nothing of it.") from error
    if stored:
        _require_stored(document, dsn)
        lines.append("Its rule and its rows are those that are stored.")
    for line in lines:
        say(line)


def _require_stored(document: dict[str, Any], dsn: str | None) -> None:
    """raises InvalidInput where the database would give another certificate of the same span"""
    from semap.rules.language.reading import parse_declaration  # noqa: PLC0415
    from semap.store.database.connection import connect, one_transaction  # noqa: PLC0415
    from semap.store.event.rules import find_rule, list_versions  # noqa: PLC0415
    from semap.worker.why import certificate_is_stored  # noqa: PLC0415

    with database(dsn, document["map"]) as opened:
        with one_transaction(opened, "semap_read") as connection:
            found = find_rule(connection, document["rule"]["name"], document["map"])
            versions = {each.version: each for each in list_versions(connection, found.rule_id)}
        version = versions.get(document["version"])
        declared = None if version is None else parse_declaration(version.declaration, version.name)
        if declared is None or {"name": declared.name, **declared.document} != document["rule"]:
            raise InvalidInput(
                f"the rule {found.name} was not so in version {document['version']}",
                "List its versions: semap rule versions",
            )
        with connect(opened, "semap_read") as reading:
            if not certificate_is_stored(reading, found.map, declared, document):
                raise InvalidInput(
                    "other rows are stored than the certificate has",
                    "They came, or were changed, since; or the certificate leaves some out.",
                )


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
    from semap.store.database.connection import connect, one_transaction  # noqa: PLC0415
    from semap.worker.past import learnt  # noqa: PLC0415
    from semap_service.database.rule_edit import replace_rule  # noqa: PLC0415

    with database(dsn, map_name) as opened:
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
    say(f"Rule {fitted.name}{version}: {said}.")


def mine(
    map_name: Annotated[str, typer.Option("--map", help="The map whose log is looked at.")],
    inputs: Annotated[
        list[str] | None,
        typer.Option(
            "--input",
            help="A query, rule or property of objects; again for more. Else all rules.",
        ),
    ] = None,
    start: From = None,
    end: To = None,
    within: Annotated[str, typer.Option(help="What takes longer is not looked for.")] = "5 min",
    support: Annotated[int, typer.Option(min=1, help="So often at least.")] = 5,
    confidence: Annotated[
        float, typer.Option(min=0, max=1, help="Of what begins, so much at least goes on.")
    ] = 0.5,
    most: Annotated[int, typer.Option("--most", min=1, help="So many are shown.")] = 10,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Propose rules: what in the log often follows what, and how soon, each with a dry run.

    What is printed are rules in YAML, to be read, and added with `semap rule add`. Nothing is written.
    """
    from semap.rules.language.described import describe  # noqa: PLC0415
    from semap.rules.language.duration import read_duration  # noqa: PLC0415
    from semap.rules.language.written import write_rule  # noqa: PLC0415
    from semap.rules.mining import Wanted  # noqa: PLC0415
    from semap.store.database.connection import connect  # noqa: PLC0415
    from semap.worker.past import mined  # noqa: PLC0415

    wanted = Wanted(read_duration(within, "--within"), support, confidence)
    with database(dsn, map_name) as opened, connect(opened, "semap_read") as connection:
        found = mined(connection, map_name, wanted, inputs or (), start, end, most)
    proposals = [each.proposal for each in found]
    if as_json:
        print_json(
            [
                {
                    "name": proposal.declaration.name,
                    "declaration": proposal.declaration.document,
                    "support": proposal.support,
                    "confidence": proposal.confidence,
                    "by_chance": proposal.by_chance,
                    "events": [asdict(event) for event in each.events],
                }
                for proposal, each in zip(proposals, found, strict=True)
            ]
        )
        return
    for proposal, each in zip(proposals, found, strict=True):
        declaration = proposal.declaration
        said = (
            f"{proposal.support} of {counted(proposal.firsts, 'time')} ({proposal.confidence:.0%};"
            f" by chance {proposal.by_chance:.0%}); a dry run makes {counted(len(each.events), 'event')}."
        )
        say(f"---\n# {said}\n# {describe(declaration)}")
        say(write_rule(declaration.name, declaration.document).rstrip())
    say(f"{counted(len(found), 'rule')} proposed; none was added.", err=True)
    if not found:
        looked = "these" if inputs else "the events of rules alone"
        say(
            f"  What to do: Looked at were {looked}. Name queries and properties of objects that have rows"
            " then, such as --input track_in_room --input door, or ask for less: --support, --confidence.",
            err=True,
        )


def replay_late(map_name: MapOption = None, dsn: Dsn = None) -> None:
    """Evaluate late rows, and add the missing events."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap.worker.late_replay import replay_late as replay  # noqa: PLC0415

    with database(dsn, map_name) as opened:
        if map_name is not None:
            with one_transaction(opened, "semap_read") as connection:
                get_map(connection, map_name)
        done = replay(opened, map_name)
    for name, what in done.given_up.items():
        say(f"Rule {name}: {what.as_text()}", err=True)
    say(f"{counted(done.rows, 'late row')} replayed; {counted(done.events, 'event')} added.")


def _declared(dsn: str, rule: str, map_name: str | None) -> tuple[Declaration, Rule]:
    """What a stored rule declares, and the rule itself."""
    from semap.rules.language.reading import parse_declaration  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.rules import find_rule  # noqa: PLC0415

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
