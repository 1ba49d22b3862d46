"""A recording of sensors into the database: read, perceive, write, at its own pace or as fast as it goes.

At a pace every result is committed as soon as it is there; else a second of the recording is a transaction.
What is written is the same. After a crash, or when the server was away, it goes on after the last commit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from importlib.resources import as_file
from pathlib import Path
from threading import Event as Signal

from semap.errors import InvalidInput, ServerUnavailable
from semap.store.name import require_plain_name
from semap_ingest.image.detector import ImageDetector
from semap_ingest.laser.detector import PACKAGED, LegDetector
from semap_ingest.pipeline.delivery import Delivery, Target
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.identity import fingerprint
from semap_ingest.pipeline.meter import Meter, no_meter
from semap_ingest.pipeline.pace import Pace
from semap_ingest.pipeline.perception import CAMERA, Perception
from semap_ingest.pipeline.roles import Roles
from semap_ingest.pipeline.survey import survey
from semap_ingest.pipeline.thinning import thinned
from semap_ingest.pipeline.topics import Parts, cast_parts
from semap_ingest.recording.reading import PERSON_CLASSES, Recording

BATCH_US = 1_000_000
QUIET_US = 60_000
"""At a pace a watermark that has moved so far is committed though nothing was found."""

SENSED = {"scan": ("scan",), CAMERA: ("image", "boxes"), "poses": ("poses",)}
"""What topics play, by what perception calls it."""

LEAST_SCORE = 0.2
"""Of a box that is kept: weak ones go on with tracks, but begin none."""

Advance = Callable[[int, int], None]
"""Called with the tenths of a second done, and those in all."""


@dataclass(frozen=True)
class Plan:
    """What to bring in, and how.

    source       tracks are written to the source SOURCE/persons, lines to SOURCE/lines
    speed        so many times as fast as it happened; None: as fast as it goes
    topics       topics by the part that they play, where it cannot be told from their types
    map_frame    the recording's frame that is the map's
    floor_z_m    height of the floor in it
    image_model  ONNX file of the image detector; None: images are not looked at
    image_layout, class_names  of its outputs, and a file of its classes, where the model does not tell
    providers    of onnxruntime
    images_hz    at most so many images a second are looked at; None: all
    person_classes  what the robot calls persons, where it has found them by itself
    raises       InvalidInput for numbers that cannot be
    """

    map_name: str
    source: str
    path: Path
    speed: float | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    map_frame: str = "map"
    floor_z_m: float = 0.0
    image_model: Path | None = None
    image_layout: str | None = None
    class_names: Path | None = None
    providers: tuple[str, ...] = ("CPUExecutionProvider",)
    images_hz: float | None = None
    person_classes: Collection[str] = PERSON_CLASSES

    def __post_init__(self) -> None:
        for name, value in (("a pace", self.speed), ("a rate of images", self.images_hz)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InvalidInput(f"{name} of {value}", "Give a number above 0.")
        if not math.isfinite(self.floor_z_m):
            raise InvalidInput(f"a floor at {self.floor_z_m} m", "Give its height in metres.")


@dataclass(frozen=True)
class Ingested:
    """What was made of a recording.

    length_s    from its first record to its last
    resumed_at  results that were there before
    left_out    records that could not be used: why, and how many
    is_whole    false where it was stopped: another call goes on
    fruitless   what of it led to nothing, though it should have; `left_out` says why
    """

    records: int
    length_s: float
    states: int
    tracks: int
    lines: int
    resumed_at: int
    left_out: Mapping[str, int]
    is_whole: bool = True
    fruitless: tuple[str, ...] = ()


def ingest_recording(
    dsn: str,
    plan: Plan,
    advance: Advance = lambda done, total: None,
    stop: Signal | None = None,
    *,
    meter: Meter = no_meter,
    committed: Callable[[Found], None] = lambda found: None,
    pace: Pace | None = None,
) -> Ingested:
    """Bring in all that is not in yet.

    committed  called with each result after its commit
    pace       instead of one of the plan's speed, for a caller who wants to know when records were due
    raises     NotFound, where there is no such map; Conflict, where the source has another recording, or
               another process brings this one in; InvalidInput, where the recording cannot be used
    """
    require_plain_name(plan.source, "--source")
    stop = stop or Signal()
    tally = _Tally(committed)
    with Recording(plan.path, person_classes=plan.person_classes) as recording:
        length_s = (recording.end_us - recording.start_us) / 1e6
        parts = cast_parts(
            recording.topics,
            plan.topics,
            looks_at_images=plan.image_model is not None,
            flaw_of=recording.flaw_of,
        )
        _require_camera(parts)
        roles = roles_of(parts, plan)
        target = Target(
            dsn, plan.map_name, plan.source, str(plan.path), _identity(plan, parts), plan.floor_z_m
        )
        with closing(Delivery(target, stop, tally.count)) as delivery:
            if delivery.was_finished:
                return Ingested(0, length_s, 0, 0, 0, delivery.resumed_at, {})
            timing = survey(recording, parts, plan.images_hz)
            perception = Perception(roles, timing, plan.map_frame, plan.floor_z_m, meter)
            run = _Run(recording, plan, parts, perception, delivery, pace or Pace(plan.speed), meter)
            try:
                is_whole = run.play(stop, advance)
            except ServerUnavailable:
                if not stop.is_set():
                    raise
                is_whole = False
            except InvalidInput:
                delivery.give_up()
                raise
        unread = {
            f"{each.topic}: {each.why.value} (the first: {each.example})": each.count
            for each in recording.passed_over
        }
        counts = {topic.name: topic.count for topic in recording.topics}
        useless = {f"{name}: {flaw}": counts[name] for name, flaw in parts.useless.items()}
    return Ingested(
        perception.taken,
        length_s,
        tally.states,
        len(tally.tracks),
        tally.lines,
        delivery.resumed_at,
        {**useless, **unread, **perception.left_out},
        is_whole,
        _fruitless(perception, parts, bool(tally.states or tally.lines or delivery.resumed_at))
        if is_whole
        else (),
    )


@dataclass(frozen=True)
class _Run:
    """A recording on its way into the database."""

    recording: Recording
    plan: Plan
    parts: Parts
    perception: Perception
    delivery: Delivery
    pace: Pace
    meter: Meter

    def play(self, stop: Signal, advance: Advance) -> bool:
        """Whether it went to the end; what was there before goes as fast as it can."""
        recording, delivery = self.recording, self.delivery
        total = (recording.end_us - recording.start_us) // 100_000
        committed_us = recording.start_us
        for received in thinned(recording.records(self.parts.all()), self.plan.images_hz):
            if not delivery.is_catching_up:
                self.pace.wait(received.sent_us, stop)
            if stop.is_set():
                return False
            found = self.perception.take(received)
            delivery.add(found)
            if received.sent_us - committed_us >= self._span_us(found):
                self._commit()
                committed_us = received.sent_us
                advance((received.sent_us - recording.start_us) // 100_000, total)
        delivery.add(self.perception.flush())
        self._require_placed()
        self._commit(is_over=True)
        return True

    def _span_us(self, found: Found) -> int:
        """How much of a recording is a transaction."""
        if self.plan.speed is None:
            return BATCH_US
        return 0 if found.persons or found.lines else QUIET_US

    def _commit(self, *, is_over: bool = False) -> None:
        with self.meter("commit"):
            self.delivery.commit(is_over=is_over)

    def _require_placed(self) -> None:
        """Raises InvalidInput where it never became known where the sensors stood."""
        perception, frame = self.perception, self.plan.map_frame
        if perception.placed or not perception.given_up:
            return
        known = ", ".join(sorted(perception.frames))
        reasons = sorted({f"{source}: {why}" for (source, _, _), why in perception.reasons.items()})
        raise InvalidInput(
            "\n  ".join([f"it is not known where its sensors stood in the frame {frame!r}", *reasons]),
            "Mend that in the recording, or name the frame that is the map's: --frame NAME. "
            + (f"Its transforms name {known}." if known else "It has none: a sensor's own frame may be it."),
            self.plan.path.name,
        )


def _require_camera(parts: Parts) -> None:
    """Raises InvalidInput where images are to be looked at, and nothing says how their camera sees."""
    if not (parts.has("image") or parts.has("boxes")) or parts.has("camera_info"):
        return
    flaws = [f"{name}: {flaw}" for name, flaw in parts.useless.items()]
    raise InvalidInput(
        "; ".join(["there is no calibration of the camera that took its images", *flaws]),
        "Record its camera_info, or leave the images out: --topic image= --topic boxes=",
    )


def _fruitless(perception: Perception, parts: Parts, is_anything_in: bool) -> tuple[str, ...]:
    """What of a recording led to nothing, though it should have."""
    without_use = [
        f"none of {given} records of the {part} could be used"
        for part, given in perception.given.items()
        if not perception.used[part]
    ]
    silent = [
        f"no record of the {part} could be read"
        for part, kinds in SENSED.items()
        if any(parts.has(kind) for kind in kinds) and not perception.given[part]
    ]
    nothing = [] if is_anything_in else ["no person and no line was found"]
    return (*without_use, *silent, *nothing)


def _identity(plan: Plan, parts: Parts) -> str:
    """Of the recording, and of all of a plan that changes the results."""
    topics = sorted((part, names) for part, names in parts.topics.items() if names)
    classes = sorted(plan.person_classes)
    options = (
        topics,
        plan.map_frame,
        plan.floor_z_m,
        plan.images_hz,
        classes,
        plan.providers,
        plan.image_layout,
    )
    with as_file(PACKAGED) as legs:
        of_images = [each for each in (plan.image_model, plan.class_names) if each and parts.has("image")]
        models = [legs, *of_images]
        return fingerprint(plan.path, models, options)


def roles_of(parts: Parts, plan: Plan) -> Roles:
    """The detectors that a recording needs: for what it has, as far as there are models."""
    detector = None
    if parts.has("image") and plan.image_model is not None:
        detector = ImageDetector.open(
            plan.image_model,
            layout=plan.image_layout,
            class_names=plan.class_names,
            providers=plan.providers,
            min_score=LEAST_SCORE,
        )
    return Roles(
        detector,
        LegDetector.open() if parts.has("scan") else None,
        parts.has("boxes"),
        parts.has("poses"),
        parts.is_one_camera,
        plan.person_classes,
    )


class _Tally:
    """Mutable: how much was written."""

    def __init__(self, committed: Callable[[Found], None]) -> None:
        self.states = self.lines = 0
        self.tracks: set[int] = set()
        self._committed = committed

    def count(self, found: Found) -> None:
        """After its commit."""
        self.states += sum(len(each.states) for each in found.persons)
        self.lines += sum(len(each.lines) for each in found.lines)
        for each in found.persons:
            self.tracks.update(each.states.track.tolist())
        self._committed(found)
