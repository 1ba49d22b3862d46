"""The shortest way from room to room, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RouteStep:
    """A room, the door by which it is entered (None: the way begins there), and the way to that door [m]."""

    room_id: int
    room: str
    door_id: int | None
    door: str | None
    length_m: float


@dataclass(frozen=True)
class Part:
    """Rooms between which there are ways: how many, names of 20, and the storeys that they are on."""

    rooms: int
    names: tuple[str, ...]
    storeys: tuple[str, ...]

    def __str__(self) -> str:
        more = f" and {self.rooms - len(self.names)} more" if self.rooms > len(self.names) else ""
        on = f" (on {', '.join(self.storeys)})" if self.storeys else ""
        return f"{', '.join(self.names)}{more}{on}"


@dataclass(frozen=True)
class Gap:
    """The parts of a building in which a way would begin and end, and between which there is none."""

    start: Part
    end: Part

    @property
    def reason(self) -> str:
        """For people."""
        return (
            f"No door, opening, stair or lift of the map leads from {self.start} to {self.end}."
            " Let one join a room of each."
        )


@dataclass(frozen=True)
class Route:
    """From room to room; without steps where nothing leads from the one to the other, and then with the gap.

    line  x, y and (where it is known) z [m] of the positions that it leads through
    """

    steps: tuple[RouteStep, ...]
    length_m: float | None
    line: tuple[tuple[float, ...], ...]
    gap: Gap | None = None
