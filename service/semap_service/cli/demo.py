"""semap demo"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from semap.errors import DatabaseError
from semap_service.cli.output import counted
from semap_service.cli.processes import CHECK_S

if TYPE_CHECKING:
    from sqlalchemy import Engine

    from semap_service.demo.scenes import Scene
    from semap_service.processes.supervisor import Supervisor

CAUGHT_UP_S = 30.0
WAKE_S = 0.2
FIRST_SCENE = 4
"""Number of the first scene with finished tracks."""
PAGE = 1000


def demo(
    stay: Annotated[bool, typer.Option("--stay", help="Keep the service up until Ctrl-C.")] = False,
    data: Annotated[
        Path | None, typer.Option(help="Folder of the real data sets (flat/, bottleneck/).")
    ] = None,
    fast: Annotated[bool, typer.Option("--fast", help="Do not replay at a pace.")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="The robot publishes ROS 2 topics, which a bridge hears.")
    ] = False,
    port: Annotated[int, typer.Option(help="Port of the service; 0 for any free one.", min=0, max=65535)] = 0,
) -> None:
    """Show the whole way: buildings, recordings and movement go in, events come out.

    Runs PostGIS, the rule worker and the service for itself, in a folder that is gone afterwards; your
    own maps are not touched. A recording of a simulated office is made at first use and kept in the cache.
    """
    from semap_service.demo.scenes import scenes  # noqa: PLC0415
    from semap_service.processes.port import free_port, require_free  # noqa: PLC0415
    from semap_service.processes.supervisor import Supervisor, stop_signal  # noqa: PLC0415
    from semap_service.processes.temporary_server import temporary_server  # noqa: PLC0415

    port = port or free_port()
    require_free("127.0.0.1", port)
    typer.echo("1. A PostGIS server of its own, in a temporary folder ...")
    started_s = time.monotonic()
    with temporary_server("demo") as dsn, Supervisor(dsn) as supervisor:
        typer.echo(f"   up after {time.monotonic() - started_s:.1f} s, schema migrated.")
        supervisor.start("work")
        supervisor.start("serve", "--port", str(port), "--without-tokens")
        typer.echo(f"2. The rule worker and the service: http://127.0.0.1:{port}/")
        typer.echo("3. persons and doors that a robot's camera and laser see (simulated)")
        _play_recording(dsn, fast, supervisor if live else None)
        events = 0
        chosen = scenes(data)
        for number, scene in enumerate(chosen, FIRST_SCENE):
            typer.echo(f"{number}. {scene.title}")
            events = _play(dsn, supervisor, scene, None if fast else scene.pace)
        _say_what_next(events, len(chosen), port, stay)
        if stay:
            stop = stop_signal()
            while not stop.wait(CHECK_S):
                supervisor.check()


def _play_recording(dsn: str, fast: bool, live: Supervisor | None = None) -> None:
    from semap_service.cli.perception_extra import REMEDY, missing_packages  # noqa: PLC0415
    from semap_service.cli.progress import progress_bar  # noqa: PLC0415
    from semap_service.cli.recorded_office import PACE, play_recorded_office  # noqa: PLC0415

    missing = missing_packages()
    if live is not None and find_spec("cyclonedds") is None:
        typer.echo("   Left out, since it needs Cyclone DDS: pip install 'semap[ros2]'")
        return
    if missing:
        typer.echo(f"   Left out, since it needs {', '.join(missing)}: {REMEDY}")
        return
    with progress_bar("tenths of a second") as advance:
        play_recorded_office(
            dsn, None if fast else PACE, lambda line: typer.echo(f"   {line}"), advance, live
        )


def _play(dsn: str, supervisor: Supervisor, scene: Scene, pace: float | None) -> int:
    """Import the building, replay the recording, print the events; gives the number of the last one.

    raises DatabaseError where the events do not all come
    """
    from threading import Thread  # noqa: PLC0415

    from semap_ingest.replay import Plan, replay  # noqa: PLC0415
    from semap_ingest.track_file import fingerprint, read_tracks  # noqa: PLC0415

    from semap.store.database.connection import listen, one_session, wait_for_notice  # noqa: PLC0415
    from semap.store.database.event_number import newest_event  # noqa: PLC0415

    _bring_in(dsn, scene)
    tracks = read_tracks(scene.tracks, scene.layout)
    length_s = (tracks.stamp_us[-1] - tracks.stamp_us[0]) / 1e6
    speed = "as fast as it goes" if pace is None else f"{pace:g} times as fast as it happened"
    what = f"{len(tracks)} states of {counted(len(tracks.names), 'track')}"
    typer.echo(f"   Replaying {what}, {length_s:.0f} s, {speed}:")
    identity = fingerprint(scene.tracks, scene.layout)
    plan = Plan(scene.name, "recording", str(scene.tracks), identity, realtime=pace)
    with (
        one_session(dsn, "semap_read", application="semap demo") as engine,
        listen(dsn, "semap_event", "semap_read", application="semap demo") as listening,
    ):
        with engine.begin() as connection:
            first = last = newest_event(connection)
        writer = Thread(target=replay, args=(dsn, plan, tracks), daemon=True)
        writer.start()
        quiet_s = time.monotonic()
        while writer.is_alive() or not _all_made(engine, scene.name):
            wait_for_notice(listening, WAKE_S)
            supervisor.check()
            before, last = last, _print_events(engine, scene, first, last)
            if writer.is_alive() or last > before:
                quiet_s = time.monotonic()
            elif time.monotonic() > quiet_s + CAUGHT_UP_S:
                raise DatabaseError("The rule worker makes no events.", "Run again with `semap -v demo`.")
        last = _print_events(engine, scene, first, last)
        if last - first > scene.shown:
            typer.echo(f"   ... and {last - first - scene.shown} more events.")
        _print_sums(engine, first)
    return last


def _bring_in(dsn: str, scene: Scene) -> None:
    from semap_ingest.object_file import (  # noqa: PLC0415
        ObjectLayout,
        ObjectPlan,
        ingest_object_states,
        read_object_states,
    )

    from semap.rules.language.reading import read_declaration  # noqa: PLC0415
    from semap.rules.language.template import fill  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.rules import add_rule  # noqa: PLC0415
    from semap.store.map.building import import_building  # noqa: PLC0415
    from semap.store.map.maps import create_map  # noqa: PLC0415
    from semap_service.cli.exchange import report_lines  # noqa: PLC0415

    with one_transaction(dsn, "semap_api") as connection:
        create_map(connection, scene.name)
        report = import_building(connection, scene.name, scene.building)
        for template in scene.rules:
            add_rule(connection, scene.name, read_declaration(fill(template)))
    # a door drawn as a line has no heights, which is of no weight here
    shown = tuple(finding for finding in report.findings if finding.action != "note")
    for line in report_lines(replace(report, findings=shown)):
        typer.echo(f"   {line}")
    if scene.rules:
        typer.echo(f"   Rules: room_visits, {', '.join(scene.rules)} (each `semap rule template NAME`).")
    if scene.doors is not None:
        # nothing is judged before the movement is there, too
        states = read_object_states(scene.doors, ObjectLayout())
        ingest_object_states(dsn, ObjectPlan(scene.name, "doors", keep_open=True), states)
        typer.echo(f"   {len(states.states)} states of doors brought in.")


def _all_made(engine: Engine, map_name: str) -> bool:
    from semap.store.operate.status import are_events_made  # noqa: PLC0415

    with engine.begin() as connection:
        return are_events_made(connection, map_name)


def _print_sums(engine: Engine, first: int) -> None:
    """How many tracks entered and left each room, and how often what rules look for was found."""
    from semap.store.operate.status import sum_types, sum_visits  # noqa: PLC0415

    with engine.begin() as connection:
        for room, entered, left in sum_visits(connection, first):
            typer.echo(f"   {room}: entered {entered}, left {left}")
        for kind, count in sum_types(connection, first):
            typer.echo(f"   {kind}: {count}")


def _print_events(engine: Engine, scene: Scene, first: int, last: int) -> int:
    from semap.store.event.events import list_events  # noqa: PLC0415
    from semap_service.cli.events import row_of, sentence  # noqa: PLC0415

    with engine.begin() as connection:
        while page := list_events(connection, after=last, limit=PAGE):
            for event in page:
                last = event.seq
                if last - first <= scene.shown:
                    typer.echo(f"   {sentence(row_of(event, {}))}")
    return last


def _say_what_next(events: int, scenes: int, port: int, stay: bool) -> None:
    typer.echo(f"{FIRST_SCENE + scenes}. Done: {events} events.")
    if stay:
        typer.echo(f"   The service stays up until Ctrl-C. Try, for example:\n"
                   f"     curl 'http://127.0.0.1:{port}/rooms?map=office'\n"
                   f"     curl 'http://127.0.0.1:{port}/events?map=office&limit=3'")  # fmt: skip
        return
    own = "./dev demo --stay" if os.environ.get("SEMAP_DEV") else "semap demo --stay"
    typer.echo(f"   Where to look next:\n"
               f"     {own}    keeps the service up, to ask it about rooms and tracks\n"
               f"     docs/tutorial.md     your own building and your own tracks")  # fmt: skip
