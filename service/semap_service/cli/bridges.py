"""semap bridge"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from semap_service.cli.log_options import LogFormatOption, LogLevelOption
from semap_service.cli.output import print_rows
from semap_service.cli.session import AsJson, Dsn, database
from semap_service.operations.log_lines import LogFormat, LogLevel, write_log

if TYPE_CHECKING:
    from collections.abc import Sequence

    from semap_bridge.config import Config

    from semap.store.motion.bridges import Bridge

HELP = """
Connect robots, brokers and buildings: states come in, events go out.

A config names a map and what it is connected with:

\b
    map: office
    bridges:
      - name: tracker
        kind: ndjson
        listen: 127.0.0.1:9000

\b
semap bridge check CONFIG.yaml   connects, says what it sees, and writes nothing
semap bridge CONFIG.yaml         runs it, a process for each bridge
semap bridge foxglove --map M    runs one of a kind that needs no more settings
semap up --bridge CONFIG.yaml    runs it with all else
semap bridge play RECORDING      is a robot: a recording as ROS 2 topics, in its own time
"""
RUN = "run"
CHECK_S = 0.5

ConfigFile = Annotated[
    Path, typer.Argument(metavar="CONFIG", help="YAML file with the bridges; or a kind, with --map.")
]
OfMap = Annotated[
    str | None,
    typer.Option("--map", metavar="NAME", help="Map of a kind that needs no config.", show_default=False),
]
Only = Annotated[
    str | None, typer.Option(metavar="NAME", help="Only the bridge of this name.", show_default=False)
]

Past = Annotated[
    tuple[int, int] | None,
    typer.Option(hidden=True, help="Numbers of the newest event and change when all were started."),
]


class _RunsConfig(TyperGroup):
    """`semap bridge CONFIG.yaml` is `semap bridge run CONFIG.yaml`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and not args[0].startswith("-") and args[0] not in self.commands:
            args = [RUN, *args]
        return super().parse_args(ctx, args)


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help=HELP, cls=_RunsConfig)
    app.command(RUN)(run)
    app.command("check")(check)
    app.command("list")(list_all)
    app.command("forget")(forget)
    app.command("kinds")(kinds)
    app.command("play")(play)
    return app


def run(
    config: ConfigFile,
    of_map: OfMap = None,
    only: Only = None,
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
    past: Past = None,
    dsn: Dsn = None,
) -> None:
    """Run the bridges of a config, each in a process of its own, until Ctrl-C or all is read."""
    from semap_bridge import delivery  # noqa: PLC0415
    from semap_bridge.config import read_config  # noqa: PLC0415
    from semap_bridge.running import run_bridge  # noqa: PLC0415

    from semap_service.processes.supervisor import stop_signal  # noqa: PLC0415

    read = read_config(config, of_map)
    entries = read.bridges if only is None else (read.of(only),)
    known = None if past is None else delivery.Past(*past)
    write_log(log_format, log_level or LogLevel.INFO)
    stop = stop_signal()
    with database(dsn) as opened:
        if len(entries) == 1:
            run_bridge(opened, entries[0], stop, known)
        else:
            logged = ["--log-format", log_format, *(("--log-level", log_level) if log_level else ())]
            _run_all(opened, read, logged)


def _run_all(dsn: str, config: Config, logged: Sequence[str]) -> None:
    from semap_service.cli.processes import start_bridges  # noqa: PLC0415
    from semap_service.processes.supervisor import Supervisor, stop_signal  # noqa: PLC0415

    stop = stop_signal()
    with Supervisor(dsn) as supervisor:
        start_bridges(supervisor, config, logged)
        while not stop.wait(CHECK_S):
            supervisor.check()
            status = supervisor.ended()
            if status is not None:
                raise typer.Exit(status)


