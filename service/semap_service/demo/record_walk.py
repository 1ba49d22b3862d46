"""Simulate the demo's walk: three people in the office, seen ten times a second.

Each person visits rooms in a given order and waits in each for a while. Where in the room, how long and how
fast is drawn from one seeded generator, so that the same file comes out every time. A way leads through the
doors between two rooms, across each at a right angle; corners are rounded (Chaikin 1974), and along the way
a person speeds up and slows down as reaching hands do (the minimum-jerk profile of Flash and Hogan 1985).

Run it to write `walk.csv` again:  python -m semap_service.demo.record_walk
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from math import atan2, ceil, cos, sin
from pathlib import Path
from random import Random

from shapely import LineString, Point

from semap.formats.geojson import read_geojson
from semap.model.building import Building, Item

FOLDER = Path(__file__).parent
SEED = 13
START = datetime(2026, 1, 5, 9, 0, 0, tzinfo=UTC)
LENGTH_S = 76.0
STEP_S = 0.1
CHEST_M = 1.2
STD_M = 0.05
WALL_CLEARANCE_M = 0.3
SEAT_CLEARANCE_M = 0.9
DOOR_APPROACH_M = 0.9
ENTRANCE = Point(7.0, 0.7)
CROSSING = Point(7.0, 5.0)
"""Where the two arms of the hallway meet."""


@dataclass(frozen=True)
class Person:
    """Who arrives when, and visits which rooms; a person who ends in the hallway leaves the building."""

    track: str
    starts_s: float
    visits: tuple[str, ...]


PEOPLE = (
    Person("ann", 0.0, ("office_1", "kitchen", "office_2", "office_1")),
    Person("bob", 14.0, ("hallway", "meeting_room", "lab", "office_2")),
    Person("eve", 0.0, ("lab", "kitchen", "meeting_room", "hallway")),
)


def record(office: Building, people: Sequence[Person] = PEOPLE, seed: int = SEED) -> str:
    """The walk as CSV: track, stamp (ISO 8601, UTC), x_m, y_m, z_m [map frame], std_m; ordered by stamp."""
    random = Random(seed)  # noqa: S311  # a simulation, nothing secret
    rows: list[tuple[int, str, Point]] = []
    for person in people:
        first = round(person.starts_s / STEP_S)
        last = ceil(LENGTH_S / STEP_S)
        for tick, position in enumerate(_positions(office, person.visits, random), start=first):
            rows.append((tick, person.track, position))
            if tick == last:
                break
    lines = ["track,stamp,x_m,y_m,z_m,std_m"]
    for tick, track, at in sorted(rows, key=lambda row: row[:2]):
        stamp = START + timedelta(seconds=tick * STEP_S)
        text = f"{stamp:%Y-%m-%dT%H:%M:%S}.{stamp.microsecond // 100_000}Z"
        lines.append(f"{track},{text},{at.x:.3f},{at.y:.3f},{CHEST_M},{STD_M}")
    return "\n".join(lines) + "\n"


def _positions(office: Building, visits: Sequence[str], random: Random) -> Iterator[Point]:
    """Where the person is at each step: waiting, walking, waiting; without end in the last room."""
    rooms = {item.name: item for item in office.items if item.concept == "Room"}
    here = _seat(rooms[visits[0]], random)
    for visit, following in pairwise(visits):
        yield from [here] * round(random.uniform(3.0, 6.0) / STEP_S)
        there = _seat(rooms[following], random)
        yield from _walk(_way(office, here, there, visit, following), random.uniform(1.2, 1.4))
        here = there
    while visits[-1] != "hallway":
        yield here


def _seat(room: Item, random: Random) -> Point:
    """Where a person waits in a room; in the hallway, at the entrance."""
    if room.name == "hallway" or room.footprint is None:
        return ENTRANCE
    west, south, east, north = room.footprint.buffer(-SEAT_CLEARANCE_M).bounds
    return Point(random.uniform(west, east), random.uniform(south, north))


def _way(office: Building, here: Point, there: Point, room: str, target: str) -> LineString:
    """A line from seat to seat through the doors between; all rooms but the hallway are convex."""
    stations = [here]
    for door, left in _doors(office, room, target):
        stations.extend(_through(door, left))
    stations.append(there)
    hallway = next(item.footprint for item in office.items if item.name == "hallway")
    corner = hallway.buffer(-WALL_CLEARANCE_M) if hallway is not None else Point()
    turned = [stations[0]]
    for start, end in pairwise(stations):
        if corner.contains(start) and corner.contains(end) and not corner.contains(LineString([start, end])):
            turned.append(CROSSING)
        turned.append(end)
    return _rounded(LineString(turned))


def _doors(office: Building, room: str, target: str) -> list[tuple[Item, Item]]:
    """The doors to pass from one room to another, each with the room that it leads out of."""
    items = {item.name: item for item in office.items}
    for stops in ((room, target), (room, "hallway", target)):
        ways = [
            next((item for item in office.items if set(item.joins) == {start, end}), None)
            for start, end in pairwise(stops)
        ]
        passed = [way for way in ways if way is not None]
        if len(passed) == len(ways):
            return [(door, items[left]) for door, left in zip(passed, stops, strict=False)]
    raise ValueError(f"no way from {room} to {target}")


def _through(door: Item, left: Item) -> tuple[Point, Point]:
    """A point in front of the door and one behind it, seen from the room that is left."""
    yaw_rad = 2 * atan2(door.pose.qz, door.pose.qw)
    dx_m, dy_m = -sin(yaw_rad) * DOOR_APPROACH_M, cos(yaw_rad) * DOOR_APPROACH_M
    sides = [Point(door.pose.x_m + s * dx_m, door.pose.y_m + s * dy_m) for s in (1, -1)]
    before = next(side for side in sides if left.footprint is not None and left.footprint.contains(side))
    return before, next(side for side in sides if side is not before)


def _rounded(way: LineString) -> LineString:
    """Cut every corner four times, at a quarter of both its edges."""
    points = [Point(point) for point in way.coords]
    for _ in range(4):
        cut = [points[0]]
        for start, end in pairwise(points):
            edge = LineString([start, end])
            cut += [edge.interpolate(0.25, normalized=True), edge.interpolate(0.75, normalized=True)]
        points = [*cut, points[-1]]
    return LineString(points)


def _walk(way: LineString, top_speed_mps: float) -> Iterator[Point]:
    """Positions along a way, step by step, at rest at both ends."""
    # The profile's greatest speed is 15/8 of its mean.
    steps = ceil(way.length * 15 / 8 / top_speed_mps / STEP_S)
    for step in range(1, steps + 1):
        t = step / steps
        yield way.interpolate(t**3 * (10 - 15 * t + 6 * t**2), normalized=True)


def main() -> None:
    """Write `walk.csv` next to this file."""
    (FOLDER / "walk.csv").write_text(record(read_geojson(FOLDER / "office.geojson")), newline="\n")


if __name__ == "__main__":
    main()
