"""The floor of the simulated office: where walls, doors and furniture are, and where the robot stands.

Everything is read from office.yaml, which is a map as anybody could write it. A leaf is a plane without
thickness in the middle of the wall, 2 cm narrower at either side than the gap in the wall; a post fills that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from typing import Any, Literal

import numpy as np
import shapely
import yaml
from numpy.typing import NDArray
from shapely import Polygon

from semap_ingest.sensing.image import Camera
from semap_ingest.simulation.furniture import Thing, furniture_surfaces
from semap_ingest.simulation.moment import Surfaces

HALLWAY = "Hallway"
WALL_M = 0.18
CEILING_M = 2.6
POST_M = 0.02
"""Between the leaf and the wall beside it."""

ROBOT = (10.0, 5.0, math.pi / 2)
"""map_T_base: x, y [m], yaw [rad]. The robot does not move."""

ROBOT_RADIUS_M = 0.3
BASE_FROM_LASER_M = (0.15, 0.0, 0.25)
BASE_FROM_CAMERA_M = (-0.1, 0.0, 1.2)
BASE_FROM_VELODYNE_M = (0.0, 0.0, 0.9)
"""Where the sensors are mounted on base_link, none of them turned (but for the camera's optical frame)."""

CAMERA = Camera(
    frame="camera_optical",
    width_px=640,
    height_px=480,
    matrix=np.array([[320.0, 0.0, 319.5], [0.0, 320.0, 239.5], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.04, 0.006, 0.0004, -0.0003, 0.0]),
)

WALL_COLOURS = {"Hallway": (226, 222, 210), "Room04": (214, 224, 216), "Room07": (212, 218, 228)}
OTHER_WALL_COLOUR = (230, 226, 216)
LEAF_COLOURS = ((150, 105, 62), (96, 118, 140), (168, 130, 84))
POST_COLOUR = (92, 92, 96)


@dataclass(frozen=True)
class Door:
    """A door or, without a hinge, an opening.

    In its own frame x runs along the width, the origin is the middle and y points into the room. A hinge on
    the left is at x = -width/2 (as IFC's SINGLE_SWING_LEFT), one on the right at x = +width/2.
    """

    name: str
    room: str
    position_m: tuple[float, float]
    yaw_rad: float
    width_m: float
    height_m: float
    hinge: Literal["left", "right"] | None
    max_rad: float

    def to_map(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) from the door's frame to the map's."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        placed: NDArray[np.float64] = points_m @ np.array([[cos, sin], [-sin, cos]]) + self.position_m
        return placed

    @property
    def is_watched(self) -> bool:
        """Whether the robot's camera has it in view."""
        ahead_m, left_m = _from_camera(self.position_m)
        return ahead_m > abs(left_m)

    @property
    def hinge_sign(self) -> int:
        """-1 where the hinge is on the left (negative x), 1 where it is on the right."""
        return 1 if self.hinge == "right" else -1

    def leaf_m(self, angle_rad: float) -> NDArray[np.float64]:
        """(2, 2) [m, map]: the hinge and the free edge of the leaf when it is open by that much."""
        hinge_x_m = self.hinge_sign * self.width_m / 2
        tip = [
            hinge_x_m - self.hinge_sign * self.width_m * math.cos(angle_rad),
            self.width_m * math.sin(angle_rad),
        ]
        return self.to_map(np.array([[hinge_x_m, 0.0], tip]))

    @cached_property
    def gap(self) -> Polygon:
        """The gap that it is in the wall [m, map]; reaches 1 mm into the room and into the hallway."""
        half_m = self.width_m / 2 + (POST_M if self.hinge else 0.0)
        deep_m = WALL_M / 2 + 0.001
        corners = [[-half_m, -deep_m], [half_m, -deep_m], [half_m, deep_m], [-half_m, deep_m]]
        return Polygon(self.to_map(np.array(corners)))


@dataclass(frozen=True, eq=False)
class Floor:
    """rooms  footprints [m, map] by name, the hallway among them"""

    rooms: Mapping[str, Polygon]
    doors: Mapping[str, Door]
    things: tuple[Thing, ...]

    @cached_property
    def free(self) -> Polygon:
        """Where there is no wall: rooms, hallway and the gaps between them [m, map]."""
        return shapely.union_all([*self.rooms.values(), *(door.gap for door in self.doors.values())])

    @cached_property
    def fixed(self) -> Surfaces:
        """All that never moves: walls, lintels, posts of doors, furniture."""
        return joined_surfaces(
            self._walls(),
            *(_lintel_and_posts(door) for door in self.doors.values()),
            *(furniture_surfaces(thing) for thing in self.things),
        )

    def leaves(self, door_rad: Mapping[str, float]) -> Surfaces:
        """The leaves of all doors, in the order of `leaf_doors`; one that is not named is closed."""
        doors = self.leaf_doors
        return Surfaces(
            np.array([door.leaf_m(door_rad.get(door.name, 0.0)) for door in doors]),
            np.array([[0.005, door.height_m] for door in doors]),
            np.array(
                [LEAF_COLOURS[index % len(LEAF_COLOURS)] for index in range(len(doors))], dtype=np.uint8
            ),
        )

    def surfaces(self, door_rad: Mapping[str, float]) -> Surfaces:
        """Everything upright: `fixed` and then `leaves`."""
        return joined_surfaces(self.fixed, self.leaves(door_rad))

    @cached_property
    def leaf_doors(self) -> tuple[Door, ...]:
        return tuple(door for door in self.doors.values() if door.hinge)

    @cached_property
    def laser_segments(self) -> NDArray[np.float64]:
        """(n, 2, 2) what the 2D laser sees of `fixed` [m, map]."""
        return self._at_height(BASE_FROM_LASER_M[2])

    @cached_property
    def sight_segments(self) -> NDArray[np.float64]:
        """(n, 2, 2) what of `fixed` stands between the camera and somebody's chest [m, map]."""
        return self._at_height(BASE_FROM_CAMERA_M[2])

    def _at_height(self, height_m: float) -> NDArray[np.float64]:
        low_m, high_m = self.fixed.z_m.T
        found: NDArray[np.float64] = self.fixed.segments_m[(low_m <= height_m) & (height_m <= high_m)]
        return found

    @cached_property
    def hallway(self) -> Polygon:
        return self.rooms[HALLWAY]

    def _walls(self) -> Surfaces:
        """The faces of the walls: the edge of what is free, each coloured as the room that it bounds."""
        rings = [self.free.exterior, *self.free.interiors]
        segments = np.concatenate(
            [np.stack([ring[:-1], ring[1:]], axis=1) for ring in (np.asarray(each.coords) for each in rings)]
        )
        segments = segments[np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > 0.002]
        middles = shapely.points(segments.mean(axis=1))
        names = list(self.rooms)
        nearest = np.argmin([shapely.distance(self.rooms[name], middles) for name in names], axis=0)
        colours = [WALL_COLOURS.get(names[index], OTHER_WALL_COLOUR) for index in nearest]
        return Surfaces(
            segments,
            np.tile([0.0, CEILING_M], (len(segments), 1)),
            np.array(colours, dtype=np.uint8),
        )


@cache
def office_floor() -> Floor:
    """The floor of office.yaml."""
    document = yaml.safe_load(office_map_text())
    return Floor(
        {name: Polygon(room["footprint"]) for name, room in document["rooms"].items()},
        {name: _door(name, entry) for name, entry in document["doors"].items()},
        tuple(_thing(name, entry) for name, entry in document["things"].items()),
    )


def office_map_text() -> str:
    """office.yaml."""
    return (files(__package__) / "office.yaml").read_text("utf-8")


def joined_surfaces(*parts: Surfaces) -> Surfaces:
    """All of them as one."""
    return Surfaces(
        np.concatenate([part.segments_m for part in parts]),
        np.concatenate([part.z_m for part in parts]),
        np.concatenate([part.colour for part in parts]),
    )


def laser_place_m() -> NDArray[np.float64]:
    """(2,) where the 2D laser is [m, map]."""
    x_m, y_m, yaw_rad = ROBOT
    ahead_m = BASE_FROM_LASER_M[0]
    return np.array([x_m + ahead_m * math.cos(yaw_rad), y_m + ahead_m * math.sin(yaw_rad)])


def _from_camera(point_m: tuple[float, float]) -> tuple[float, float]:
    """How far ahead of the camera a point lies, and how far to its left [m]."""
    x_m, y_m, yaw_rad = ROBOT
    east_m, north_m = point_m[0] - x_m, point_m[1] - y_m
    ahead_m = math.cos(yaw_rad) * east_m + math.sin(yaw_rad) * north_m - BASE_FROM_CAMERA_M[0]
    return ahead_m, -math.sin(yaw_rad) * east_m + math.cos(yaw_rad) * north_m


def _door(name: str, entry: Mapping[str, Any]) -> Door:
    leaf = entry.get("leaf")
    return Door(
        name,
        room=next(room for room in entry["between"] if room != HALLWAY),
        position_m=(float(entry["at"][0]), float(entry["at"][1])),
        yaw_rad=math.radians(entry["yaw_deg"]),
        width_m=float(entry["width_m"]),
        height_m=float(entry["height_m"]),
        hinge=leaf["hinge"] if leaf else None,
        max_rad=math.radians(leaf["max_deg"]) if leaf else 0.0,
    )


def _thing(name: str, entry: Mapping[str, Any]) -> Thing:
    length_m, width_m, height_m = entry["box"]
    x_m, y_m, _ = entry["at"]
    yaw_rad = math.radians(entry.get("yaw_deg", 0))
    return Thing(name, entry["concept"], (x_m, y_m), yaw_rad, (length_m, width_m, height_m))


def _lintel_and_posts(door: Door) -> Surfaces:
    half_m = door.width_m / 2 + (POST_M if door.hinge else 0.0)
    deep_m = WALL_M / 2
    lines = [[[-half_m, side], [half_m, side]] for side in (-deep_m, deep_m)]
    heights = [[door.height_m, CEILING_M]] * 2
    colours: list[tuple[int, int, int]] = [OTHER_WALL_COLOUR] * 2
    if door.hinge:
        lines += [[[side * door.width_m / 2, 0.0], [side * half_m, 0.0]] for side in (-1, 1)]
        lines.append([[-half_m, 0.0], [half_m, 0.0]])
        heights += [[0.0, door.height_m]] * 2 + [[door.height_m, CEILING_M]]
        colours += [POST_COLOUR] * 2 + [OTHER_WALL_COLOUR]
    ends = door.to_map(np.array(lines).reshape(-1, 2)).reshape(-1, 2, 2)
    return Surfaces(ends, np.array(heights), np.array(colours, dtype=np.uint8))