def check(
    config: ConfigFile,
    of_map: OfMap = None,
    only: Only = None,
    seconds: Annotated[float, typer.Option(min=0.1, help="How long to look at each.")] = 5.0,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Connect, and say what there is to see and what is wrong; nothing is written."""
    from semap_bridge.checking import check_bridge  # noqa: PLC0415
    from semap_bridge.config import read_config  # noqa: PLC0415

    read = read_config(config, of_map)
    entries = read.bridges if only is None else (read.of(only),)
    rows: list[dict[str, object]] = []
    with database(dsn) as opened:
        for entry in entries:
            for each in check_bridge(opened, entry, seconds):
                rows.append(
                    {
                        "bridge": entry.settings.name,
                        "what": each.what,
                        "is a": each.is_a,
                        "rate_hz": None if each.rate_hz is None else round(each.rate_hz, 1),
                        "trouble": each.trouble,
                        "remedy": each.remedy,
                    }
                )
    print_rows(rows, as_json, "Nothing to see.")
    if any(row["trouble"] for row in rows):
        raise typer.Exit(1)


def list_all(
    map_name: Annotated[str | None, typer.Option("--map", help="Only those of this map.")] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """List the bridges that have run, with what each said of itself last."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap.store.motion.bridges import list_bridges  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = list_bridges(connection, map_name=map_name, limit=1000)
    print_rows([_row(each) for each in found], as_json, "No bridge has run. See: semap bridge --help")


def forget(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the bridge.")],
    map_name: Annotated[str, typer.Option("--map", help="Its map.")],
    dsn: Dsn = None,
) -> None:
    """Forget a bridge that does not run: what it said, and how far it came.

    Where it runs again, a source is read from its beginning, which stores nothing twice, and events are given
    out as by a new one. What it brought in stays.
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap.store.motion.bridges import forget_bridge  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_ingest") as connection:
        forget_bridge(connection, get_map(connection, map_name).map_id, name)
    typer.echo(f"Forgot the bridge {name} of the map {map_name}.")


def kinds(as_json: AsJson = False) -> None:
    """List what semap can be connected with, and the extra that each needs."""
    from semap_bridge.kinds import KINDS  # noqa: PLC0415

    print_rows(
        [
            {
                "kind": name,
                "connects": each.said,
                "needs": f"pip install 'semap[{each.extra}]'" if each.extra else "",
            }
            for name, each in sorted(KINDS.items())
        ],
        as_json,
        "",
    )


def play(
    recording: Annotated[
        Path | None,
        typer.Argument(metavar="[RECORDING]", help="Of ROS 1 or 2. [default: the simulated office]"),
    ] = None,
    domain: Annotated[int, typer.Option(envvar="ROS_DOMAIN_ID", help="Domain of ROS 2.")] = 0,
    interface: Annotated[
        str | None,
        typer.Option(
            help="Address or name of the network; 127.0.0.1: this machine only.", show_default=False
        ),
    ] = None,
    speed: Annotated[float, typer.Option(min=0.01, help="So many times as fast as it happened.")] = 1.0,
    wait: Annotated[float, typer.Option(min=0.0, help="So many seconds for somebody who listens.")] = 60.0,
) -> None:
    """Publish a recording as topics of ROS 2, as the robot that made it; to try a bridge without a robot."""
    from semap_bridge.adapters.ros.playing import play as play_into  # noqa: PLC0415
    from semap_bridge.adapters.ros.settings import Ros2Settings  # noqa: PLC0415
    from semap_bridge.kinds import adapter_of  # noqa: PLC0415

    from semap_service.processes.supervisor import stop_signal  # noqa: PLC0415

    adapter_of("ros2", "semap bridge play")
    settings = Ros2Settings(name="player", kind="ros2", domain=domain, interface=interface)
    path = recording or _simulated_office()
    stop = stop_signal()
    graph = settings.graph("semap_player")
    try:
        sent = play_into(
            path, graph, stop, speed=speed, wait_s=wait, waits=lambda: typer.echo("Nobody listens yet ...")
        )
    finally:
        graph.close()
    typer.echo(f"{sent} messages of {path} were published.")


def _simulated_office() -> Path:
    """Made at its first use."""
    from semap_ingest.simulation.office import office_recording  # noqa: PLC0415
    from semap_ingest.simulation.settings import OfficeSettings  # noqa: PLC0415

    from semap_service.cli.progress import progress_bar  # noqa: PLC0415

    with progress_bar("tenths of a second") as advance:
        paths = office_recording(OfficeSettings(), advance)
    typer.echo(f"The office: semap map import {paths.map} --map office")
    return paths.recording


def _row(bridge: Bridge) -> dict[str, object]:
    return {
        "map": bridge.map,
        "bridge": bridge.name,
        "kind": bridge.kind,
        "state": bridge.state,
        "received": bridge.received,
        "committed": bridge.committed,
        "delivered": bridge.delivered,
        "dropped": bridge.dropped,
        "refused": bridge.refused,
        "reconnects": bridge.reconnects,
        "lag_s": None if bridge.lag_s is None else round(bridge.lag_s, 3),
        "told_at": bridge.told_at,
        "trouble": bridge.trouble,
    }
