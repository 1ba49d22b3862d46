"""A recording of sensors into the database: read, perceive, write, at its own pace or as fast as it goes.

At a pace every result is committed as soon as it is there; else a second of the recording is a transaction.
What is written is the same. After a crash, or when the server was away, it goes on after the last commit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event as Signal

from semap_ingest.image.detector import ImageDetector
from semap_ingest.laser.detector import LegDetector
from semap_ingest.pipeline.delivery import Delivery, Target
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.identity import fingerprint
from semap_ingest.pipeline.meter import Meter, no_meter
from semap_ingest.pipeline.pace import Pace
from semap_ingest.pipeline.perception import Perception, Roles
from semap_ingest.pipeline.survey import survey
from semap_ingest.pipeline.topics import Parts, cast_parts
from semap_ingest.recording.reading import Received, Recording
from semap_ingest.sensing.image import CompressedImage, Image

BATCH_US = 1_000_000
QUIET_US = 60_000
"""At a pace a watermark that has moved so far is committed though nothing was found."""

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
    providers    of onnxruntime
    images_hz    at most so many images a second are looked at; None: all
    """

    map_name: str
    source: str
    path: Path
    speed: float | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    map_frame: str = "map"
    floor_z_m: float = 0.0
    image_model: Path | None = None
    providers: tuple[str, ...] = ("CPUExecutionProvider",)
    images_hz: float | None = None


@dataclass(frozen=True)
class Ingested:
    """What was made of a recording.

    length_s    from its first record to its last
    resumed_at  results that were there before
    left_out    records that could not be used: why, and how many
    """

    records: int
    length_s: float
    states: int
    tracks: int
    lines: int
    resumed_at: int
    left_out: Mapping[str, int]


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
    stop = stop or Signal()
    pace = pace or Pace(plan.speed)
    tally = _Tally()
    with Recording(plan.path) as recording:
        parts = cast_parts(recording.topics, plan.topics)
        if plan.image_model is None:
            parts = parts.without("image")
        perception = Perception(
            roles_of(parts, plan),
            survey(recording, parts, plan.images_hz),
            plan.map_frame,
            plan.floor_z_m,
            meter,
        )
        target = Target(
            dsn,
            plan.map_name,
            plan.source,
            str(plan.path),
            fingerprint(plan.path, plan.image_model, _options(plan)),
            plan.floor_z_m,
        )
        delivery = Delivery(target, stop, committed)
        total = (recording.end_us - recording.start_us) // 100_000
        try:
            committed_us = recording.start_us
            for received in _thinned(recording.records(parts.all()), plan.images_hz):
                pace.wait(received.sent_us, stop)
                if stop.is_set():
                    break
                found = perception.take(received)
                tally.count(found)
                delivery.add(found)
                span_us = BATCH_US if plan.speed is None else 0 if found.persons or found.lines else QUIET_US
                if received.sent_us - committed_us >= span_us:
                    with meter("commit"):
                        delivery.commit()
                    committed_us = received.sent_us
                    advance((received.sent_us - recording.start_us) // 100_000, total)
            else:
                found = perception.flush()
                tally.count(found)
                delivery.add(found)
                delivery.commit(is_over=True)
        finally:
            delivery.close()
        unread = {f"{each.topic}: {each.why.value}": each.count for each in recording.passed_over}
        length_s = (recording.end_us - recording.start_us) / 1e6
    return Ingested(
        perception.taken,
        length_s,
        tally.states,
        len(tally.tracks),
        tally.lines,
        delivery.resumed_at,
        {**unread, **perception.left_out},
    )


def _options(plan: Plan) -> tuple[object, ...]:
    """What of a plan changes the results."""
    return (sorted(plan.topics.items()), plan.map_frame, plan.floor_z_m, plan.images_hz)


def roles_of(parts: Parts, plan: Plan) -> Roles:
    """The detectors that a recording needs: for what it has, as far as there are models."""
    detector = None
    if parts.has("image") and plan.image_model is not None:
        detector = ImageDetector.open(plan.image_model, providers=plan.providers, min_score=LEAST_SCORE)
    return Roles(detector, LegDetector.open() if parts.has("scan") else None, parts.has("boxes"))


def _thinned(records: Iterator[Received], images_hz: float | None) -> Iterator[Received]:
    """Without the images that come sooner after the last one than at this rate, give or take a tenth."""
    if images_hz is None:
        yield from records
        return
    gap_us, last_us = 0.9e6 / images_hz, -(1 << 62)
    for received in records:
        if isinstance(received.value, Image | CompressedImage):
            if received.value.stamp_us - last_us < gap_us:
                continue
            last_us = received.value.stamp_us
        yield received


class _Tally:
    """Mutable: how much was found."""

    def __init__(self) -> None:
        self.states = self.lines = 0
        self.tracks: set[int] = set()

    def count(self, found: Found) -> None:
        self.states += sum(len(each.states) for each in found.persons)
        self.lines += sum(len(each.lines) for each in found.lines)
        for each in found.persons:
            self.tracks.update(each.states.track.tolist())
