"""Which topics of a live robot play which part: topics come and go, and none is certain at first.

What was once seen is remembered, so that a part that was cast stays cast while its publisher is away.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from semap_ingest.pipeline.topics import PARTS, Parts, cast_parts
from semap_ingest.recording.decoding import DECODERS
from semap_ingest.recording.reading import Topic

from semap.errors import InvalidInput
from semap_bridge.ros.graph import Offer

CLOUD = "sensor_msgs/msg/PointCloud2"
CLOUD_REMEDY = (
    "Let the robot make scans of it (pointcloud_to_laserscan_node of the package of that name), and"
    " name the scan: topics: {scan: /scan}."
)
POSES = ("PoseWithCovarianceStamped", "Odometry")
SENSED = ("scan", "image", "boxes", "poses")


@dataclass
class Casting:
    """Mutable: what is offered, and who plays what.

    named       topics by part, as the settings say
    robot_pose  topic of the robot's own place
    parts       None until somebody plays a part
    trouble     why nobody does, or more could not: empty where nothing is wrong
    """

    named: Mapping[str, Sequence[str]]
    looks_at_images: bool
    robot_pose: str | None = None
    robot: str | None = None
    parts: Parts | None = None
    trouble: InvalidInput | None = None
    _known: dict[str, Offer] = field(default_factory=dict)

    def look(self, offers: Sequence[Offer]) -> bool:
        """Take note of what is offered now; whether parts are played by others than before."""
        for each in offers:
            if self._fits(each) or each.topic not in self._known:
                self._known[each.topic] = each
        try:
            self.trouble = None
            parts = self._cast(offers)
        except InvalidInput as error:
            self.trouble = error
            return False
        if self.parts is not None and all(
            parts.topics.get(part) == self.parts.topics.get(part) for part in PARTS
        ):
            return False
        self.parts = parts
        return True

    def wanted(self) -> list[Offer]:
        """What is to be heard."""
        names = set(() if self.parts is None else self.parts.all()) | {self.robot_pose}
        return [
            each for each in self._known.values()
            if each.topic in names or _kind(each.type) in PARTS["transforms"]
        ]  # fmt: skip

    def has_sensor(self) -> bool:
        return self.parts is not None and any(self.parts.has(part) for part in SENSED)

    def several(self, offers: Sequence[Offer]) -> dict[str, str]:
        """Topics that one sensor should have to itself, and who publishes them."""
        names = (
            ()
            if self.parts is None
            else [name for part in (*SENSED, "camera_info") for name in self.parts.topics.get(part, ())]
        )
        found: dict[str, str] = {}
        for name in names:
            every = [each for each in offers if each.topic == name]
            nodes = ", ".join(sorted({node for each in every for node in each.nodes}))
            if len(every) > 1:
                found[name] = f"it has several types: {', '.join(each.type for each in every)}"
            elif every and every[0].publishers > 1:
                found[name] = f"{every[0].publishers} publishers share it ({nodes or 'of no known name'})"
        return found

    def _cast(self, offers: Sequence[Offer]) -> Parts:
        for part, names in self.named.items():
            if part not in PARTS:
                raise InvalidInput(f"there is no part {part!r}", f"Choose from {', '.join(PARTS)}.", "topics")
            for name in names:
                _require_fit(f"For the part {part}", name, PARTS[part], offers)
        if self.robot_pose:
            _require_fit("For robot_pose", self.robot_pose, POSES, offers)
        usable = {
            part: tuple(name for name in names if not name or name in self._known)
            for part, names in self.named.items()
        }
        usable = {part: names for part, names in usable.items() if names or not self.named[part]}
        waited = [name for names in self.named.values() for name in names if name and name not in self._known]
        topics = [
            Topic(each.topic, each.type, each.publishers, each.type in DECODERS)
            for each in self._known.values()
            if each.topic != self.robot_pose
        ]
        try:
            parts = cast_parts(topics, usable, looks_at_images=self.looks_at_images)
        except InvalidInput as error:
            if (self.robot_pose or self.robot) and not any(
                each.type in DECODERS and _is_sensed(each) for each in self._known.values()
            ):
                return Parts({"transforms": tuple(t.name for t in topics if t.type.endswith("TFMessage"))})
            raise self._said(error, waited) from error
        if waited:
            self.trouble = InvalidInput(
                f"nobody publishes {', '.join(waited)}", "Start what does, or correct `topics`."
            )
        return parts

    def _said(self, error: InvalidInput, waited: Sequence[str]) -> InvalidInput:
        if waited:
            return InvalidInput(
                f"nobody publishes {', '.join(waited)}", "Start what does, or correct `topics`."
            )
        if not self._known:
            return InvalidInput(
                "no topic is seen",
                "See that the robot runs, and that `domain`, `interface` and `peers` are those of the robot.",
            )
        if any(each.type == CLOUD for each in self._known.values()):
            names = ", ".join(each.topic for each in self._known.values() if each.type == CLOUD)
            return InvalidInput(f"{names} is of {CLOUD}, which is not read", CLOUD_REMEDY)
        said = str(error).replace("the recording", "the robot")
        return InvalidInput(said, _in_settings(error.remedy))

    def _fits(self, offer: Offer) -> bool:
        """Of two types under one name, the one that the part asks for."""
        part = next((part for part, names in self.named.items() if offer.topic in names), None)
        return part is None or _kind(offer.type) in PARTS.get(part, ())


def _in_settings(remedy: str) -> str:
    """Of options of the command line, as settings: several of one part are a list."""

    def said(options: re.Match[str]) -> str:
        names = re.findall(r"=([^ ;,]*)", options[0])
        listed = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
        return f"topics: {{{options[1]}: {listed}}}"

    return re.sub(r"--topic (\w+)=[^ ;,]*(?: --topic \1=[^ ;,]*)*", said, remedy)


def _is_sensed(offer: Offer) -> bool:
    return any(_kind(offer.type) in PARTS[part] for part in SENSED if part != "poses")


def _kind(type_name: str) -> str:
    return type_name.rpartition("/")[2]


def _require_fit(what: str, name: str, kinds: Sequence[str], offers: Sequence[Offer]) -> None:
    """Raises InvalidInput where a topic that was named is of another type."""
    types = {each.type for each in offers if each.topic == name}
    if not types or any(_kind(each) in kinds for each in types):
        return
    if CLOUD in types:
        raise InvalidInput(f"{name} is of {CLOUD}, which is not read", CLOUD_REMEDY)
    raise InvalidInput(
        f"{name} is of the type {', '.join(sorted(types))}",
        f"{what} name a topic of {' or '.join(kinds)}.",
    )
