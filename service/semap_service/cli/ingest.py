"""semap ingest"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from itertools import takewhile
from pathlib import Path
from threading import Event as Signal
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from semap_service.cli.log_options import LogFormatOption, LogLevelOption
from semap_service.cli.output import counted, print_json, say
from semap_service.cli.session import AsJson, Dsn, database
from semap_service.operations.log_lines import LogFormat, write_log

if TYPE_CHECKING:
    from semap_ingest.left_out import LeftOut
    from semap_ingest.pipeline.ingest_recording import Ingested
    from semap_ingest.replay import Replayed

MIRROR_WAIT_S = 10.0

Timezone = Annotated[
    str | None,
    typer.Option(help="Time zone of ISO stamps without one: Europe/Berlin, +01:00, UTC.", metavar="ZONE"),
]
SkipBad = Annotated[
    bool, typer.Option("--skip-bad", help="Exit with status 0 though rows that cannot be used were left out.")
]


class WithTransforms(TyperCommand):
    """`--transform` takes eight words, and may be repeated: Typer has no such list, so they are joined."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        joined: list[str] = []
        rest = list(args)
        while rest:
            joined.append(rest.pop(0))
            if joined[-1] == "--transform":
                words = list(takewhile(lambda word: not word.startswith("--"), rest[:8]))
                joined.append(" ".join(words))
                del rest[: len(words)]
        return super().parse_args(ctx, joined)


def commands() -> typer.Typer:
    app = typer.Typer(
        no_args_is_help=True,
        help="Bring in what was seen: tracks, states of objects, recordings of cameras and lasers.",
    )
    app.command("tracks")(tracks)
    app.command("objects")(objects)
    app.command("recording", cls=WithTransforms)(recording)
    return app


def tracks(
    file: Annotated[Path, typer.Argument(help="CSV (any usual delimiter) or Parquet, one row per state.")],
    map_name: Annotated[str, typer.Option("--map", help="The map on which the tracks move.")],
    source: Annotated[str | None, typer.Option(help="Name of the source. [default: the file's name]")] = None,
    track: Annotated[
        str | None, typer.Option(help="The name of the only track, if there is no such column.")
    ] = None,
    names: Annotated[
        str | None, typer.Option(help="Names of the columns of a file without header: track,stamp,x,y,...")
    ] = None,
    track_column: Annotated[str | None, typer.Option(help="Column of the track's name or number.")] = None,
    stamp_column: Annotated[str | None, typer.Option(help="Column of the stamp (event time).")] = None,
    x_column: Annotated[str | None, typer.Option(help="Column of x.")] = None,
    y_column: Annotated[str | None, typer.Option(help="Column of y.")] = None,
    z_column: Annotated[str | None, typer.Option(help="Column of z; without one any height matches.")] = None,
    std_column: Annotated[str | None, typer.Option(help="Column of the standard deviation.")] = None,
    var_x_column: Annotated[
        str | None, typer.Option(help="Column of the variance of x; the two that follow go with it.")
    ] = None,
    cov_xy_column: Annotated[str | None, typer.Option(help="Column of the covariance of x and y.")] = None,
    var_y_column: Annotated[str | None, typer.Option(help="Column of the variance of y.")] = None,
    stamp_unit: Annotated[
        str, typer.Option(help="iso, s, ms, us, ns, or the rate of numbered frames such as 25fps.")
    ] = "iso",
    epoch: Annotated[str, typer.Option(help="The time of stamp 0.")] = "1970-01-01T00:00:00Z",
    timezone: Timezone = None,
    unit: Annotated[
        str, typer.Option(help="Unit of x, y, z and std, variances in its square: m, cm, mm, ft, in.")
    ] = "m",
    frame: Annotated[
        str | None, typer.Option(help="Frame of the positions, such as a storey; z is 0 in it if absent.")
    ] = None,
    concept: Annotated[str | None, typer.Option(help="The concept of each track, from the taxonomy.")] = None,
    attributes: Annotated[
        str | None, typer.Option(help='Attributes of each track, as JSON: \'{"shift": "night"}\'.')
    ] = None,
    realtime: Annotated[
        float | None, typer.Option(help="Replay at the recording's pace times this factor.", min=0.001)
    ] = None,
    batch: Annotated[int, typer.Option(help="States per transaction.", min=1)] = 1000,
    keep_open: Annotated[
        bool, typer.Option("--keep-open", help="Do not end the tracks at their last state.")
    ] = False,
    skip_bad: SkipBad = False,
    as_json: AsJson = False,
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
    dsn: Dsn = None,
) -> None:
    """Import finished tracks from a file.

    After a crash, the same command continues where it was; a file that is already imported is not read twice.
    Bad rows are left out and reported; then the exit status is 1, unless --skip-bad.
    """
    from semap_ingest.mirror import Follower, count_inside  # noqa: PLC0415
    from semap_ingest.replay import ROLE, Plan, in_map_frame, replay  # noqa: PLC0415
    from semap_ingest.track_file import Layout, fingerprint, read_tracks  # noqa: PLC0415

    from semap.store.motion.correction import correct_past  # noqa: PLC0415
    from semap.timeline.stamp import parse_stamp  # noqa: PLC0415
    from semap_service.cli.progress import progress_bar  # noqa: PLC0415
    from semap_service.cli.written_attributes import read_attributes  # noqa: PLC0415

    write_log(log_format, log_level)
    columns = {
        "track": track_column,
        "stamp": stamp_column,
        "x": x_column,
        "y": y_column,
        "z": z_column,
        "std": std_column,
        "var-x": var_x_column,
        "cov-xy": cov_xy_column,
        "var-y": var_y_column,
    }
    layout = Layout(
        columns={role: name for role, name in columns.items() if name is not None},
        names=tuple(name.strip() for name in names.split(",")) if names else (),
        track=track,
        stamp_unit=stamp_unit,
        epoch_us=parse_stamp(epoch),
        timezone=timezone,
        unit=unit,
    )
    read = read_tracks(file, layout)
    for finding in read.findings:
        say(f"{finding.action}: {finding.subject} ({finding.reason})", err=True)
    _tell_left_out(read.left_out)
    plan = Plan(
        map_name=map_name,
        source=source or file.stem,
        path=str(file),
        fingerprint=fingerprint(file, layout, frame, keep_open),
        batch_size=batch,
        realtime=realtime,
        keep_open=keep_open,
        concept=concept,
        attributes=read_attributes(attributes),
    )
    with database(dsn, map_name) as opened, Follower(opened) as follower:
        if frame is not None:
            read = in_map_frame(opened, map_name, frame, read)
        with progress_bar("states", quiet=as_json) as advance:
            done = replay(opened, plan, read, advance)
        if done.late:
            correct_past(opened, ROLE)
        inside = None
        if follower.wait_ready(MIRROR_WAIT_S):
            inside = count_inside(follower.footprints(map_name, "Room"), read.x_m, read.y_m)
    if as_json:
        print_json(
            {
                "states": done.states,
                "tracks": done.tracks,
                "resumed_at": done.resumed_at,
                "late": done.late,
                "states_inside_a_room": inside,
                "left_out": read.left_out.count,
            }
        )
    else:
        _print_replayed(done, map_name, inside, len(read))
    _exit_by(read.left_out, skip_bad)


