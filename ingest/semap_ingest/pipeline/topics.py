"""Which topics of a recording play which part: the sensors that it has, where nobody says it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from semap.errors import InvalidInput
from semap_ingest.pipeline.image_topics import Looks, looks_by_name, superfluous
from semap_ingest.recording.camera_message import is_depth
from semap_ingest.recording.reading import Topic

PARTS: Mapping[str, tuple[str, ...]] = {
    "scan": ("LaserScan",),
    "image": ("CompressedImage", "Image"),
    "camera_info": ("CameraInfo",),
    "boxes": ("Detection2DArray",),
    "poses": (
        "Detection3DArray", "People", "TrackedPersons", "DetectedPersons", "PersonArray", "PoseArray",
        "PoseWithCovarianceStamped", "PoseStamped",
    ),
    "transforms": ("TFMessage", "tfMessage"),
    "odometry": ("Odometry",),
}  # fmt: skip
"""By the type of their messages; where several types fit, the first that is there."""
CHOSEN_BY_NAME_ONLY = ("poses",)
"""A pose may be anything, a goal for instance: it is a person only where the user says so."""
SENSED = ("scan", "image", "boxes", "poses")


@dataclass(frozen=True)
class Parts:
    """Topics by the part that they play; a part that none plays is missing.

    useless  topics that would fit and that cannot be used: what is wrong with their messages
    infos    by camera, the topic of its camera_info where its name or the user says which
    """

    topics: Mapping[str, tuple[str, ...]]
    useless: Mapping[str, str] = field(default_factory=dict)
    infos: Mapping[str, str] = field(default_factory=dict)

    def has(self, part: str) -> bool:
        return bool(self.topics.get(part))

    def without(self, part: str) -> Parts:
        """The same, and this part is played by none."""
        return replace(self, topics={**self.topics, part: ()})

    def all(self) -> Collection[str]:
        return {topic for topics in self.topics.values() for topic in topics}


def cast_parts(
    topics: Sequence[Topic],
    named: Mapping[str, Sequence[str]],
    *,
    looks_at_images: bool = True,
    flaw_of: Callable[[str], str] = lambda name: "",
    frame_of: Callable[[str], str] = lambda name: "",
    looks: Callable[[str], Looks] = looks_by_name,
) -> Parts:
    """Give each part its topics: those that are named, else those of a fitting type.

    Several topics are several sensors where they are of different frames; of an RGB-D camera only the colour
    is one (`image_topics`). Who has found persons is not asked to find them again: boxes stand in for images,
    poses for both, and tf for odometry, unless the other is named, too.

    named            topics by part; none leaves the part out
    looks_at_images  whether there is a detector for them
    flaw_of          what is wrong with the messages of a topic, such as images of depth; empty: nothing
    frame_of         the frame of the messages of a topic; empty: not known
    looks            whether its images are in colour
    raises           InvalidInput for a part or a topic that is not there or does not fit, where several
                     topics could be one sensor, and where there is nothing to find persons in
    """
    known = {topic.name: topic for topic in topics if topic.count and topic.is_read}
    cast = {part: tuple(name for name in names if name) for part, names in named.items()}
    for part, names in cast.items():
        _check_named(part, names, known)
    useless: dict[str, str] = {}

    def has(part: str) -> bool:
        return bool(cast.get(part))

    def find(part: str, is_wanted: bool) -> None:
        if part not in cast:
            is_wanted = is_wanted and part not in CHOSEN_BY_NAME_ONLY
            fitting = [name for name in sorted(known) if is_wanted and _kind(known[name]) in PARTS[part]]
            useless.update((name, flaw) for name in fitting if (flaw := flaw_of(name)))
            usable = {name: known[name] for name in fitting if name not in useless}
            cast[part] = _by_type(part, usable)
            if part == "image":
                distances = [name for name in fitting if name in useless and is_depth(useless[name])]
                useless.update(superfluous(cast[part], distances, looks, frame_of))
                cast[part] = tuple(name for name in cast[part] if name not in useless)
            if part in SENSED and len(cast[part]) > 1:
                frames = [frame_of(name) for name in cast[part]]
                if "" in frames or len(set(frames)) < len(frames):
                    raise _several(part, cast[part])

    find("scan", True)
    find("poses", True)
    find("boxes", not (has("poses") or has("image")))
    find("image", looks_at_images and not (has("poses") or has("boxes")))
    find("camera_info", has("image") or has("boxes"))
    find("transforms", True)
    find("odometry", not has("transforms"))
    if has("image") and has("boxes"):
        raise InvalidInput(
            "both images and boxes are named", "Leave one of them out, or write a rig: --rig FILE.", "--topic"
        )
    if not any(has(part) for part in SENSED):
        flaws = "".join(f" Of {name} it cannot use: {flaw}." for name, flaw in useless.items())
        there = f"It has {', '.join(f'{t.name} ({t.type})' for t in topics) or 'no topics'}.{flaws}"
        clouds = [topic.name for topic in known.values() if _kind(topic) == "PointCloud2"]
        if clouds:
            entry = f"{{kind: laser, topic: {clouds[0]}, slice_m: [LOW, HIGH]}}"
            there += f" A slice of a cloud makes scans, as a sensor of a rig: {entry}."
        has_images = any(topic.type.endswith(PARTS["image"]) for topic in known.values())
        raise InvalidInput(
            "the recording has neither scans nor images nor detections of persons that could be looked at",
            f"Name a detector for its images: --camera-model FILE. {there}" if has_images else there,
        )
    return Parts(cast, useless, _infos(cast, is_named="camera_info" in named))


def _infos(cast: Mapping[str, tuple[str, ...]], *, is_named: bool) -> dict[str, str]:
    """Each camera's camera_info: the one that is named, else the one deepest in the folders above its own."""
    infos = cast["camera_info"]
    cameras = (*cast["image"], *cast["boxes"])
    found = {}
    for camera in cameras:
        beside = [name for name in infos if _is_beside(name, camera)]
        if beside:
            found[camera] = max(beside, key=len)
        elif is_named and len(infos) == 1:
            found[camera] = infos[0]
    return found


