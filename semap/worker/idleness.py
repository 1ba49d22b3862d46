"""Which sources have fallen silent, by the worker's own clock, which is passed in.

A source is idle if it has not spoken for a while, although another one of its map has spoken since, be that
one ended by now or not. It then holds nobody up until it speaks again. Where all are silent, the last that
spoke is not idle: nothing would be gained.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

IDLE_AFTER_S = 10.0

Place = tuple[int, int]
"""Map and source."""


@dataclass(frozen=True, slots=True)
class Spoken:
    """When a source spoke last: by the server's clock, which tells who spoke after whom, and by ours."""

    at_us: int
    at_s: float


class Idleness:
    """Mutable: when each source spoke last, and which sources are idle."""

    def __init__(self, idle_after_s: float = IDLE_AFTER_S, idle: Iterable[Place] = ()) -> None:
        self._idle_after_s = idle_after_s
        self._maps: dict[int, dict[int, Spoken]] = {}
        self._idle: set[Place] = set(idle)

    def spoke(self, map_id: int, source_id: int, at_us: int, now_s: float) -> bool:
        """A source has spoken; whether it was idle."""
        self._maps.setdefault(map_id, {})[source_id] = Spoken(at_us, now_s)
        was_idle = (map_id, source_id) in self._idle
        self._idle.discard((map_id, source_id))
        return was_idle

    def known(self, map_id: int, source_id: int, at_us: int, now_s: float) -> None:
        """A source had spoken before the worker began; if it was idle, it still is."""
        self._maps.setdefault(map_id, {})[source_id] = Spoken(at_us, now_s)

    def ended(self, map_id: int, source_id: int) -> None:
        """Nothing is to be expected of a source, which is no silence; that it spoke counts for the others."""
        self._idle.add((map_id, source_id))

    def forget(self, map_id: int, source_id: int) -> None:
        """A source is gone."""
        self._maps.get(map_id, {}).pop(source_id, None)
        self._idle.discard((map_id, source_id))

    def forget_map(self, map_id: int) -> None:
        """A map is gone with its sources."""
        for source_id in self._maps.pop(map_id, {}):
            self._idle.discard((map_id, source_id))

    def fallen_silent(self, now_s: float) -> Iterable[Place]:
        """The sources that are idle from now on."""
        found = [
            (map_id, source_id)
            for map_id, sources in self._maps.items()
            if len(sources) > 1
            for source_id, spoken in sources.items()
            if (map_id, source_id) not in self._idle
            and now_s - spoken.at_s >= self._idle_after_s
            and max(other.at_us for other in sources.values()) > spoken.at_us
        ]
        self._idle.update(found)
        return found