def _print_replayed(done: Replayed, map_name: str, inside: int | None, in_file: int) -> None:
    if done.resumed_at:
        say(f"{done.resumed_at} states had been written before.")
    say(f"{done.states} states of {counted(done.tracks, 'track')} written to map {map_name}.")
    if inside is not None:
        say(f"{100 * inside / in_file:.1f} % of the file's states lie inside a room.")
    if done.late:
        say(f"{done.late} states came late: they corrected what was known of the past.")
    if inside == 0:
        say("No state lies inside a room: check --unit, --frame and the map.", err=True)


def _tell_left_out(left_out: LeftOut) -> None:
    if left_out.count:
        say(f"{counted(left_out.count, 'row')} left out:", err=True)
        for line in left_out.lines():
            say(f"  {line}", err=True)


def _exit_by(left_out: LeftOut, skip_bad: bool) -> None:
    """Exit with status 1 if rows were left out without --skip-bad."""
    if left_out.count and not skip_bad:
        say(
            "All other rows are imported. Correct these, and import them as a file of their own with the same"
            " --source; or allow bad rows: --skip-bad.",
            err=True,
        )
        raise typer.Exit(1)


def objects(
    file: Annotated[Path, typer.Argument(help="CSV (any usual delimiter) or Parquet, one row per state.")],
    map_name: Annotated[str, typer.Option("--map", help="The map on which the objects are.")],
    source: Annotated[str | None, typer.Option(help="Name of the source. [default: the file's name]")] = None,
    property_name: Annotated[
        str | None, typer.Option("--property", help="The property, if there is no such column: door.")
    ] = None,
    names: Annotated[
        str | None,
        typer.Option(help="Names of the columns of a file without header: instance,property,value,stamp."),
    ] = None,
    instance_column: Annotated[str | None, typer.Option(help="Column of the instance's name.")] = None,
    property_column: Annotated[str | None, typer.Option(help="Column of the property.")] = None,
    value_column: Annotated[str | None, typer.Option(help="Column of the value.")] = None,
    stamp_column: Annotated[str | None, typer.Option(help="Column of the stamp (event time).")] = None,
    stamp_unit: Annotated[
        str, typer.Option(help="iso, s, ms, us, ns, or the rate of numbered frames such as 25fps.")
    ] = "iso",
    epoch: Annotated[str, typer.Option(help="The time of stamp 0.")] = "1970-01-01T00:00:00Z",
    timezone: Timezone = None,
    batch: Annotated[int, typer.Option(help="States per transaction.", min=1)] = 1000,
    keep_open: Annotated[
        bool,
        typer.Option(
            "--keep-open",
            help="Send no watermark: rules wait with these states for the tracks of the same time, which"
            " are imported next.",
        ),
    ] = False,
    skip_bad: SkipBad = False,
    as_json: AsJson = False,
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
    dsn: Dsn = None,
) -> None:
    """Import states of objects, such as doors that open and close, from a file.

    A row gives a property of an instance a value from a stamp on. Stored states are skipped, so that the
    command may be repeated. Bad rows are left out and reported; then the exit status is 1, unless --skip-bad.
    """
    from semap_ingest.object_file import (  # noqa: PLC0415
        ObjectLayout,
        ObjectPlan,
        ingest_object_states,
        read_object_states,
    )

    from semap.timeline.stamp import parse_stamp  # noqa: PLC0415
    from semap_service.cli.progress import progress_bar  # noqa: PLC0415

    write_log(log_format, log_level)
    columns = {
        "instance": instance_column,
        "property": property_column,
        "value": value_column,
        "stamp": stamp_column,
    }
    layout = ObjectLayout(
        columns={role: name for role, name in columns.items() if name is not None},
        names=tuple(name.strip() for name in names.split(",")) if names else (),
        property=property_name,
        stamp_unit=stamp_unit,
        epoch_us=parse_stamp(epoch),
        timezone=timezone,
    )
    read = read_object_states(file, layout)
    _tell_left_out(read.left_out)
    plan = ObjectPlan(map_name, source or file.stem, batch, keep_open)
    with database(dsn, map_name) as opened, progress_bar("states", quiet=as_json) as advance:
        added = ingest_object_states(opened, plan, read, advance)
    states = len(read.states)
    if as_json:
        print_json({"states": states, "added": added, "left_out": read.left_out.count})
    else:
        say(f"{counted(added, 'state')} of objects written to map {map_name}.")
        if added < states:
            say(f"{states - added} were there before.")
    _exit_by(read.left_out, skip_bad)


