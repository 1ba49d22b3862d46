"""The command line. Each command imports what it needs when it runs, so that --help is quick."""

from __future__ import annotations

import logging
import sys

import typer

from semap import __version__
from semap.errors import CallerError, SemapError
from semap_service.cli import (
    bridges,
    concepts,
    database,
    demo,
    detectors,
    doctor,
    doors,
    evaluate,
    event_log,
    events,
    ingest,
    jobs,
    maps,
    plot,
    processes,
    queries,
    recompute,
    recording,
    relations,
    relay,
    rigs,
    rules,
    shards,
    simulate,
    sources,
    tokens,
    tracks,
    webhooks,
)
from semap_service.cli.output import say, visible

HELP = """
A semantic map with continuous queries, on PostGIS.

A building goes in, movement goes in, events come out:

    semap up                                    start the server, the rule worker and the service

    semap map import office.geojson             in another terminal: import a building

    semap ingest tracks walk.csv --map office   import tracks

    semap events --follow                       show entries and exits of rooms

Without SEMAP_DSN, semap keeps a PostGIS server of its own in SEMAP_HOME and starts it when needed.
"""


def commands() -> typer.Typer:
    """All commands, put together."""
    app = typer.Typer(
        name="semap",
        help=HELP,
        no_args_is_help=True,
        add_completion=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    app.command("up")(processes.up)
    app.command("demo")(demo.demo)
    app.add_typer(maps.commands(), name="map")
    app.add_typer(concepts.commands(), name="concept")
    app.add_typer(ingest.commands(), name="ingest")
    app.add_typer(recording.commands(), name="recording")
    app.add_typer(rigs.commands(), name="rig")
    app.add_typer(detectors.commands(), name="detector")
    app.command("events")(events.events)
    app.add_typer(bridges.commands(), name="bridge")
    app.add_typer(queries.commands(), name="query")
    app.command("relations")(relations.relations)
    app.add_typer(rules.commands(), name="rule")
    app.add_typer(tracks.commands(), name="track")
    app.add_typer(sources.commands(), name="source")
    app.add_typer(tokens.commands(), name="token")
    app.add_typer(webhooks.commands(), name="webhook")
    app.add_typer(jobs.commands(), name="job")
    app.add_typer(doors.commands(), name="door")
    app.command("recompute")(recompute.recompute)
    app.add_typer(event_log.log_commands(), name="log")
    app.add_typer(plot.commands(), name="plot")
    app.add_typer(simulate.commands(), name="simulate")
    app.add_typer(evaluate.commands(), name="evaluate")
    app.command("work")(processes.work)
    app.command("serve")(processes.serve)
    app.command("publish")(relay.publish)
    app.command("derive")(relay.derive)
    app.command("collect")(relay.collect)
    app.add_typer(relay.commands(), name="flink")
    app.add_typer(shards.commands(), name="shard")
    app.command("doctor")(doctor.doctor)
    app.add_typer(database.commands(), name="db")
    return app


def main() -> None:
    """Run the command line: exit status 0, 1 for a failure, 2 for a wrong call, 130 for Ctrl-C."""
    try:
        commands()(standalone_mode=True)
    except SemapError as error:
        from semap_service.operations.redaction import redacted  # noqa: PLC0415

        sys.stderr.write(f"semap: {visible(redacted(str(error)))}\n")
        if error.remedy:
            sys.stderr.write(f"  What to do: {visible(error.remedy)}\n")
        sys.exit(2 if isinstance(error, CallerError) else 1)
    except UnicodeEncodeError as error:
        sys.stderr.write(f"semap: what was given is no text in UTF-8: {error.object!a}\n")
        sys.exit(2)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except KeyboardInterrupt:
        sys.exit(130)


def _version(wanted: bool) -> None:
    if wanted:
        say(f"semap {__version__}")
        raise typer.Exit


def _options(
    verbose: bool = typer.Option(False, "--verbose", "-v", help="Say more about what is done."),
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version."
    ),
) -> None:
    level = logging.DEBUG if verbose else logging.INFO
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(name)s: %(message)s", datefmt="%H:%M:%S")
    for name in ("semap", "semap_ingest", "semap_service"):
        logging.getLogger(name).setLevel(level if verbose else logging.WARNING)
