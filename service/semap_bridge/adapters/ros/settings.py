"""What a config may say of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, get_args

from pydantic import BeforeValidator, Field
from semap_ingest.pipeline.proposal import Wishes
from semap_ingest.pipeline.topics import PARTS
from semap_ingest.recording.reading import PERSON_CLASSES

from semap_bridge import adapter
from semap_bridge.config import ConfigPath
from semap_bridge.ros.graph import Graph
from semap_bridge.ros.network import Ros1Network, Ros2Network, TopicName

Told = Literal["map", "markers", "people", "detections", "events", "room"]
TopicNames = Annotated[
    tuple[TopicName, ...], BeforeValidator(lambda said: (said,) if isinstance(said, str) else said)
]
FrameName = Annotated[str, Field(min_length=1, max_length=200)]


class RosSettings(adapter.Settings):
    """Of both kinds of ROS."""

    def graph(self, node: str) -> Graph:
        """A node of this name; raises ServiceUnreachable."""
        raise NotImplementedError

    def wishes(self) -> Wishes:
        """What is wished of all its sensors."""
        return Wishes(
            self.frame,
            self.floor_z_m,
            self.image_model,
            self.image_layout,
            self.class_names,
            self.images_hz,
            self.person_classes,
            transform_patience_s=self.transform_patience_s,
        )

    sense: bool = Field(default=True, description="Bring in what the robot's sensors say.")
    topics: Mapping[str, TopicNames] = Field(
        default_factory=dict,
        description=f"Topics by part ({', '.join(PARTS)}), where several fit: one, or a list of several"
        " sensors; empty: none.",
    )
    frame: FrameName = Field(default="map", description="The robot's frame that is the map's.")
    robot: FrameName | None = Field(
        default=None, description="The robot's own frame, such as base_link: then its place is a track."
    )
    robot_pose: TopicName | None = Field(
        default=None,
        description="A PoseWithCovarianceStamped of the robot, where tf does not tell its place.",
    )
    robot_name: adapter.Name | None = Field(
        default=None, description="Of the robot's track. [default: the bridge's]"
    )
    floor_z_m: float = Field(default=0.0, description="Height of the floor in the frame of the map [m].")
    image_model: ConfigPath | None = Field(
        default=None,
        description="ONNX file of a detector for images, or name of one that was added. [default: they are"
        " not looked at]",
    )
    image_layout: str | None = Field(
        default=None, description="Of its outputs, where the model does not tell."
    )
    class_names: ConfigPath | None = Field(default=None, description="File of its classes, in the same case.")
    images_hz: float | None = Field(default=None, gt=0, description="So many images a second, at most.")
    person_classes: tuple[str, ...] = Field(
        default=PERSON_CLASSES, description="What the robot calls persons, where it finds them by itself."
    )
    transform_patience_s: float = Field(
        default=0.5, ge=0, le=60, description="How long what sensors say waits for its transform [s]."
    )
    tell: tuple[Told, ...] = Field(default=get_args(Told), description="What is published; []: nothing.")
    namespace: str = Field(
        default="semap",
        pattern=r"^[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$",
        description="Of its topics.",
    )
    people_hz: float = Field(default=5.0, gt=0, le=50, description="How often people are published.")


class Ros2Settings(Ros2Network, RosSettings):
    """What a config may say of a robot of ROS 2."""


class Ros1Settings(Ros1Network, RosSettings):
    """What a config may say of a robot of ROS 1."""
