"""What a careful continuous query means for one track and one region, in plain Python and shapely.

Every predicate, margins, times to confirm, probabilities, ways between samples: sample after sample, with no memory of
where nothing can happen.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import acos, ceil, hypot, pi
from statistics import NormalDist

import shapely
from shapely import affinity

US = 1_000_000


@dataclass(frozen=True)
class Asked:
    """A query's parameters, by the names of their columns; times in seconds."""

    predicate: str = "contains"
    distance_m: float | None = None
    enter_margin_m: float = 0.0
    leave_margin_m: float = 0.0
    enter_confirm: float = 0.0
    leave_confirm: float = 0.0
    enter_probability: float | None = None
    leave_probability: float | None = None
    widest_std_m: float | None = None
    longest_gap: float | None = None
    fastest_mps: float | None = None


@dataclass(frozen=True)
class Sample:
    stamp_us: int
    x_m: float
    y_m: float
    z_m: float | None
    std_m: float | None = None
    is_last: bool = False
    std_across_m: float | None = None
    std_yaw_rad: float | None = None


@dataclass(frozen=True)
class Found:
    kind: str
    cause: str
    stamp_us: int
    edge_us: float


def grown(shape: shapely.Geometry, by_m: float) -> shapely.Geometry:
    """Round at its corners to half a millimetre."""
    if by_m == 0:
        return shape
    return shapely.buffer(
        shape, by_m, quad_segs=max(8, ceil(pi / 4 / acos(1 - 0.0005 / max(abs(by_m), 0.001))))
    )


def deviations(boundary: shapely.Geometry, point: shapely.Point, known: Sample) -> float:
    """How many standard deviations of its error a point is from a boundary; endless without an error."""
    if not known.std_m:
        return float("inf")
    if known.std_across_m is None:
        return shapely.distance(boundary, point) / known.std_m
    across_m = max(known.std_across_m, known.std_m / 1000)
    turned = affinity.rotate(boundary, -known.std_yaw_rad, origin=point, use_radians=True)
    scaled = affinity.scale(turned, 1 / known.std_m, 1 / across_m, origin=point)
    return shapely.distance(scaled, point)


