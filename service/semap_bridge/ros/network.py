"""How a robot is reached, as a config says it."""

from __future__ import annotations

import os
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from semap_bridge.ros.graph import Graph

TopicName = Annotated[str, Field(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$|^$")]


class Ros2Network(BaseModel):
    """How to reach a robot of ROS 2."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    domain: int = Field(
        default_factory=lambda: int(os.environ.get("ROS_DOMAIN_ID", "0")), ge=0, le=232,
        description="[default: ROS_DOMAIN_ID, else 0]",
    )  # fmt: skip
    interface: str | None = Field(
        default=None,
        pattern=r"^[A-Za-z0-9_.:-]+$",
        description="Address or name of the network; 127.0.0.1: this machine only. [default: CYCLONEDDS_URI]",
    )
    peers: tuple[Annotated[str, Field(pattern=r"^[A-Za-z0-9_.:-]+$")], ...] = Field(
        default=(), description="Machines, where multicast does not reach them."
    )

    def graph(self, node: str) -> Graph:
        from semap_bridge.ros.dds import Dds, network_config  # noqa: PLC0415

        return Dds(self.domain, node, network_config(self.interface, self.peers))


class Ros1Network(BaseModel):
    """How to reach a robot of ROS 1."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    master: str = Field(
        default_factory=lambda: os.environ.get("ROS_MASTER_URI", "http://127.0.0.1:11311"),
        pattern=r"^http://",
        description="[default: ROS_MASTER_URI]",
    )
    own_address: str | None = Field(
        default=None, description="Address of this machine as the robot reaches it. [default: ROS_IP]"
    )
    python: str = Field(default="/usr/bin/python3", description="A Python that has rospy.")

    def graph(self, node: str) -> Graph:
        from semap_bridge.ros.master import Rospy  # noqa: PLC0415

        return Rospy(self.master, node, self.own_address, self.python)
