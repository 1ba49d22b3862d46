"""Topics, whichever way they are reached: who offers which, their messages as bytes, both ways."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Offer:
    """What is published under one name.

    type        as ROS 2 writes it, also in ROS 1
    publishers  how many there are, and the names of their nodes as far as they are known
    definition  text of the type as its publisher has it; empty: not told
    is_reliable, is_latched  of all of them
    """

    topic: str
    type: str
    publishers: int = 1
    nodes: tuple[str, ...] = ()
    definition: str = ""
    is_reliable: bool = True
    is_latched: bool = False


@dataclass(frozen=True)
class Heard:
    """The bytes of a message, and when it was sent [us since 1970]."""

    topic: str
    type: str
    definition: str
    raw: bytes
    sent_us: int


class Publisher(ABC):
    """One topic of ours."""

    @abstractmethod
    def send(self, raw: bytes, sent_us: int | None = None) -> None:
        """sent_us: when, if not now; raises ServiceUnreachable"""

    @abstractmethod
    def listeners(self) -> int:
        """How many listen now."""


class Graph(ABC):
    """A node in a graph of topics. Its methods wait, and are called by threads.

    is_ros1  how bytes mean something
    lost     messages so far that were gone before they could be taken
    """

    is_ros1: bool
    lost: int = 0

    @abstractmethod
    def offers(self) -> Sequence[Offer]:
        """What others publish now, by name."""

    @abstractmethod
    def hear(self, offers: Collection[Offer]) -> None:
        """Subscribe to these, and to no others any more."""

    @abstractmethod
    def take(self, wait_s: float) -> Sequence[Heard]:
        """What came since, in the order of each topic; waits for something so long.

        raises  ServiceUnreachable
        """

    @abstractmethod
    def knows(self, type_name: str) -> bool:
        """Whether messages of a type can be published."""

    @abstractmethod
    def publish(self, topic: str, type_name: str, *, is_latched: bool = False) -> Publisher:
        """Offer a topic; a latched one is told to who comes later, too."""

    @abstractmethod
    def close(self) -> None:
        """Leave the graph."""
