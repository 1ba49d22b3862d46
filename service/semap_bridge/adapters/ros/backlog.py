"""Messages that wait for perception: as many as it may be behind, and the newest ones."""

from __future__ import annotations

from collections import Counter, deque
from threading import Condition

from semap_bridge.ros.graph import Heard

MOST = 2000
MOST_OF = {
    "sensor_msgs/msg/Image": 3,
    "sensor_msgs/msg/CompressedImage": 10,
    "sensor_msgs/msg/LaserScan": 100,
}


class Backlog:
    """Mutable; two threads share it."""

    def __init__(self) -> None:
        self._waiting: deque[Heard] = deque()
        self._counts: Counter[str] = Counter()
        self._changed = Condition()

    def put(self, heard: Heard) -> int:
        """Add one; how many were dropped for it: the oldest of its topic."""
        with self._changed:
            dropped = 0
            if self._counts[heard.topic] >= MOST_OF.get(heard.type, MOST):
                oldest = next(each for each in self._waiting if each.topic == heard.topic)
                self._waiting.remove(oldest)
                self._counts[heard.topic] -= 1
                dropped = 1
            self._waiting.append(heard)
            self._counts[heard.topic] += 1
            self._changed.notify()
            return dropped

    def take(self, wait_s: float) -> Heard | None:
        """The oldest; None where none came so long."""
        with self._changed:
            if not self._waiting:
                self._changed.wait(wait_s)
            if not self._waiting:
                return None
            heard = self._waiting.popleft()
            self._counts[heard.topic] -= 1
            return heard