def _check_named(part: str, names: Sequence[str], known: Mapping[str, Topic]) -> None:
    if part not in PARTS:
        raise InvalidInput(f"there is no part {part!r}", f"Choose from {', '.join(PARTS)}.", "--topic")
    for name in names:
        if name not in known:
            raise InvalidInput(
                f"the recording has no messages of the topic {name!r} that semap reads",
                f"It has {', '.join(sorted(known)) or 'none'}.",
                "--topic",
            )
        if _kind(known[name]) not in PARTS[part]:
            raise InvalidInput(
                f"the topic {name!r} is of the type {known[name].type}",
                f"For the part {part} name one of {', '.join(PARTS[part])}.",
                "--topic",
            )


def _by_type(part: str, known: Mapping[str, Topic]) -> tuple[str, ...]:
    """Those of the first type that is there; packed images stand for the raw ones of their camera."""
    by_type = [
        tuple(sorted(name for name, topic in known.items() if _kind(topic) == type_name))
        for type_name in PARTS[part]
    ]
    if part == "image":
        packed, raw = by_type
        return (*packed, *(name for name in raw if not any(_is_beside(name, each) for each in packed)))
    return next((names for names in by_type if names), ())


def _several(part: str, names: Sequence[str]) -> InvalidInput:
    every = " ".join(f"--topic {part}={name}" for name in names)
    return InvalidInput(
        f"several topics could be the {part}: {', '.join(names)}",
        f"Say which: --topic {part}={names[0]}; name all if they are different sensors: {every};"
        f" or leave it out: --topic {part}=",
    )


def _is_beside(name: str, image: str) -> bool:
    return _folder(image).startswith(_folder(name))


def _kind(topic: Topic) -> str:
    return topic.type.rpartition("/")[2]


def _folder(name: str) -> str:
    return name.rpartition("/")[0] + "/"
