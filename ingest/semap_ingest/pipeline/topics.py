"""Which topics of a recording play which part."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from semap.errors import InvalidInput
from semap_ingest.recording.reading import Topic

PARTS: Mapping[str, tuple[str, ...]] = {
    "scan": ("LaserScan",),
    "image": ("CompressedImage", "Image"),
    "camera_info": ("CameraInfo",),
    "boxes": ("Detection2DArray",),
    "poses": ("Detection3DArray", "PoseArray", "PoseWithCovarianceStamped", "PoseStamped"),
    "transforms": ("TFMessage", "tfMessage"),
    "odometry": ("Odometry",),
}
"""By the type of their messages; where several types fit, the first that is there."""
CHOSEN_BY_NAME_ONLY = ("poses",)
"""A pose may be anything, a goal for instance: it is a person only where the user says so."""
SEVERAL = ("transforms",)


@dataclass(frozen=True)
class Parts:
    """Topics by the part that they play; a part that none plays is missing.

    useless        topics that would fit and that cannot be used: what is wrong with their messages
    is_one_camera  camera_info is of the images, whatever frames they name: its topic or the user says so
    """

    topics: Mapping[str, tuple[str, ...]]
    useless: Mapping[str, str] = field(default_factory=dict)
    is_one_camera: bool = False

    def has(self, part: str) -> bool:
        return bool(self.topics.get(part))

    def without(self, part: str) -> Parts:
        """The same, and this part is played by none."""
        return replace(self, topics={**self.topics, part: ()})

    def all(self) -> Collection[str]:
        return {topic for topics in self.topics.values() for topic in topics}


def cast_parts(
    topics: Sequence[Topic],
    named: Mapping[str, str],
    *,
    looks_at_images: bool = True,
    flaw_of: Callable[[str], str] = lambda name: "",
) -> Parts:
    """Give each part its topics: those that are named, else the one of a fitting type.

    Who has found persons is not asked to find them again: boxes stand in for images, poses for both, and tf
    for odometry, unless the other is named, too.

    named            topics by part; an empty name leaves the part out
    looks_at_images  whether there is a detector for them
    flaw_of          what is wrong with the messages of a topic, such as images of depth; empty: nothing
    raises           InvalidInput for a part or a topic that is not there or does not fit, where several
                     topics fit, and where there is nothing to find persons in
    """
    known = {topic.name: topic for topic in topics if topic.count and topic.is_read}
    for part, name in named.items():
        _check_named(part, name, known)
    useless: dict[str, str] = {}
    cast: dict[str, tuple[str, ...]] = {part: (name,) if name else () for part, name in named.items()}

    def has(part: str) -> bool:
        return bool(cast.get(part))

    def find(part: str, is_wanted: bool) -> None:
        if part not in cast:
            is_wanted = is_wanted and part not in CHOSEN_BY_NAME_ONLY
            fitting = [name for name in sorted(known) if is_wanted and _kind(known[name]) in PARTS[part]]
            useless.update((name, flaw) for name in fitting if (flaw := flaw_of(name)))
            usable = {name: known[name] for name in fitting if name not in useless}
            cast[part] = _by_type(part, usable, cast.get("image", ()))

    find("scan", True)
    find("poses", True)
    find("boxes", not (has("poses") or has("image")))
    find("image", looks_at_images and not (has("poses") or has("boxes")))
    find("camera_info", has("image") or has("boxes"))
    find("transforms", True)
    find("odometry", not has("transforms"))
    if has("image") and has("boxes"):
        raise InvalidInput("both images and boxes are named", "Leave one of them out.", "--topic")
    if not any(has(part) for part in ("scan", "image", "boxes", "poses")):
        flaws = "".join(f" Of {name} it cannot use: {flaw}." for name, flaw in useless.items())
        there = f"It has {', '.join(f'{t.name} ({t.type})' for t in topics) or 'no topics'}.{flaws}"
        has_images = any(topic.type.endswith(PARTS["image"]) for topic in known.values())
        raise InvalidInput(
            "the recording has neither scans nor images nor detections of persons that could be looked at",
            f"Name a detector for its images: --camera-model FILE. {there}" if has_images else there,
        )
    infos, images = cast["camera_info"], cast["image"] or cast["boxes"]
    is_one = "camera_info" in named or any(_is_beside(name, images) for name in infos)
    return Parts(cast, useless, is_one)


def _check_named(part: str, name: str, known: Mapping[str, Topic]) -> None:
    if part not in PARTS:
        raise InvalidInput(f"there is no part {part!r}", f"Choose from {', '.join(PARTS)}.", "--topic")
    if not name:
        return
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


def _by_type(part: str, known: Mapping[str, Topic], images: Sequence[str]) -> tuple[str, ...]:
    """Of several cameras, the one that has the images is meant; packed images stand for raw ones."""
    if part == "image":
        _require_one_camera(known)
    for type_name in PARTS[part]:
        fitting = tuple(sorted(name for name, topic in known.items() if _kind(topic) == type_name))
        if part == "camera_info" and len(fitting) > 1:
            fitting = tuple(name for name in fitting if _is_beside(name, images)) or fitting
        if len(fitting) > 1 and part not in SEVERAL:
            raise _several(part, fitting)
        if fitting:
            return fitting
    return ()


def _require_one_camera(known: Mapping[str, Topic]) -> None:
    """Raises InvalidInput where packed images are of one camera, and raw ones of another."""
    packed = [name for name, topic in known.items() if _kind(topic) == "CompressedImage"]
    raw = [name for name, topic in known.items() if _kind(topic) == "Image"]
    if packed and not all(_is_beside(name, packed) for name in raw):
        raise _several("image", (*packed, *raw))


def _several(part: str, names: Sequence[str]) -> InvalidInput:
    return InvalidInput(
        f"several topics could be the {part}: {', '.join(names)}",
        f"Say which: --topic {part}={names[0]}, or leave it out: --topic {part}=",
    )


def _is_beside(name: str, images: Sequence[str]) -> bool:
    return any(_folder(image).startswith(_folder(name)) for image in images)


def _kind(topic: Topic) -> str:
    return topic.type.rpartition("/")[2]


def _folder(name: str) -> str:
    return name.rpartition("/")[0] + "/"
