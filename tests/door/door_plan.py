"""Doors on a map, lines that a laser sees of their leaves, and what should follow, in plain Python and shapely."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import shapely
from world import World

from semap.timeline.stamp import to_datetime

Line = tuple[int, tuple[float, float], tuple[float, float], float | None, float, float]
"""Stamp [us], two ends [m], height [m], standard deviations of angle [rad] and offset [m]."""

SCAN_US = 66_667


@dataclass(frozen=True)
class Door:
    """A door in the map frame; x, y is the middle of the doorway, and the leaf opens to the left of `yaw_rad`."""

    name: str
    x_m: float
    y_m: float
    yaw_rad: float = 0.0
    hinge: str = "left"
    width_m: float = 0.9
    max_deg: float = 100.0
    z_m: float = 0.0

    @property
    def sense(self) -> int:
        return 1 if self.hinge == "left" else -1

    @property
    def hinge_m(self) -> tuple[float, float]:
        half = self.sense * self.width_m / 2
        return self.x_m - half * math.cos(self.yaw_rad), self.y_m - half * math.sin(self.yaw_rad)

    @property
    def closed_rad(self) -> float:
        return self.yaw_rad + (0.0 if self.sense == 1 else math.pi)

    def leaf(self, angle_rad: float, near_m: float = 0.02, far_m: float | None = None, aside_m: float = 0.0):
        """The two ends of what is seen of the leaf, from `near_m` to `far_m` off the hinge, `aside_m` off its axis."""
        direction = self.closed_rad + self.sense * angle_rad
        along, across = (
            (math.cos(direction), math.sin(direction)),
            (-math.sin(direction), math.cos(direction)),
        )
        x, y = self.hinge_m
        return tuple(
            (x + at * along[0] + aside_m * across[0], y + at * along[1] + aside_m * across[1])
            for at in (near_m, self.width_m if far_m is None else far_m)
        )

    def seen(self, stamp_us: int, angle_rad: float, std_rad: float = 0.01, **what) -> Line:
        z_m = what.pop("z_m", None)
        near, far = self.leaf(angle_rad, **what)
        return stamp_us, near, far, z_m, std_rad, 0.005

    def range_of_motion(self, margin_m: float = 0.12) -> shapely.Polygon:
        steps = [math.radians(-5 + (self.max_deg + 15) * n / 200) for n in range(201)]
        arc = [self.leaf(angle)[1] for angle in steps]
        return shapely.Polygon([self.hinge_m, *arc]).buffer(margin_m, quad_segs=32)


@dataclass
class DoorPlan:
    """The doors of a world; also writes lines and reads states."""

    world: World
    ids: dict[str, int] = field(default_factory=dict)

    def add(self, door: Door, **leaf: object) -> Door:
        frame_id = self.world.one(
            "insert into semap.frame (map_id, name, parent_id) values (%s, %s, %s) returning frame_id",
            self.world.map_id, door.name, self.world.frame_id,
        )  # fmt: skip
        self.world.run(
            "insert into semap.frame_pose (frame_id, x_m, y_m, z_m, qz, qw) values (%s, %s, %s, %s, %s, %s)",
            frame_id, door.x_m, door.y_m, door.z_m, math.sin(door.yaw_rad / 2), math.cos(door.yaw_rad / 2),
        )  # fmt: skip
        attributes = {"width_m": door.width_m, "leaf": {"hinge": door.hinge, "max_deg": door.max_deg, **leaf}}
        self.ids[door.name] = self.world.one(
            "insert into semap.instance (map_id, name, concept_id, frame_id, attributes)"
            " select %s, %s, concept_id, %s, %s from semap.concept where name = 'Door' returning instance_id",
            self.world.map_id, door.name, frame_id, json.dumps(attributes),
        )  # fmt: skip
        return door

    def set_attributes(self, name: str, attributes: object) -> None:
        self.world.run(
            "update semap.instance set attributes = %s where instance_id = %s",
            json.dumps(attributes), self.ids[name],
        )  # fmt: skip

    def observe(self, lines: Iterable[Line], source_id: int | None = None) -> None:
        """Rows in one statement."""
        rows = list(lines)
        self.world.run(
            "insert into semap.line_observation"
            " (source_id, stamp, x1_m, y1_m, x2_m, y2_m, z_m, angle_std_rad, offset_std_m, points)"
            " select %s, l.*, 20 from unnest(%s::timestamptz[], %s::float8[], %s::float8[], %s::float8[],"
            " %s::float8[], %s::float8[], %s::float4[], %s::float4[]) l",
            source_id or self.world.source_id,
            [to_datetime(row[0]) for row in rows],
            *([float(row[end][axis]) for row in rows] for end in (1, 2) for axis in (0, 1)),
            [row[3] for row in rows], [row[4] for row in rows], [row[5] for row in rows],
        )  # fmt: skip

    def states(self) -> list[tuple[str, str, int]]:
        """Door, state and stamp [us], in the order in which they were written."""
        return [
            (name, value, int(stamp_us))
            for name, value, stamp_us in self.world.rows(
                "select instance_name, value, extract(epoch from stamp) * 1000000 from semap.object_state"
                " where map_id = %s and property = 'door' order by object_state_id",
                self.world.map_id,
            )
        ]

    def present(self, name: str) -> tuple[str | None, float | None]:
        """State and angle [rad]."""
        ((state, angle_rad),) = self.world.rows(
            "select state, angle_rad from semap.door_now where instance_id = %s", self.ids[name]
        )
        return state, angle_rad

    def late(self) -> int:
        return self.world.one(
            "select sum(late_states)::int from semap.source where map_id = %s", self.world.map_id
        )


@dataclass
class LeafOracle:
    """The state machine of one leaf, one angle after the other [deg]; told in the words of sql/162."""

    opening_above: float = 10
    open_from: float = 70
    turns_by: float = 8
    closed_below: float = 6
    rests_within: float = 3
    rests_for_us: int = 400_000
    state: str | None = None
    history: list[tuple[int, float]] = field(default_factory=list)
    largest: float = 0.0
    smallest: float = 0.0
    anchor: tuple[int, float] = (0, 0.0)
    wished: str | None = None
    changes: list[tuple[int, str]] = field(default_factory=list)

    def see(self, stamp_us: int, angle: float, std: float) -> None:
        if self.history and stamp_us <= self.history[-1][0]:
            return
        if self.state is None:
            self._become("open" if angle > self.opening_above else "closed", stamp_us, angle)
            self.anchor = (stamp_us, angle)
        else:
            self._follow(stamp_us, angle, std)
        self.history.append((stamp_us, angle))

    def _follow(self, stamp_us: int, angle: float, std: float) -> None:
        before_us, before = self.history[-1]
        self.largest = max(self.largest, min(angle, before))
        self.smallest = min(self.smallest, max(angle, before))
        if abs(angle - self.anchor[1]) > max(self.rests_within, 3 * std):
            self.anchor = (stamp_us, angle)
        wish, beyond = self._wish(angle)
        wish = wish if beyond > std else None
        soon = stamp_us - before_us <= 150_000
        reachable = soon and abs(angle - before) <= 200 * (stamp_us - before_us) / 1e6 + std
        sure = wish is not None and reachable and beyond > 3 * std
        repeated = wish is not None and wish == self.wished
        self.wished = wish
        if sure or repeated:
            self._become(wish, stamp_us, angle)
        elif self.state in ("opening", "closing") and stamp_us - self.anchor[0] >= self.rests_for_us:
            if angle > self.opening_above:
                self._become("open", stamp_us, angle)
            elif angle < self.closed_below and self.state == "closing":
                self._become("closed", stamp_us, angle)

    def _wish(self, angle: float) -> tuple[str | None, float]:
        wishes: Sequence[tuple[str, float]] = {
            "closed": [("opening", angle - self.opening_above)],
            "opening": [
                ("closing", max(self.largest - self.turns_by, self.closed_below) - angle),
                ("open", angle - self.open_from),
            ],
            "open": [("closing", max(self.largest - self.turns_by, self.closed_below) - angle)],
            "closing": [
                ("closed", self.closed_below - angle),
                ("opening", angle - self.smallest - self.turns_by),
            ],
        }[self.state]
        return next(((state, beyond) for state, beyond in wishes if beyond > 0), (None, 0.0))

    def _become(self, state: str, stamp_us: int, angle: float) -> None:
        if not (self.state == "opening" and state == "open"):
            self.largest = self.smallest = angle
        self.state, self.wished = state, None
        self.changes.append((stamp_us, state))
