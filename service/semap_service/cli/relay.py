"""semap publish, derive, collect, flink"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from semap_service.cli.log_options import LogFormatOption, LogLevelOption
from semap_service.cli.output import say
from semap_service.cli.processes import at_work
from semap_service.cli.session import Dsn, database
from semap_service.operations.log_lines import LogFormat, write_log

if TYPE_CHECKING:
    from semap_bridge.relay.topics import Topics

Shard = Annotated[str, typer.Option(help="Name of this database among those that share the topics.")]
Kafka = Annotated[
    str,
    typer.Option(
        envvar="SEMAP_KAFKA_SERVERS",
        metavar="SERVERS|FILE",
        help="Brokers, such as kafka1:9092,kafka2:9092, or a file of YAML with servers, login and tls.",
        show_default=False,
    ),
]
State = Annotated[Path, typer.Option(help="File that keeps what rules have under way.", show_default=False)]
Prefix = Annotated[str, typer.Option(help="Of the topics: PREFIX.due and PREFIX.events.")]


FlinkPython = Annotated[
    Path,
    typer.Option(
        envvar="SEMAP_FLINK_PYTHON",
        help="Interpreter that has PyFlink, shapely and PyYAML.",
        show_default=False,
    ),
]
Connector = Annotated[
    Path,
    typer.Option(
        envvar="SEMAP_FLINK_CONNECTOR", help="The JAR flink-sql-connector-kafka.", show_default=False
    ),
]


def publish(
    kafka: Kafka,
    shard: Shard = "main",
    prefix: Prefix = "semap",
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
    dsn: Dsn = None,
) -> None:
    """Run the first half of the rule worker, in place of `semap work`: what rules are to take goes to Kafka.

    Rules are handed over with all that they have under way. From then on they run elsewhere (`semap derive`),
    and `semap collect` writes their events.
    """
    from semap.worker.publishing import Publishing  # noqa: PLC0415
    from semap.worker.rule_worker import work  # noqa: PLC0415
    from semap_service.processes.supervisor import stop_signal  # noqa: PLC0415

    write_log(log_format, log_level)
    stop, topics = stop_signal(), _topics(kafka, prefix)
    topics.make()
    send = topics.sender(topics.due).send
    say(f"Publishing to {topics.due} as {shard} (Ctrl-C stops it).")
    with at_work("semap publish", dsn) as opened:
        work(opened, stop, partial(Publishing, shard=shard, send=send))


def derive(
    kafka: Kafka,
    state: Annotated[
        Path, typer.Option(help="File that keeps what rules have under way.", show_default=False)
    ],
    prefix: Prefix = "semap",
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
) -> None:
    """Run the second half of the rule worker, the rules of all maps, in one process without a database."""
    from semap_service.processes.supervisor import stop_signal  # noqa: PLC0415

    write_log(log_format, log_level)
    stop, topics = stop_signal(), _topics(kafka, prefix)
    from semap_bridge.relay.deriving import derive as run  # noqa: PLC0415

    topics.make()
    say(f"Rules take what comes in {topics.due} (Ctrl-C stops it).")
    run(topics, state, stop)


def collect(
    kafka: Kafka,
    shard: Shard = "main",
    prefix: Prefix = "semap",
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
    dsn: Dsn = None,
) -> None:
    """Write the events of rules that run elsewhere into the database, each once, numbered as they come."""
    from semap_service.operations.tracing import traced  # noqa: PLC0415
    from semap_service.processes.supervisor import stop_signal  # noqa: PLC0415

    write_log(log_format, log_level)
    stop, topics = stop_signal(), _topics(kafka, prefix)
    from semap_bridge.relay.collecting import collecting  # noqa: PLC0415

    topics.make()
    say(f"Writing what comes in {topics.events} (Ctrl-C stops it).")
    with traced("semap collect"), database(dsn) as opened:
        collecting(opened, topics, shard, stop)


def commands() -> typer.Typer:
    app = typer.Typer(help="Rules on Apache Flink.", no_args_is_help=True)
    app.command("submit")(submit)
    app.command("check")(check)
    return app


def submit(
    kafka: Kafka,
    python: FlinkPython,
    connector: Connector,
    checkpoints: Annotated[Path, typer.Option(help="Folder for checkpoints.", show_default=False)],
    parallelism: Annotated[int, typer.Option(min=1, help="How many tasks share the maps.")] = 1,
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="A setting of Flink. More than once."),
    ] = None,
    prefix: Prefix = "semap",
) -> None:
    """Run the rules of all maps on Flink, in a cluster of this process, in place of `semap derive`.

    Begun again, it takes up where the newest checkpoint of the folder was.
    """
    from semap.errors import InvalidInput, ServiceUnreachable  # noqa: PLC0415
    from semap_service.processes.supervisor import stop_signal  # noqa: PLC0415

    if Path(kafka).is_file():
        raise InvalidInput("brokers with a login are not reached from Flink", "Give --kafka HOST:PORT.")
    stop, topics = stop_signal(), _topics(kafka, prefix)
    from semap_bridge.relay.flink import Job, running  # noqa: PLC0415

    topics.make()
    job = Job(kafka, prefix, python, connector, checkpoints, parallelism, setting or ())
    newest = job.newest()
    where = "from the first step on" if newest is None else f"from checkpoint {newest}"
    with running(job) as process:
        say(f"Rules take what comes in {topics.due}, {where} (Ctrl-C stops it).")
        while not stop.wait(1):
            if process.poll() is not None:
                raise ServiceUnreachable("The job ended.", f"See the log in {checkpoints}.")


def check(
    kafka: Kafka,
    map_name: Annotated[str, typer.Option("--map", help="Name of the map.", show_default=False)],
    prefix: Prefix = "semap",
    dsn: Dsn = None,
) -> None:
    """Take all steps of a map once more, here, and compare the events with those in the topic, ids and rows.

    The exit status is 1 where they differ. The topic of steps has to reach back to the first.
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        uid = str(get_map(connection, map_name).uid)
    topics = _topics(kafka, prefix)
    from semap_bridge.relay.collecting import check as compare  # noqa: PLC0415

    found = compare(topics, uid)
    say(f"{found.same} events are the same.")
    others = {
        "different": found.different,
        "missing in the topic": found.missing,
        "only in the topic": found.unknown,
    }
    for what, ids in others.items():
        if ids:
            say(f"{len(ids)} are {what}: {', '.join(ids[:10])}{' ...' if len(ids) > 10 else ''}")
    if found.different or found.missing or found.unknown:
        raise typer.Exit(1)


def _topics(kafka: str, prefix: str) -> Topics:
    from importlib.util import find_spec  # noqa: PLC0415

    from semap.errors import InvalidInput  # noqa: PLC0415

    if find_spec("confluent_kafka") is None:
        raise InvalidInput("Kafka needs the package confluent-kafka", "pip install 'semap[kafka]'")
    from semap_bridge.relay.topics import Topics  # noqa: PLC0415

    return Topics(kafka, prefix)
