"""A recording of sensors into the database: read, perceive, write, at its own pace or as fast as it goes.

At a pace every result is committed as soon as it is there; else a second of the recording is a transaction.
What is written is the same. After a crash, or when the server was away, it goes on after the last commit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from importlib.resources import as_file
from pathlib import Path
from threading import Event as Signal

from semap.errors import InvalidInput, ServerUnavailable
from semap.store.database.name import require_plain_name
from semap_ingest.laser.detector import PACKAGED
from semap_ingest.pipeline.delivery import Delivery, Target
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.identity import fingerprint
from semap_ingest.pipeline.image_topics import looks_by_name, looks_of
from semap_ingest.pipeline.meter import Meter, no_meter
from semap_ingest.pipeline.pace import Pace
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.proposal import Wishes, rig_of
from semap_ingest.pipeline.rig import Fixed, Rig
from semap_ingest.pipeline.rig_sensors import box_files_of, sensors_of, topics_of
from semap_ingest.pipeline.sensor import Sensor
from semap_ingest.pipeline.survey import survey
from semap_ingest.pipeline.topics import cast_parts
from semap_ingest.recording.decoding import is_static
from semap_ingest.recording.gathered import Gathered
from semap_ingest.recording.reading import PERSON_CLASSES, Recording
from semap_ingest.sensing.transform import Transform
from semap_ingest.tracking.association import Association
from semap_ingest.tracking.deletion import Patience
from semap_ingest.tracking.map_tracker import MapTrackerSettings

BATCH_US = 1_000_000
QUIET_US = 60_000
"""At a pace a watermark that has moved so far is committed though nothing was found."""

Advance = Callable[[int, int], None]
"""Called with the tenths of a second done, and those in all."""


@dataclass(frozen=True)
class Plan:
    """What to bring in, and how.

    path         of the recording; None: the rig has files of boxes alone
    source       tracks are written to the source SOURCE/persons, lines to SOURCE/lines
    speed        so many times as fast as it happened; None: as fast as it goes
    rig          the sensors; None: what `topics` and the types of the recording's topics tell
    topics       topics by the part that they play, where it cannot be told from their types
    map_frame    the recording's frame that is the map's
    floor_z_m    height of the floor in it
    fixed        transforms that hold whatever the recording says
    transform_patience_s  how long records wait for their transform; None: as the rig says
    image_model  ONNX file of the image detector; None: images are not looked at, but where a rig names one
    image_layout, class_names  of its outputs, and a file of its classes, where the model does not tell
    providers    of onnxruntime
    images_hz    at most so many images a second are looked at; None: all
    person_classes  what the robot calls persons, where it has found them by itself
    raises       InvalidInput for numbers that cannot be
    """

    map_name: str
    source: str
    path: Path | None
    speed: float | None = None
    rig: Rig | None = None
    topics: Mapping[str, Sequence[str]] = field(default_factory=dict)
    map_frame: str = "map"
    floor_z_m: float = 0.0
    fixed: tuple[Fixed, ...] = ()
    transform_patience_s: float | None = None
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
        if self.transform_patience_s is not None and not self.transform_patience_s >= 0:
            raise InvalidInput(f"a patience of {self.transform_patience_s} s", "Give seconds, 0 or more.")
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
    rig, useless, recording = opened(plan)
    with recording:
        length_s = (recording.end_us - recording.start_us) / 1e6
        topics = topics_of(rig, recording.topics)
        identity = _identity(plan, rig, recording)
        floor_z_m = rig.floor_z_m
        path = str(plan.path or plan.source)
        target = Target(dsn, plan.map_name, plan.source, path, identity, floor_z_m)
        with closing(Delivery(target, stop, tally.count)) as delivery:
            if delivery.was_finished:
                return Ingested(0, length_s, 0, 0, 0, delivery.resumed_at, {})
            sensors = surveyed_sensors(rig, recording, plan.providers)
            perception = perception_of(rig, sensors, meter)
            learn_static(recording, perception)
            run = _Run(recording, plan, topics, perception, delivery, pace or Pace(plan.speed), meter)
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
        unfit = {f"{name}: {flaw}": counts[name] for name, flaw in useless.items()}
    return Ingested(
        perception.taken,
        length_s,
        tally.states,
        len(tally.tracks),
        tally.lines,
        delivery.resumed_at,
        {**unfit, **unread, **perception.left_out},
        is_whole,
        _fruitless(perception, bool(tally.states or tally.lines or delivery.resumed_at)) if is_whole else (),
    )


@dataclass(frozen=True)
class _Run:
    """A recording on its way into the database."""

    recording: Gathered
    plan: Plan
    topics: Collection[str]
    perception: Perception
    delivery: Delivery
    pace: Pace
    meter: Meter

    def play(self, stop: Signal, advance: Advance) -> bool:
        """Whether it went to the end; what was there before goes as fast as it can."""
        recording, delivery = self.recording, self.delivery
        total = (recording.end_us - recording.start_us) // 100_000
        committed_us = recording.start_us
        for received in recording.records(self.topics):
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
        perception, frame = self.perception, self.perception.map_frame
        if perception.placed or not perception.given_up:
            return
        known = ", ".join(sorted(perception.frames))
        reasons = sorted({f"{source}: {why}" for (source, _, _), why in perception.reasons.items()})
        raise InvalidInput(
            "\n  ".join([f"it is not known where its sensors stood in the frame {frame!r}", *reasons]),
            f"Say where a sensor is fixed: --transform {frame} CHILD x y z roll pitch yaw; or name the frame"
            f" that is the map's: --frame NAME. Its transforms name {known or 'nothing'}.",
            self.plan.source,
        )


def opened(plan: Plan) -> tuple[Rig, Mapping[str, str], Gathered]:
    """The rig of a plan as `rig_for` says it, and all that it has records in, open.

    raises  InvalidInput for files that cannot be used
    """
    if plan.path is None:
        if plan.rig is None:
            raise InvalidInput("there is no recording", "Name it; or a rig with files of boxes: --rig FILE.")
        return plan.rig, {}, Gathered(None, box_files_of(plan.rig))
    recording = Recording(plan.path, person_classes=plan.person_classes)
    try:
        rig, useless = rig_for(recording, plan)
        recording.frame_at = rig.frame_at()
        return rig, useless, Gathered(recording, box_files_of(rig))
    except BaseException:
        recording.close()
        raise


def surveyed_sensors(
    rig: Rig, recording: Gathered, providers: Sequence[str] = ("CPUExecutionProvider",)
) -> list[Sensor]:
    """The sensors of a rig, with what the first of their records tell of their timing."""
    timing = survey(recording, [each.topic for each in rig.sensors.values()])
    return sensors_of(rig, timing, providers, recording.followed)


def rig_for(recording: Recording, plan: Plan) -> tuple[Rig, Mapping[str, str]]:
    """The rig of a plan, or what the recording tells of one.

    returns  it, and topics that would fit and cannot be used: why
    """
    if plan.rig is not None:
        said: dict[str, object] = {"transforms": (*plan.rig.transforms, *plan.fixed)}
        if plan.transform_patience_s is not None:
            said["transform_patience_s"] = plan.transform_patience_s
        return plan.rig.detecting(plan.image_model).model_copy(update=said), {}
    parts = cast_parts(
        recording.topics,
        plan.topics,
        looks_at_images=plan.image_model is not None,
        flaw_of=recording.flaw_of,
        frame_of=recording.frame_of,
        looks=lambda topic: looks_of(recording.first_of(topic)) or looks_by_name(topic),
    )
    return rig_of(parts, wishes_of(plan)), parts.useless


def wishes_of(plan: Plan) -> Wishes:
    """What a plan wishes of all sensors."""
    return Wishes(
        plan.map_frame,
        plan.floor_z_m,
        plan.image_model,
        plan.image_layout,
        plan.class_names,
        plan.images_hz,
        tuple(plan.person_classes),
        plan.fixed,
        plan.transform_patience_s,
    )


def learn_static(recording: Gathered, perception: Perception) -> None:
    """What always holds, whenever it was recorded; of a frame told twice the first until the second comes."""
    topics = [each.name for each in recording.topics if each.is_read and is_static(each.name)]
    told = recording.records(topics) if topics else ()
    for received in reversed([each.value for each in told if isinstance(each.value, Transform)]):
        perception.learn(received)


def perception_of(
    rig: Rig, sensors: Sequence[Sensor], meter: Meter = no_meter, *, kept_us: int | None = None
) -> Perception:
    """A perception that has seen nothing yet.

    kept_us  how long a track goes on unseen; None: as is best for sensors that look all the time
    """
    tracking = MapTrackerSettings(existence=rig.confirmation.existence())
    if kept_us is not None:
        patience, hidden = Patience(kept_us, kept_us, kept_us), Association(hidden_s=kept_us / 1e6)
        tracking = replace(tracking, patience=patience, association=hidden)
    patience_s = rig.transform_patience_s
    return Perception(
        sensors,
        rig.frame,
        rig.floor_z_m,
        fixed=rig.fixed(),
        localised_by=None if rig.localisation is None else rig.localisation.topic,
        transform_patience_us=None if patience_s is None else round(patience_s * 1e6),
        tracking=tracking,
        meter=meter,
    )


def _fruitless(perception: Perception, is_anything_in: bool) -> tuple[str, ...]:
    """What of a recording led to nothing, though it should have."""
    without_use = []
    for feeder in perception.feeders.values():
        name = feeder.sensor.name
        if not feeder.given:
            without_use.append(f"no record of {name} could be read")
        elif not feeder.used:
            without_use.append(f"none of {feeder.given} records of {name} could be used")
    nothing = [] if is_anything_in else ["no person and no line was found"]
    return (*without_use, *nothing)


def _identity(plan: Plan, rig: Rig, recording: Gathered) -> str:
    """Of the recording, and of all of a plan that changes the results."""
    with as_file(PACKAGED) as legs:
        # the span tells a rate that is not in the rig
        span = (recording.start_us, recording.end_us)
        return fingerprint(plan.path, [legs, *rig.files()], (rig.said(), plan.providers, span))


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
