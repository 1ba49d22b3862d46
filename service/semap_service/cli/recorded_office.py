"""The demo's first scene: a recording of a camera and a laser, perceived live, and judged by its labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from threading import Event as Signal
from typing import TYPE_CHECKING, TypedDict

from semap.timeline.stamp import to_datetime
from semap_service.cli.events import sentence
from semap_service.cli.output import counted

if TYPE_CHECKING:
    from semap_ingest.simulation.office import OfficePaths

    from semap_service.evaluation.matching import Scores
    from semap_service.evaluation.play import PlayedEvent
    from semap_service.processes.supervisor import Supervisor

MAP = "recorded_office"
LISTENER_S = 60.0
STILL_S = 1.0
"""After its last message a robot's sensors are perceived."""
PACE = 3.0
"""So many times as fast as it happened: what two cores follow."""

Say = Callable[[str], None]
Advance = Callable[[int, int], None]


LIVE = """
map: {map}
bridges:
  - name: robot
    kind: ros2
    domain: {domain}
    interface: 127.0.0.1
    robot: base_link
    image_model: {model}
"""
LIVE_DOMAIN = 93


def play_recorded_office(
    dsn: str, pace: float | None, say: Say, advance: Advance, live: Supervisor | None = None
) -> None:
    """Make the recording at its first use, play it through all of semap, and compare events with labels.

    pace     so many times as fast as it happened; None: as fast as it goes
    live     starts a bridge that hears the recording as topics of ROS 2, which are played in their own time
    advance  called with what is made of the recording, and what there is in all
    raises   DatabaseError where the rule worker does not follow
    """
    from semap_ingest.simulation.labels import read_labels  # noqa: PLC0415
    from semap_ingest.simulation.office import office_recording  # noqa: PLC0415
    from semap_ingest.simulation.settings import OfficeSettings  # noqa: PLC0415

    from semap_service.evaluation.office import PARTS, plan_of, score  # noqa: PLC0415
    from semap_service.evaluation.play import play, set_the_stage  # noqa: PLC0415
    from semap_service.evaluation.report import table  # noqa: PLC0415

    paths = office_recording(OfficeSettings(), _announced(say, advance))
    labels = read_labels(paths.labels)
    told = {kind for kinds in PARTS.values() for kind in kinds}

    def show(event: PlayedEvent) -> None:
        if event.type in told:
            say(_said(event))

    set_the_stage(dsn, paths.map, MAP)
    speed = "as fast as it goes" if pace is None else f"{pace:g} times as fast as it happened"
    what = f"{labels.duration_s:.0f} s of images (30 Hz) and scans (15 Hz)"
    if live is not None:
        say(f"Publishing {what} as ROS 2 topics, which a bridge hears:")
        events = _play_live(dsn, paths, live, show)
    else:
        say(f"Playing {what}, {speed}:")
        played = play(dsn, plan_of(MAP, paths, pace), shown=show)
        say(f"{played.ingested.states} states of persons, {played.ingested.lines} lines of walls and doors.")
        events = played.events
    rows = [_row(part, each) for part, each in score(labels, events).items()]
    for line in table(rows).splitlines():
        say(line.removeprefix("  "))
    say(verdict(*(sum(row[key] for row in rows) for key in ("happened", "found", "made_up"))))


def _play_live(
    dsn: str, paths: OfficePaths, supervisor: Supervisor, show: Callable[[PlayedEvent], None]
) -> Sequence[PlayedEvent]:
    """The events of a bridge that hears the recording."""
    from semap_bridge.adapters.ros.playing import play as publish  # noqa: PLC0415
    from semap_bridge.adapters.ros.settings import Ros2Settings  # noqa: PLC0415

    from semap_service.evaluation.office import camera_model  # noqa: PLC0415
    from semap_service.evaluation.play import listening, wait_for_rules  # noqa: PLC0415

    settings = Ros2Settings(name="player", kind="ros2", domain=LIVE_DOMAIN, interface="127.0.0.1")
    with TemporaryDirectory() as folder, listening(dsn, MAP, show) as events:
        config = Path(folder) / "robot.yaml"
        config.write_text(LIVE.format(map=MAP, domain=LIVE_DOMAIN, model=camera_model()))
        supervisor.start("bridge", "run", str(config), "--log-level", "warning", may_end=True)
        robot = settings.graph("semap_player")
        try:
            publish(paths.recording, robot, Signal(), wait_s=LISTENER_S)
        finally:
            robot.close()
        wait_for_rules(dsn)
        Signal().wait(STILL_S)
        wait_for_rules(dsn)
    return events


def verdict(happened: int, found: int, made_up: int) -> str:
    """A line on how events compare with labels."""
    if found == happened and not made_up:
        return f"All {happened} that happened were found within half a second, and nothing else was."
    return (
        f"{found} of {happened} that happened were found within half a second;"
        f" {counted(made_up, 'event')} fit nothing that did."
    )


class _Row(TypedDict):
    what: str
    happened: int
    found: int
    made_up: int
    median_error_ms: float | None


def _row(part: str, scores: Scores) -> _Row:
    errors_ms = [abs(error_ms) for error_ms in scores.errors_ms]
    return {
        "what": part,
        "happened": len(scores.matched) + len(scores.missed),
        "found": len(scores.matched),
        "made_up": len(scores.made_up),
        "median_error_ms": round(median(errors_ms)) if errors_ms else None,
    }


def _announced(say: Say, advance: Advance) -> Advance:
    """Says at the first call that something is being made; without one it was there."""
    is_said = False

    def told(done: int, total: int) -> None:
        nonlocal is_said
        if not is_said:
            say("The recording is made once, which takes about half a minute ...")
            is_said = True
        advance(done, total)

    return told


def _said(event: PlayedEvent) -> str:
    """The sentence of `semap events`."""
    measures = {name: value for name, value in event.measures.items() if value is not None and name != "room"}
    return sentence(
        {
            "seq": event.seq,
            "stamp": to_datetime(event.stamp_us),
            "track": event.track,
            "type": event.type,
            "key": {},
            "instance": event.place,
            "measures": measures,
            "cause": None,
            "confidence": None,
            "amended_by": None,
            "verdict": None,
        }
    )
