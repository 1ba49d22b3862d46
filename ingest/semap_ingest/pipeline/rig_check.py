"""What a recording holds for a rig: its sensors, how often they speak, whether tf tells where they are."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from semap_ingest.pipeline.image_topics import looks_by_name, looks_of, superfluous
from semap_ingest.pipeline.proposal import Wishes, rig_of
from semap_ingest.pipeline.rig import CameraEntry, Finder, Laser, Rig
from semap_ingest.pipeline.sensor import READS
from semap_ingest.pipeline.survey import LOOKED_AT
from semap_ingest.pipeline.topics import CHOSEN_BY_NAME_ONLY, PARTS, cast_parts
from semap_ingest.recording.camera_message import is_depth
from semap_ingest.recording.gathered import Gathered
from semap_ingest.recording.reading import Recording, Topic
from semap_ingest.sensing.image import CompressedImage, Image
from semap_ingest.sensing.transform import Transform

MOST_TRANSFORMS = 20_000
ROOTS = ("map", "odom", "world")


@dataclass(frozen=True)
class Sight:
    """A sensor as a recording shows it.

    rate_hz   of its first records
    behind_s  how much later after their stamps they were recorded than those of the quickest sensor
    frame     that its records name
    trouble   what keeps it from being used; empty: nothing
    needs_detector  it has images, and nothing says who finds persons in them
    """

    name: str
    kind: str
    topic: str
    rate_hz: float
    behind_s: float
    frame: str
    trouble: str = ""
    needs_detector: bool = False


def sights(recording: Recording | Gathered, rig: Rig) -> list[Sight]:
    """Each sensor of a rig, whose topics are there."""
    top_of = _tops(recording, rig)
    found = []
    for name, each in rig.sensors.items():
        records = [
            one
            for one in islice(recording.records([each.topic]), LOOKED_AT)
            if isinstance(one.value, READS[each.kind])
        ]
        stamps = sorted(one.value.stamp_us for one in records)  # type: ignore[union-attr]  # as READS says
        span_s = (stamps[-1] - stamps[0]) / 1e6 if stamps else 0.0
        delays = sorted(one.sent_us - one.value.stamp_us for one in records)  # type: ignore[union-attr]
        frame = each.own_frame(name) or str(getattr(records[0].value, "frame", "") if records else "")
        found.append(
            Sight(
                name,
                each.kind,
                each.topic,
                (len(stamps) - 1) / span_s if span_s > 0 else 0.0,
                delays[len(delays) // 2] / 1e6 if delays else 0.0,
                frame,
                _trouble(bool(records), frame, top_of, rig.frame),
                isinstance(each, CameraEntry)
                and each.detector is None
                and any(isinstance(one.value, Image | CompressedImage) for one in records),
            )
        )
    soonest_s = min((each.behind_s for each in found), default=0.0)
    return [replace(each, behind_s=each.behind_s - soonest_s) for each in found]


def propose(recording: Recording) -> tuple[Rig, list[str]]:
    """A rig of all that could be a sensor, and what could not, or is not certain."""
    notes: list[str] = []
    named: dict[str, Sequence[str]] = {}
    taken: dict[tuple[str, str], str] = {}
    spare = _spare_images(recording)
    for part in ("scan", "image", "boxes"):
        kept = []
        for topic in _fitting(recording.topics, part):
            flaw = recording.flaw_of(topic.name) or spare.get(topic.name, "")
            frame = recording.frame_of(topic.name)
            twin = taken.get((part, frame))
            if flaw:
                notes.append(f"{topic.name} is left out: {flaw}")
            elif twin is not None:
                notes.append(f"{topic.name} is left out: of the frame {frame!r}, as {twin}")
            else:
                taken[part, frame] = topic.name
                kept.append(topic.name)
        named[part] = kept
    if named["image"] and named["boxes"]:
        notes.append(f"images are left out, since boxes are there: {', '.join(named['image'])}")
        named["image"] = []
    for part in CHOSEN_BY_NAME_ONLY:
        for topic in _fitting(recording.topics, part):
            notes.append(f"if {topic.name} tells where persons are: {{kind: finder, topic: {topic.name}}}")
    if not any(named.values()) and notes:
        return Rig(), notes
    parts = cast_parts(recording.topics, named, flaw_of=recording.flaw_of)
    top_of = _tops(recording, Rig())
    frame = next((root for root in ROOTS if root in top_of), "map")
    rig = rig_of(parts, Wishes(map_frame=frame))
    return _renamed(rig), notes


def _spare_images(recording: Recording) -> Mapping[str, str]:
    """Images that are not needed beside others, and why."""
    names = [each.name for each in _fitting(recording.topics, "image")]
    flaws = {name: recording.flaw_of(name) for name in names}
    return superfluous(
        [name for name in names if not flaws[name]],
        [name for name in names if is_depth(flaws[name])],
        lambda topic: looks_of(recording.first_of(topic)) or looks_by_name(topic),
        recording.frame_of,
    )


def rig_text(rig: Rig, seen: Sequence[Sight], notes: Sequence[str]) -> str:
    """A rig as a file that a person goes on with: what is to be filled in is a comment."""
    lines = [*(f"# {note}" for note in notes), f"frame: {rig.frame}", f"floor_z_m: {rig.floor_z_m:g}"]
    if rig.odometry is not None:
        lines.append(f"odometry: {rig.odometry}")
    lines.append("sensors:")
    for sight in seen:
        lines.append(f"  {sight.name}:  # {sight.rate_hz:.1f} Hz, {sight.behind_s * 1000:.0f} ms behind")
        lines += [f"    {line}" for line in _entry_lines(rig.sensors[sight.name])]
        if sight.needs_detector:
            lines.append("    # detector: FILE.onnx")
        if sight.trouble:
            lines.append(f"    # {sight.trouble}")
            lines.append(f"    # mount: {{parent: {rig.frame}, xyz_m: [0, 0, 0], rpy_rad: [0, 0, 0]}}")
    return "\n".join(lines) + "\n"


def _entry_lines(entry: Laser | CameraEntry | Finder) -> Iterator[str]:
    yield f"kind: {entry.kind}"
    yield f"topic: {entry.topic}"
    if isinstance(entry, CameraEntry):
        if entry.camera_info is not None:
            yield f"camera_info: {entry.camera_info}"
        if entry.laser is not None:
            yield f"laser: {entry.laser}"


def _renamed(rig: Rig) -> Rig:
    """With names that are words rather than topics."""
    names: dict[str, str] = {}
    for topic in rig.sensors:
        words = [word for word in re.split(r"\W+", topic) if word not in ("", "image", "compressed")]
        word = "_".join(words) or "sensor"
        while word in names.values():
            word += "_"
        names[topic] = word
    sensors = {
        names[topic]: each.model_copy(update={"laser": names[each.laser]})
        if isinstance(each, CameraEntry) and each.laser is not None
        else each
        for topic, each in rig.sensors.items()
    }
    return rig.model_copy(update={"sensors": sensors})


def _fitting(topics: Sequence[Topic], part: str) -> list[Topic]:
    kinds = [kind for kind in PARTS[part] if kind != "Odometry"]
    return [
        each
        for kind in kinds
        for each in topics
        if each.is_read and each.count and each.type.rpartition("/")[2] == kind
    ]


def _tops(recording: Recording | Gathered, rig: Rig) -> Mapping[str, str]:
    """The root of the tree of transforms in which each frame is, whenever they were told."""
    topics = [
        each.name
        for each in recording.topics
        if each.is_read and each.count and each.type.rpartition("/")[2] in PARTS["transforms"]
    ]
    topics += [rig.odometry] if rig.odometry is not None else []
    parent_of = {each.child: each.parent for each in rig.fixed()}
    if topics:
        for received in islice(recording.records(topics), MOST_TRANSFORMS):
            if isinstance(received.value, Transform):
                parent_of.setdefault(received.value.child, received.value.parent)
    return {frame: _top(frame, parent_of) for frame in {*parent_of, *parent_of.values()}}


def _top(frame: str, parent_of: Mapping[str, str]) -> str:
    for _ in parent_of:
        if frame not in parent_of:
            break
        frame = parent_of[frame]
    return frame


def _trouble(is_read: bool, frame: str, top_of: Mapping[str, str], map_frame: str) -> str:
    if not is_read:
        return "none of its first records can be used"
    if frame == map_frame or top_of.get(frame, "") == top_of.get(map_frame, map_frame):
        return ""
    if frame not in top_of:
        return f"no transform names its frame {frame!r}: say where it is fixed"
    return f"transforms lead from {frame!r} up to {top_of[frame]!r}, and not to {map_frame!r}"
