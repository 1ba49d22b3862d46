"""What continuous containment means, one state after the other, with shapely and plain Python."""

from __future__ import annotations

from dataclasses import dataclass, field

import shapely

Room = tuple[shapely.Geometry, tuple[float, float] | None]
Change = tuple[str, str, str, str, int]


@dataclass
class Oracle:
    rooms: dict[str, Room] = field(default_factory=dict)
    present: dict[str, tuple[int, float, float, float | None]] = field(default_factory=dict)
    heard: dict[str, int] = field(default_factory=dict)
    """The stamp up to which a track is known, by its states or by its end; what is not later is late."""
    ended: set[str] = field(default_factory=set)
    inside: dict[str, dict[str, int]] = field(default_factory=dict)
    changes: list[Change] = field(default_factory=list)

    def batch(self, states: list[tuple[str, int, float, float, float | None, bool]]) -> None:
        for track, stamp, x, y, z, is_last in sorted(states, key=lambda state: state[1]):
            if stamp <= self.heard.get(track, -1):
                continue
            self.heard[track] = stamp
            appears = track not in self.present or track in self.ended
            self.ended.discard(track)
            self.present[track] = (stamp, x, y, z)
            self._compare(track, stamp, "appeared" if appears else "moved")
            if is_last:
                self.end(track, stamp)

    def edit(self, name: str, room: Room | None) -> None:
        self.rooms.pop(name, None)
        if room is not None:
            self.rooms[name] = room
        for track, (stamp, *_) in self.present.items():
            if track not in self.ended:
                self._compare(track, stamp, "map")

    def end(self, track: str, stamp: int) -> None:
        self.heard[track] = stamp = max(stamp, self.heard.get(track, -1))
        if track not in self.present or track in self.ended:
            return
        self.present[track] = (stamp, *self.present[track][1:])
        self.ended.add(track)
        for room in self.inside.pop(track, {}):
            self.changes.append((track, room, "ended", "disappeared", stamp))

    def relations(self) -> set[tuple[str, str, int]]:
        return {(track, room, since) for track, rooms in self.inside.items() for room, since in rooms.items()}

    def _compare(self, track: str, stamp: int, cause: str) -> None:
        _, x, y, z = self.present[track]
        now = {name for name, room in self.rooms.items() if holds(room, x, y, z)}
        before = self.inside.setdefault(track, {})
        for name in set(before) - now:
            del before[name]
            self.changes.append((track, name, "ended", "moved" if cause == "appeared" else cause, stamp))
        for name in now - set(before):
            before[name] = stamp
            self.changes.append((track, name, "began", cause, stamp))


def holds(room: Room, x: float, y: float, z: float | None) -> bool:
    footprint, band = room
    if not shapely.contains(footprint, shapely.Point(x, y)):
        return False
    return z is None or band is None or band[0] <= z < band[1]