def recording(
    map_name: Annotated[str, typer.Option("--map", help="The map in which the sensors stood.")],
    file: Annotated[
        Path | None,
        typer.Argument(
            help="ROS 1 bag, ROS 2 folder (sqlite3 or MCAP), or MCAP file; none if all sensors of the rig"
            " have files of their own."
        ),
    ] = None,
    source: Annotated[
        str | None, typer.Option(help="Name of the source. [default: the file's name, else the rig's]")
    ] = None,
    camera_model: Annotated[
        Path | None,
        typer.Option(
            help="Detector of persons in images: an ONNX file (YOLO v4 to v11, YOLOX, RF-DETR, ...), or the"
            " name of one that `semap detector add` keeps. Without one, images are not looked at."
        ),
    ] = None,
    camera_layout: Annotated[
        str | None,
        typer.Option(
            help="The layout of the detector's outputs, if the file is ambiguous: yolov8, yolox, ..."
        ),
    ] = None,
    camera_classes: Annotated[
        Path | None, typer.Option(help="The detector's classes, one in each line, where the file has none.")
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(help="File of its sensors (YAML); `semap rig check RECORDING` proposes one."),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            help="PART=TOPIC, where types do not tell: scan, image, camera_info, boxes, poses, transforms,"
            " odometry. PART= leaves it out. More than once, also for several sensors of a part."
        ),
    ] = None,
    transform: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARENT CHILD X Y Z ROLL PITCH YAW",
            help="Where a frame is fixed in another one [m, rad], whatever the recording says. Repeatable.",
        ),
    ] = None,
    transform_patience: Annotated[
        float | None,
        typer.Option(
            help="How long records wait for their transform [s of the recording]. [default: until it comes]",
            min=0.0,
        ),
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="Frame of the recording that is the map's. [default: map]")
    ] = None,
    floor_z: Annotated[float | None, typer.Option(help="Height of the floor in it [m]. [default: 0]")] = None,
    images_hz: Annotated[float | None, typer.Option(help="Images to process a second.", min=0.1)] = None,
    cuda: Annotated[
        bool, typer.Option("--cuda", help="Run the detector on a GPU (onnxruntime-gpu).")
    ] = False,
    person_class: Annotated[
        list[str] | None,
        typer.Option(
            help="What the robot calls persons, where it has found them by itself. More than once."
            " [default: person, pedestrian, human, people]"
        ),
    ] = None,
    realtime: Annotated[
        float | None, typer.Option(help="Replay at the recording's pace times this factor.", min=0.001)
    ] = None,
    as_json: AsJson = False,
    log_format: LogFormatOption = LogFormat.TEXT,
    log_level: LogLevelOption = None,
    dsn: Dsn = None,
) -> None:
    """Find persons and doors in a recording of cameras and 2D lasers, and write them to the database.

    Persons become tracks; doors with a leaf get states. Transforms (tf) must lead from the sensors to the
    map's frame. `semap recording info FILE` lists the content of a recording. After a crash, the same command
    continues where it was. If the recording, or one of its sensors, has no results, the exit status is 1.
    """
    from semap_ingest.pipeline.ingest_recording import Plan, ingest_recording  # noqa: PLC0415
    from semap_ingest.pipeline.rig import fixed_transforms, read_rig  # noqa: PLC0415
    from semap_ingest.recording.reading import PERSON_CLASSES  # noqa: PLC0415
    from semap_ingest.replay import ROLE  # noqa: PLC0415

    from semap.errors import InvalidInput  # noqa: PLC0415
    from semap.store.motion.correction import correct_past  # noqa: PLC0415
    from semap_service.cli.progress import progress_bar  # noqa: PLC0415

    write_log(log_format, log_level)
    parts: dict[str, list[str]] = {}
    for each in topic or ():
        part, is_pair, name = each.partition("=")
        if not is_pair:
            raise InvalidInput(f"{each!r} names no topic", "Write it as scan=/front/scan.", "--topic")
        parts.setdefault(part, []).append(name)
    said = {
        "--topic": topic,
        "--frame": frame,
        "--floor-z": floor_z,
        "--camera-layout": camera_layout,
        "--camera-classes": camera_classes,
        "--images-hz": images_hz,
        "--person-class": person_class,
    }
    if rig is not None and any(each is not None for each in said.values()):
        options = ", ".join(name for name, each in said.items() if each is not None)
        raise InvalidInput(f"{options} beside --rig", "Write it into the rig instead.", "--rig")
    named = next((each.stem for each in (file, rig) if each is not None), "")
    plan = Plan(
        map_name=map_name,
        source=source or named,
        path=file,
        speed=realtime,
        rig=None if rig is None else read_rig(rig),
        topics=parts,
        map_frame=frame or "map",
        floor_z_m=floor_z or 0.0,
        fixed=fixed_transforms(transform or ()),
        transform_patience_s=transform_patience,
        image_model=camera_model,
        image_layout=camera_layout,
        class_names=camera_classes,
        providers=("CUDAExecutionProvider", "CPUExecutionProvider") if cuda else ("CPUExecutionProvider",),
        images_hz=images_hz,
        person_classes=tuple(person_class or PERSON_CLASSES),
    )
    with (
        database(dsn, map_name) as opened,
        progress_bar("tenths of a second", quiet=as_json) as advance,
        interruptible() as stop,
    ):
        done = ingest_recording(opened, plan, advance, stop)
        correct_past(opened, ROLE)
    if as_json:
        print_json(asdict(done))
    else:
        _print_ingested(done, map_name)
    if not done.is_whole:
        say("Stopped before the end. Run the same command again to continue.", err=True)
        raise typer.Exit(130)
    if done.fruitless:
        for each in done.fruitless:
            say(f"semap: {plan.source}: {each}.", err=True)
        say("  What to do: See above what was left out and why; --topic and --frame may help.", err=True)
        raise typer.Exit(1)


@contextmanager
def interruptible() -> Iterator[Signal]:
    """Set by Ctrl-C; a second one ends the command at once."""
    stop = Signal()

    def interrupted(number: int, frame: object) -> None:
        stop.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, interrupted)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


def _print_ingested(done: Ingested, map_name: str) -> None:
    if done.resumed_at:
        say(f"{counted(done.resumed_at, 'result')} had been written before.")
    if done.is_whole and not done.records:
        say("All of the recording is in: nothing is left to do.")
        return
    say(
        f"{done.length_s:.0f} s with {done.records} records: {done.states} states of"
        f" {counted(done.tracks, 'person')} and {done.lines} lines written to map {map_name}."
    )
    for why, count in done.left_out.items():
        say(f"  left out: {counted(count, 'record')}: {why}", err=True)