@dataclass
class Follower:
    """One track and one region; `inside`, `held`, `side` as in the documentation."""

    shape: shapely.Geometry
    band: tuple[float, float] | None
    asked: Asked
    held: bool = False
    inside: bool = False
    inside_us: float = 0.0
    side: bool = False
    side_us: float | None = None
    last: Sample | None = None
    found: list[Found] = field(default_factory=list)

    def take(self, sample: Sample) -> None:
        if self.last is None:
            self.side = self.inside = self.held = self._side(sample.x_m, sample.y_m, sample.z_m)
            self.side_us = None
            if self.held:
                self.found.append(Found("began", "appeared", sample.stamp_us, sample.stamp_us))
        else:
            self._go(self.last, sample)
        self.last = sample
        if sample.is_last:
            if self.held:
                self.found.append(Found("ended", "disappeared", sample.stamp_us, sample.stamp_us))
            self.held = self.inside = self.side = False
            self.last = None

    def _go(self, start: Sample, end: Sample) -> None:
        cuts = self._cuts(start, end)
        if cuts:
            ends = sorted({0.0, *cuts, 1.0})
            for a, b in pairwise(ends):
                at_us = start.stamp_us + a * (end.stamp_us - start.stamp_us)
                self._settle(at_us, end.stamp_us)
                self._tread(at_us, _between(start, end, (a + b) / 2), end)
            self._settle(end.stamp_us, end.stamp_us)
        self._tread(end.stamp_us, end, end)

    def _tread(self, at_us: float, place: Sample, known: Sample) -> None:
        side = self._side(place.x_m, place.y_m, place.z_m)
        if side != self.side:
            self.side, self.side_us = side, at_us
        decided = self._decided(side, place, known)
        if decided is not None and decided != self.inside:
            self.inside, self.inside_us = decided, at_us
        self._settle(at_us, known.stamp_us)

    def _settle(self, at_us: float, known_us: int) -> None:
        confirm = self.asked.enter_confirm if self.inside else self.asked.leave_confirm
        if self.inside != self.held and at_us >= self.inside_us + confirm * US:
            self.held = self.inside
            edge_us = self.inside_us
            if self.side == self.held and self.side_us is not None:
                edge_us = self.side_us
            self.found.append(Found("began" if self.held else "ended", "moved", known_us, edge_us))

    def _at_height(self, z: float | None) -> bool:
        low, high = self._band()
        return z is None or low <= z < high

    def _band(self) -> tuple[float, float]:
        if self.band is None:
            return float("-inf"), float("inf")
        low, high = self.band
        if self.asked.predicate == "on":
            return high - 0.1, high + 0.5
        by = self.asked.distance_m or 0.0
        return low - by, high + by

    def _side(self, x: float, y: float, z: float | None) -> bool:
        point = shapely.Point(x, y)
        if not self._at_height(z):
            return False
        if self.asked.predicate == "covers":
            return shapely.covers(self.shape, point)
        if self.asked.predicate == "within_distance":
            return shapely.dwithin(self.shape, point, self.asked.distance_m)
        return shapely.contains(self.shape, point)

    def _decided(self, side: bool, place: Sample, known: Sample) -> bool | None:
        asked, point = self.asked, shapely.Point(place.x_m, place.y_m)
        by_m = asked.distance_m or 0.0
        at_height = self._at_height(place.z_m)
        enters, leaves = side, not side
        if asked.enter_margin_m:
            enters = enters and shapely.contains(grown(self.shape, by_m - asked.enter_margin_m), point)
        if asked.leave_margin_m and at_height:
            leaves = leaves and not shapely.contains(grown(self.shape, by_m + asked.leave_margin_m), point)
        if asked.enter_probability is not None and at_height:
            if (known.std_m or 0.0) > asked.widest_std_m:
                return None
            depth = deviations(shapely.boundary(grown(self.shape, by_m)), point, known)
            enters = enters and depth >= NormalDist().inv_cdf(asked.enter_probability)
            leaves = leaves and depth >= -NormalDist().inv_cdf(asked.leave_probability)
        return True if enters else False if leaves else None

    def _cuts(self, start: Sample, end: Sample) -> set[float]:
        """Parts of the way at which it meets a boundary or an end of the band."""
        asked = self.asked
        gap_s = (end.stamp_us - start.stamp_us) / US
        length_m = hypot(end.x_m - start.x_m, end.y_m - start.y_m)
        if asked.longest_gap is None or gap_s > asked.longest_gap or length_m > asked.fastest_mps * gap_s:
            return set()
        cuts: set[float] = set()
        if length_m > 0:
            way = shapely.LineString([(start.x_m, start.y_m), (end.x_m, end.y_m)])
            by_m = asked.distance_m or 0.0
            shapes = [grown(self.shape, by_m)]
            if asked.enter_margin_m:
                shapes.append(grown(self.shape, by_m - asked.enter_margin_m))
            if asked.leave_margin_m:
                shapes.append(grown(self.shape, by_m + asked.leave_margin_m))
            for shape in shapes:
                met = shapely.intersection(shapely.boundary(shape), way)
                cuts |= {
                    hypot(x - start.x_m, y - start.y_m) / length_m for x, y in shapely.get_coordinates(met)
                }
        if start.z_m is not None and end.z_m is not None and start.z_m != end.z_m:
            parts = {(z - start.z_m) / (end.z_m - start.z_m) for z in self._band()}
            cuts |= {part for part in parts if 0 <= part <= 1}
        return cuts


def _between(start: Sample, end: Sample, part: float) -> Sample:
    z = None if start.z_m is None or end.z_m is None else start.z_m + part * (end.z_m - start.z_m)
    return Sample(
        0, start.x_m + part * (end.x_m - start.x_m), start.y_m + part * (end.y_m - start.y_m), z, end.std_m
    )
