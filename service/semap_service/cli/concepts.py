"""semap concept"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.output import print_json, print_rows, say
from semap_service.cli.session import AsJson, Dsn, database, signed_edit

Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the concept.")]


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Concepts: the taxonomy of instances and tracks.")
    app.command("list")(list_all)
    app.command("show")(show)
    app.command("add")(add)
    return app


def list_all(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the taxonomy. A query for a concept includes all concepts below it."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.concept import list_concepts  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        found = list_concepts(connection)
    if as_json:
        print_json([asdict(each) for each in found])
        return
    print_rows(
        [
            {"name": each.name, "parents": ", ".join(each.parents) or None, "comment": each.comment or None}
            for each in found
        ],
        as_json,
        "No concepts.",
    )


def show(name: Name, dsn: Dsn = None) -> None:
    """Show a concept as JSON: its parents, IRIs, comment and the schema of its attributes."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.concept import get_concept  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        print_json(asdict(get_concept(connection, name)))


def add(
    name: Name,
    parent: Annotated[
        list[str] | None,
        typer.Option(help="A concept right above it; may be given several times. [default: Thing]"),
    ] = None,
    iri: Annotated[
        list[str] | None, typer.Option(help="Its IRI in another vocabulary; may be given several times.")
    ] = None,
    comment: Annotated[str | None, typer.Option(help="Its definition.")] = None,
    schema: Annotated[
        Path | None, typer.Option(help="A JSON Schema that the attributes of its instances follow.")
    ] = None,
    dsn: Dsn = None,
) -> None:
    """Add a concept below others.

    semap concept add Kitchen --parent Room --iri https://brickschema.org/schema/Brick#Kitchen
    """
    from semap.store.map.concept import ROOT, Concept, create_concept  # noqa: PLC0415

    attribute_schema = None if schema is None else _schema(schema)
    new = Concept(0, name, tuple(parent or (ROOT,)), tuple(iri or ()), comment, attribute_schema)
    with database(dsn) as opened, signed_edit(opened, f"semap concept add {name}") as connection:
        made = create_concept(connection, new)
    say(f"Concept {made.name} made, below {', '.join(made.parents)}.")


def _schema(path: Path) -> dict[str, object]:
    try:
        found = json.loads(path.read_text())
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read: {error.strerror}", "Check the path.") from error
    except ValueError as error:
        raise InvalidInput(f"not JSON: {error}", "See https://json-schema.org.", str(path)) from error
    if not isinstance(found, dict):
        raise InvalidInput("not a JSON object", "See https://json-schema.org.", str(path))
    return found
