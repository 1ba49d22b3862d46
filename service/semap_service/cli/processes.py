"""semap up, work, serve"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from semap_service.cli.log_options import LogFormatOption, LogLevelOption
from semap_service.cli.output import say
from semap_service.cli.session import Dsn, database
from semap_service.cli.shards import own_shards
from semap_service.operations.log_lines import LogFormat, write_log

Host = Annotated[str, typer.Option(envvar="SEMAP_HOST", help="Address to listen on.")]
Port = Annotated[int, typer.Option(envvar="SEMAP_PORT", help="Port to listen on.", min=1, max=65535)]
WithoutTokens = Annotated[
    bool,
    typer.Option(
        "--without-tokens",
        help="Every client has all rights; only for a loopback address.",
    ),
]
AllowOrigin = Annotated[
    list[str] | None,
    typer.Option(
        "--allow-origin",
        metavar="ORIGIN",
        help="A site whose pages may call the service, such as https://maps.example. More than once.",
    ),
]

Rate = Annotated[float, typer.Option(min=0.1, help="Requests a second of one caller, in the long run.")]
Spool = Annotated[
    Path | None,
    typer.Option(
        help="Folder for uploads that wait. [default: the system's for such files]", show_default=False
    ),
]
MaxUpload = Annotated[int, typer.Option(min=1, help="Largest file that is imported as a job [MiB].")]
AllowPrivateWebhooks = Annotated[
    bool, typer.Option("--allow-private-webhooks", help="Send to addresses of private networks too.")
]

Bridge = Annotated[
    list[Path] | None,
    typer.Option(
        "--bridge",
        metavar="CONFIG",
        show_default=False,
        help="Run the bridges of a config as well. More than once.",
    ),
]

if TYPE_CHECKING:
    from semap_bridge.config import Config

    from semap.store.database.backoff import Reminder
    from semap_service.processes.supervisor import Supervisor

log = logging.getLogger(__name__)

CHECK_S = 0.5
FIRST_CHECK_S = 0.1
GRACE_S = 2
EVERYWHERE = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104  (what is asked, not listened to)


def up(
    host: Host = "127.0.0.1",
    port: Port = 8000,
    without_tokens: WithoutTokens = False,
    allow_origin: AllowOrigin = None,
    rate: Rate = 500.0,
    spool: Spool = None,
    max_upload_mb: MaxUpload = 2048,
    allow_private_webhooks: AllowPrivateWebhooks = False,
    bridge: Bridge = None,
    shards: Annotated[
        int,
        typer.Option(min=1, max=64, help="Databases of semap's own that share the maps, each with a worker."),
    ] = 1,
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
    dsn: Dsn = None,
) -> None:
    """Run everything: PostGIS (semap's own, without --dsn), the rule worker, the service, and bridges."""
    from semap_bridge.config import read_config  # noqa: PLC0415

    from semap.store.database.backoff import Reminder  # noqa: PLC0415
    from semap_service.processes.port import require_free  # noqa: PLC0415
    from semap_service.processes.supervisor import Supervisor, stop_signal  # noqa: PLC0415

    write_log(log_format, log_level)
    require_tokens(host, without_tokens)
    require_free(host, port)
    configs = [read_config(path) for path in bridge or ()]
    stop = stop_signal()
    logged = ["--log-format", log_format, *(("--log-level", log_level) if log_level else ())]
    served = ["--host", host, "--port", str(port), "--rate", str(rate), "--max-upload-mb", str(max_upload_mb)]
    served += [part for origin in allow_origin or () for part in ("--allow-origin", origin)]
    served += ["--spool", str(spool)] if spool else []
    served += ["--without-tokens"] if without_tokens else []
    served += ["--allow-private-webhooks"] if allow_private_webhooks else []
    say("Starting the database ...")
    with (
        database(dsn) as opened,
        own_shards(opened, shards, is_own=dsn is None) as others,
        Supervisor(opened) as supervisor,
    ):
        supervisor.start("work", *logged)
        for other in others:
            supervisor.start("work", *logged, dsn=other)
        supervisor.start("serve", *served, *logged)
        for config in configs:
            start_bridges(supervisor, config, logged)
        is_told, reminder = False, Reminder(log, "The database server died and cannot be started")
        while not stop.wait(CHECK_S if is_told else FIRST_CHECK_S):
            supervisor.check()
            if not is_told and answers(host, port):
                is_told = True
                say(f"semap is up: http://{host}:{port}/ (Ctrl-C stops it)")
                say("Next, in another terminal:")
                say("  semap map import BUILDING.geojson")
                say("  semap ingest tracks TRACKS.csv --map BUILDING")
                say("  semap events --follow")
            if dsn is None:
                revive_server(reminder)
        say("Stopping ...")


def start_bridges(supervisor: Supervisor, config: Config, logged: Sequence[str]) -> None:
    """One process for each bridge of a config; what one brings in, another that is new gives out."""
    from semap_bridge.context import ROLE  # noqa: PLC0415
    from semap_bridge.delivery import Past  # noqa: PLC0415

    from semap.store.database.connection import one_transaction  # noqa: PLC0415

    with one_transaction(supervisor.dsn, ROLE) as connection:
        past = Past.now(connection)
    logged = [*logged, "--past", str(past.event), str(past.change)]
    for each in config.bridges:
        supervisor.start(
            "bridge", "run", str(config.path), "--only", each.settings.name, *logged, may_end=True
        )


def answers(host: str, port: int) -> bool:
    """Whether the service takes requests."""
    from http.client import HTTPConnection, HTTPException  # noqa: PLC0415

    asking = HTTPConnection(EVERYWHERE.get(host, host), port, timeout=1)
    try:
        asking.request("GET", "/health")
        return asking.getresponse().status == HTTPStatus.OK
    except (OSError, HTTPException):
        return False
    finally:
        asking.close()


def revive_server(reminder: Reminder) -> None:
    """Start semap's own server again where it has died; where it does not start, that is tried again."""
    from semap.cluster import Cluster, default_home, lease  # noqa: PLC0415
    from semap.errors import ServerUnavailable  # noqa: PLC0415

    if not Cluster(default_home()).is_running():
        try:
            with lease(default_home()):
                say("The database server died; it was started again.", err=True)
                reminder.over()
        except ServerUnavailable as error:
            reminder.say(error)


def work(
    log_format: LogFormatOption = LogFormat.TEXT, log_level: LogLevelOption = None, dsn: Dsn = None
) -> None:
    """Run the rule worker: it reads relation changes from the log and writes events.

    One worker reads at a time; a second one stands by. Its background tasks correct the past after late
    states, run `semap db maintain` once an hour, answer requests for queries in SQL, compact states, and mark
    idle sources.
    """
    from semap.worker.rule_worker import work as follow  # noqa: PLC0415
    from semap_service.processes.supervisor import stop_signal  # noqa: PLC0415

    write_log(log_format, log_level)
    stop = stop_signal()
    with at_work("semap work", dsn) as opened:
        follow(opened, stop)


@contextmanager
def at_work(name: str, dsn: str | None) -> Iterator[str]:
    """The database, while background tasks of whoever follows its log go on."""
    from semap.worker.correcting import correcting  # noqa: PLC0415
    from semap.worker.gathering import gathering  # noqa: PLC0415
    from semap.worker.housekeeping import housekeeping  # noqa: PLC0415
    from semap.worker.query_requests import answering  # noqa: PLC0415
    from semap.worker.settling import settling  # noqa: PLC0415
    from semap_service.operations.tracing import traced  # noqa: PLC0415

    with (
        traced(name),
        database(dsn) as opened,
        housekeeping(opened),
        answering(opened),
        settling(opened),
        correcting(opened),
        gathering(opened),
    ):
        yield opened


def serve(
    host: Host = "127.0.0.1",
    port: Port = 8000,
    without_tokens: WithoutTokens = False,
    allow_origin: AllowOrigin = None,
    rate: Rate = 500.0,
    spool: Spool = None,
    max_upload_mb: MaxUpload = 2048,
    allow_private_webhooks: AllowPrivateWebhooks = False,
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
    dsn: Dsn = None,
) -> None:
    """Run the service: REST, feeds and the page over HTTP."""
    from semap_service.access.limits import Limits  # noqa: PLC0415
    from semap_service.jobs.runner import JobSettings  # noqa: PLC0415
    from semap_service.operations.tracing import traced  # noqa: PLC0415
    from semap_service.processes.port import require_free  # noqa: PLC0415
    from semap_service.processes.supervisor import leave_when_told  # noqa: PLC0415
    from semap_service.serving.app import create_app  # noqa: PLC0415
    from semap_service.serving.uvicorn_server import serve as run  # noqa: PLC0415
    from semap_service.webhooks.delivery import WebhookSettings  # noqa: PLC0415

    write_log(log_format, log_level)
    require_tokens(host, without_tokens)
    require_free(host, port)
    leave_when_told()
    with database(dsn) as opened:
        if not without_tokens:
            _say_how_to_make_a_token(opened)
        app = create_app(
            opened,
            without_tokens=without_tokens,
            allowed_origins=allow_origin or (),
            limits=Limits(rate_per_s=rate),
            job_settings=JobSettings(folder=spool, most_bytes=max_upload_mb * 1024**2),
            webhook_settings=WebhookSettings(allow_private=allow_private_webhooks),
        )
        with traced("semap serve", app):
            app.openapi()  # which would keep the first who asks, and others, waiting
            run(app, host, port, timeout_graceful_shutdown=GRACE_S)


def require_tokens(host: str, without_tokens: bool) -> None:
    """raises InvalidInput for an address other than loopback, where every client would have all rights"""
    from semap.errors import InvalidInput  # noqa: PLC0415
    from semap_service.access.loopback_host import is_loopback  # noqa: PLC0415

    if without_tokens and not is_loopback(f"[{host}]" if ":" in host else host):
        raise InvalidInput(
            f"without tokens, every client that reaches {host} would have all rights",
            "Listen on 127.0.0.1, or leave --without-tokens out and give tokens: semap token add NAME.",
            "--without-tokens",
        )


def _say_how_to_make_a_token(dsn: str) -> None:
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.tokens import has_tokens  # noqa: PLC0415

    with one_transaction(dsn, "semap_admin") as connection:
        if not has_tokens(connection):
            say(
                "There is no token yet. Make one, which is shown once:\n"
                "  semap token add me --scope admin\n"
                "On this machine alone, `--without-tokens` needs none.",
                err=True,
            )
