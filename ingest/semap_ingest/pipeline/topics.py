"""Which topics of a recording play which part."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from semap.errors import InvalidInput
from semap_ingest.recording.reading import Topic

PARTS: Mapping[str, tuple[str, ...]] = {
    "scan": ("LaserScan",),
    "image": ("CompressedImage", "Image"),
    "camera_info": ("CameraInfo",),
    "boxes": ("Detection2DArray",),
    "poses": ("Detection3DArray", "PoseArray", "PoseWithCovarianceStamped", "PoseStamped"),
    "transforms": ("TFMessage",),
    "odometry": ("Odometry",),
}
"""By the type of their messages; where several types fit, the first that is there."""
CHOSEN_BY_NAME_ONLY = ("poses",)
"""A pose may be anything, a goal for instance: it is a person only where the user says so."""
SEVERAL = ("transforms",)


@dataclass(frozen=True)
class Parts:
    """Topics by the part that they play; a part that none plays is missing."""

    topics: Mapping[str, tuple[str, ...]]

    def has(self, part: str) -> bool:
        return bool(self.topics.get(part))

    def without(self, part: str) -> Parts:
        """The same, and this part is played by none."""
        return Parts({**self.topics, part: ()})

    def all(self) -> Collection[str]:
        return {topic for topics in self.topics.values() for topic in topics}


def cast_parts(topics: Sequence[Topic], named: Mapping[str, str]) -> Parts:
    """Give each part its topics: those that are named, else the one of a fitting type.

    named   topics by part; an empty name leaves the part out
    raises  InvalidInput for a part or a topic that is not there, and where several topics fit
    """
    known = {topic.name: topic for topic in topics if topic.count}
    for part, name in named.items():
        if part not in PARTS:
            raise InvalidInput(f"there is no part {part!r}", f"Choose from {', '.join(PARTS)}.", "--topic")
        if name and name not in known:
            raise InvalidInput(
                f"the recording has no messages of the topic {name!r}",
                f"It has {', '.join(sorted(known)) or 'none'}.",
                "--topic",
            )
    cast: dict[str, tuple[str, ...]] = {}
    for part, types in PARTS.items():
        if part in named:
            cast[part] = (named[part],) if named[part] else ()
        elif part not in CHOSEN_BY_NAME_ONLY:
            cast[part] = _by_type(part, types, known)
    if not any(cast.get(part) for part in ("scan", "image", "boxes", "poses")):
        raise InvalidInput(
            "the recording has neither scans nor images nor detections of persons",
            f"It has {', '.join(f'{t.name} ({t.type})' for t in topics) or 'no topics'}.",
        )
    if cast.get("boxes") and "image" not in named:
        cast["image"] = ()  # the robot has looked at its images itself
    if cast.get("transforms") and "odometry" not in named:
        cast["odometry"] = ()  # it is told by tf, too
    return Parts(cast)


def _by_type(part: str, types: Sequence[str], known: Mapping[str, Topic]) -> tuple[str, ...]:
    for type_name in types:
        fitting = tuple(sorted(n for n, topic in known.items() if topic.type.split("/")[-1] == type_name))
        if len(fitting) > 1 and part not in SEVERAL:
            raise InvalidInput(
                f"several topics could be the {part}: {', '.join(fitting)}",
                f"Say which: --topic {part}={fitting[0]}, or leave it out: --topic {part}=",
            )
        if fitting:
            return fitting
    return ()
