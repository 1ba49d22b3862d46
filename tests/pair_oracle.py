"""What a continuous query about pairs means, in plain Python and shapely: all pairs, one moment after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import atan2, cos, hypot, pi, sin
from types import MappingProxyType
from uuid import UUID

import shapely
from line_oracle import walked
from shapely import affinity
from stateful_oracle import grown

US = 1_000_000
DIRECTIONS = ("in_front_of", "behind", "left_of", "right_of")
DAY_US = 86_400 * US


@dataclass(frozen=True)
class Thing:
    """A track (with a stamp) or an instance (with a shape); attributes are whether it is chosen."""

    name: str
    uid: UUID
    is_track: bool
    chosen: bool = True
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float | None = None
    # of a track
    stamp_us: int | None = None
    z_m: float | None = None
    length_m: float | None = None
    width_m: float | None = None
    # of an instance
    shape: shapely.Geometry | None = None
    band: tuple[float, float] = (float("-inf"), float("inf"))

    @property
    def place(self) -> shapely.Point:
        return shapely.Point(self.x_m, self.y_m)

    @property
    def where(self) -> shapely.Geometry:
        return self.place if self.is_track else self.shape

    @property
    def ground(self) -> shapely.Geometry:
        """An ellipse of sixteen corners; a circle where the heading is not known."""
        if not self.is_track:
            return self.shape
        sizes = [size for size in (self.length_m, self.width_m) if size is not None]
        if not sizes:
            return self.place
        length, width = (self.length_m or sizes[0], self.width_m or sizes[0])
        if self.yaw_rad is None:
            length = width = max(sizes)
        unit = shapely.Polygon([(cos(k * pi / 8), sin(k * pi / 8)) for k in range(16)])
        turned = affinity.rotate(
            affinity.scale(unit, length / 2, width / 2, origin=(0, 0)),
            self.yaw_rad or 0.0, origin=(0, 0), use_radians=True,
        )  # fmt: skip
        return affinity.translate(turned, self.x_m, self.y_m)


@dataclass(frozen=True)
class Question:
    """The columns of a query; times in seconds."""

    predicate: str
    subject_kind: str = "track"
    object_kind: str = "track"
    distance_m: float | None = None
    count: int | None = None
    angle_rad: float | None = None
    speed_mps: float | None = None
    direction: str | None = None
    abstraction: str = "Footprint"
    dimensions: int = 3
    enter_margin_m: float = 0.0
    leave_margin_m: float = 0.0
    enter_confirm: float = 0.0
    leave_confirm: float = 0.0
    chosen_subjects: bool = False
    chosen_objects: bool = False
    enabled: bool = True


@dataclass(frozen=True)
class Change:
    kind: str
    cause: str
    subject: str
    object: str
    stamp_us: int | None
    edge_us: float | None
    since_us: float | None
    x_m: float | None = None
    y_m: float | None = None
    direction: str | None = None


@dataclass
class Pair:
    held: bool = False
    since_us: float | None = None
    inside: bool = False
    inside_us: float | None = None
    distance_m: float | None = None
    distance_us: float | None = None


def overlap(low: float, high: float, other: tuple[float, float]) -> bool:
    return low <= other[1] and high >= other[0]


def heights(thing: Thing) -> tuple[float, float] | None:
    if not thing.is_track:
        return thing.band
    return None if thing.z_m is None else (thing.z_m, thing.z_m)


def at_height(asked: Question, s: Thing, o: Thing) -> bool:
    own, other = heights(s), heights(o)
    if asked.dimensions == 2 or own is None or other is None:
        return True
    by = asked.distance_m if asked.predicate == "within_distance" else 0.0
    if asked.predicate in ("contains", "covers") and not s.is_track and not o.is_track:
        return other[0] <= own[0] and own[1] <= other[1]
    if s.is_track and o.is_track:
        return asked.predicate != "intersects" or abs(own[0] - other[0]) <= 1
    if asked.predicate == "intersects" or (not s.is_track and not o.is_track):
        return overlap(own[0] - by, own[1] + by, other)
    if asked.predicate == "within_distance" and not s.is_track:
        return own[0] - by <= other[0] < own[1] + by
    if not s.is_track:
        return True
    return other[0] - by <= own[0] < other[1] + by


def beside(asked: Question, o: Thing) -> shapely.Geometry | None:
    """The area on a side of a thing; None of a track without heading or size."""
    if o.is_track and (o.yaw_rad is None or o.ground.area == 0):
        return None
    yaw, by = o.yaw_rad or 0.0, asked.distance_m
    x1, y1, x2, y2 = affinity.rotate(o.ground, -yaw, origin=(0, 0), use_radians=True).bounds
    box = {
        "in_front_of": (x2, y1, x2 + by, y2), "behind": (x1 - by, y1, x1, y2),
        "left_of": (x1, y2, x2, y2 + by), "right_of": (x1, y1 - by, x2, y1),
    }[asked.predicate]  # fmt: skip
    return affinity.rotate(shapely.box(*box), yaw, origin=(0, 0), use_radians=True)


def stands(asked: Question, s: Thing, o: Thing) -> tuple[bool, bool, bool]:
    """Whether it holds, deep enough to begin, far enough from it to end."""
    predicate = asked.predicate
    if predicate == "within_distance":
        distance = shapely.distance(s.where, o.where)
        if asked.dimensions == 3 and s.is_track and o.is_track and None not in (s.z_m, o.z_m):
            distance = hypot(distance, s.z_m - o.z_m)
        fits = at_height(asked, s, o) or (s.is_track and o.is_track)
        side = fits and distance <= asked.distance_m
        return (
            side,
            side and distance <= asked.distance_m - asked.enter_margin_m,
            not fits or distance > asked.distance_m + asked.leave_margin_m,
        )
    if predicate == "facing":
        near = asked.distance_m is None or shapely.distance(s.where, o.where) <= asked.distance_m
        dx, dy = o.x_m - s.x_m, o.y_m - s.y_m
        side = near and s.yaw_rad is not None and (dx, dy) != (0, 0)
        if side:
            turn = (atan2(dy, dx) - s.yaw_rad + pi) % (2 * pi) - pi
            side = abs(turn) <= asked.angle_rad
        return side, side, not side
    if predicate == "on":
        side = (
            shapely.area(shapely.intersection(s.shape, o.shape)) > 0
            and s.band[0] > float("-inf")
            and abs(s.band[0] - o.band[1]) <= 0.05
            and s.band[0] >= o.band[0] - 0.05
        )
        return side, side, not side
    if predicate in DIRECTIONS:
        area, what, test = beside(asked, o), s.where, shapely.intersects
    else:
        test: Callable[..., bool] = getattr(shapely, predicate)
        area, what = o.ground, s.ground if predicate == "intersects" else s.where
    if area is None:
        return False, False, True
    fits = at_height(asked, s, o)
    side = fits and bool(test(area, what))
    return (
        side,
        side and bool(test(grown(area, -asked.enter_margin_m), what)),
        not fits or (not side and not test(grown(area, asked.leave_margin_m), what)),
    )


@dataclass
class PairOracle:
    """One query; things are told in the order in which the database is."""

    asked: Question
    things: dict[str, Thing] = field(default_factory=dict)
    pairs: dict[tuple[str, str], Pair] = field(default_factory=dict)
    came_from: dict[tuple[str, str], bool] = field(default_factory=dict)
    log: list[Change] = field(default_factory=list)

    # who takes part

    def _takes_part(self, thing: Thing, is_object: bool) -> bool:
        kind = self.asked.object_kind if is_object else self.asked.subject_kind
        only = self.asked.chosen_objects if is_object else self.asked.chosen_subjects
        return self.asked.enabled and thing.is_track == (kind == "track") and (thing.chosen or not only)

    def _side(self, is_object: bool) -> list[Thing]:
        return [thing for thing in self.things.values() if self._takes_part(thing, is_object)]

    # what happens

    def states(self, batch: Iterable[tuple[Thing, bool]]) -> None:
        """Tracks at their stamps, with whether that is their last state; none of them late. Without a place: an end."""
        moments: dict[int, list[tuple[Thing, bool]]] = {}
        for thing, is_last in batch:
            moments.setdefault(thing.stamp_us, []).append((thing, is_last))
        for stamp_us in sorted(moments):
            ends = {thing.name for thing, is_last in moments[stamp_us] if is_last}
            new = [(thing, thing.name in ends) for thing, _ in moments[stamp_us] if thing.x_m is not None]
            found = []
            if self.asked.predicate == "crosses" and self.asked.enabled:
                for thing, _ in new:
                    if thing.name in self.things and self._takes_part(thing, False):
                        found += self._crossings(self.things[thing.name], thing)
            appeared = {thing.name for thing, _ in new if thing.name not in self.things}
            self.things.update({thing.name: thing for thing, _ in new})
            self._tell(found + self._compare({t.name for t, _ in new}, appeared, stamp_us, "moved"))
            ended = ends & self.things.keys()
            if ended:
                self._part(ended, stamp_us, "disappeared")

    def end(self, name: str, stamp_us: int) -> None:
        if name in self.things:
            self._part({name}, max(stamp_us, self.things[name].stamp_us), "disappeared")

    def delete_track(self, name: str) -> None:
        if name in self.things:
            self._part({name}, None, "map")
        self.log = [each for each in self.log if name not in (each.subject, each.object)]

    def edit(self, name: str, thing: Thing | None) -> None:
        """An instance is added, moved, chosen or (None) removed; a track is chosen or not."""
        before = self.things.get(name)
        was = [before is not None and self._takes_part(before, side) for side in (False, True)]
        if thing is None:
            self._part({name}, None, "map")
            return
        now = [self._takes_part(thing, side) for side in (False, True)]
        lost = [side for side in (False, True) if was[side] and not now[side]]
        if lost:
            self._part({name}, None, "map", lost, {name: thing})
        self.things[name] = thing
        placed = before is not None and replace(before, chosen=thing.chosen) == thing
        if any(now) and (
            not placed or self.asked.predicate == "on"
            or any(now[side] and not was[side] for side in (False, True))
        ):  # fmt: skip
            self._forget_line(name)
            self._tell(self._compare({name}, set(), None, "map"))

    def ask(self, asked: Question) -> None:
        """The query asks this from now on."""
        old = self.asked
        self.asked = replace(old, predicate=asked.predicate)  # parting is by who takes part
        before, after = PairOracle(old), PairOracle(asked)
        gone = [
            {thing.name for thing in self.things.values()
             if before._takes_part(thing, side) and not after._takes_part(thing, side)}
            for side in (False, True)
        ]  # fmt: skip
        self._end_pairs([key for key in self.pairs if key[0] in gone[0] or key[1] in gone[1]], None, "map")
        self.asked = asked
        self.came_from.clear()
        self._tell(self._compare(set(self.things), set(), None, "map"))

    # pairs

    def _at(self, s: Thing, o: Thing, at_us: int | None, pair: Pair) -> float:
        known = [s.stamp_us, o.stamp_us, at_us, pair.since_us, pair.inside_us, pair.distance_us]
        return max((each for each in known if each is not None), default=0)

    def _compare(self, moved: set[str], appeared: set[str], at_us: int | None, cause: str) -> list[Change]:
        subjects, objects = self._side(False), self._side(True)
        nearest: dict[str, set[str]] = {}
        concerned = moved
        if self.asked.predicate == "nearest":
            if any(o.name in moved for o in objects):
                concerned = {s.name for s in subjects} | moved
            nearest = {s.name: self._nearest(s, objects) for s in subjects}
        found = []
        for s in subjects:
            for o in objects:
                by_object = o.name in moved and self.asked.predicate != "nearest"
                if s.name == o.name or not (s.name in concerned or by_object):
                    continue
                is_new = s.name in appeared or o.name in appeared
                found += self._follow(s, o, at_us, cause, is_new, nearest)
        return found

    def _nearest(self, s: Thing, objects: list[Thing]) -> set[str]:
        ranked = sorted(
            (shapely.distance(s.where, o.where), o.uid, o.name) for o in objects if o.name != s.name
        )[: self.asked.count]
        return {
            name for distance, _, name in ranked
            if self.asked.distance_m is None or distance <= self.asked.distance_m
        }  # fmt: skip

    def _follow(
        self, s: Thing, o: Thing, at_us: int | None, cause: str, is_new: bool, nearest: dict[str, set[str]]
    ) -> list[Change]:
        asked, pair = self.asked, self.pairs.get((s.name, o.name), Pair())
        at = self._at(s, o, at_us, pair)
        fresh = is_new or cause == "map"
        near = False
        if asked.predicate == "nearest":
            side = enters = o.name in nearest[s.name]
            leaves = not side
        elif asked.predicate == "crosses":
            side, enters, leaves = False, False, True
        elif asked.predicate == "approaching":
            distance = float(shapely.distance(s.where, o.where))
            near = distance <= asked.distance_m
            side = near and not fresh and pair.inside
            if near and not fresh and pair.distance_us is not None and at > pair.distance_us:
                fell = pair.distance_m - distance
                side = fell >= asked.speed_mps * (at - pair.distance_us) / US
            enters, leaves = side, not side
            if near and (fresh or pair.distance_us is None or at > pair.distance_us):
                pair.distance_m, pair.distance_us = distance, at
        else:
            side, enters, leaves = stands(asked, s, o)
        inside = side if fresh else (not leaves if pair.inside else enters)
        if inside != pair.inside or fresh:
            pair.inside, pair.inside_us = inside, at
        found = []
        confirm = 0.0 if fresh else (asked.enter_confirm if inside else asked.leave_confirm)
        if inside != pair.held and at >= pair.inside_us + confirm * US:
            since = pair.inside_us if inside else min(pair.since_us, pair.inside_us)
            found = [Change("began" if inside else "ended", "appeared" if is_new and inside else cause,
                            s.name, o.name, at, pair.inside_us, since)]  # fmt: skip
            pair.held, pair.since_us = inside, pair.inside_us if inside else None
        if pair.held or pair.inside or near:
            self.pairs[s.name, o.name] = pair
        else:
            self.pairs.pop((s.name, o.name), None)
        return found

    def _part(
        self,
        names: set[str],
        at_us: int | None,
        cause: str,
        sides: Sequence[bool] = (False, True),
        stay: Mapping[str, Thing] = MappingProxyType({}),
    ) -> None:
        """They leave these sides, and stay as this; what is nearest without them is so then."""
        self._end_pairs(
            [key for key in self.pairs if any(key[side] in names for side in sides)], at_us, cause
        )
        for name in names:
            self._forget_line(name)
        left_objects = True in sides and any(
            self._takes_part(self.things[name], True) for name in names if name in self.things
        )
        for name in names:
            self.things.pop(name, None)
        self.things.update(stay)
        if left_objects and self.asked.predicate == "nearest":
            everybody = {thing.name for thing in self._side(False)}
            again = self._compare(everybody, set(), at_us, "map" if cause == "map" else "moved")
            self._tell(again)

    def _end_pairs(self, keys: list[tuple[str, str]], at_us: int | None, cause: str) -> None:
        found = []
        for key in keys:
            pair = self.pairs.pop(key)
            if pair.held:
                s, o = (self.things[name] for name in key)
                at = self._at(s, o, at_us, replace(pair, distance_us=None))
                found.append(Change("ended", cause, *key, at, at, pair.since_us))
        self._tell(found)

    def _tell(self, found: list[Change]) -> None:
        uid = {name: thing.uid for name, thing in self.things.items()}
        kinds = ("crossed", "ended", "began")
        self.log += sorted(
            found,
            key=lambda each: (
                each.stamp_us, each.edge_us, each.subject, uid[each.subject], each.cause == "disappeared",
                kinds.index(each.kind), each.object, uid[each.object],
            ),
        )  # fmt: skip

    def _forget_line(self, name: str) -> None:
        self.came_from = {key: left for key, left in self.came_from.items() if name not in key}

    # crossings

    def _crossings(self, start: Thing, end: Thing) -> list[Change]:
        found = []
        gap_us = end.stamp_us - start.stamp_us
        is_way = gap_us <= 30 * US and hypot(end.x_m - start.x_m, end.y_m - start.y_m) <= 30 * gap_us / US
        for line in self._side(True):
            key = (start.name, line.name)
            left = self.came_from.pop(key, None)
            if not is_way:
                continue
            walk = walked(line.shape, (start.x_m, start.y_m), (end.x_m, end.y_m), left)
            for part, is_left, remembered in walk:
                left = remembered
                if part is None:
                    continue
                way = "left_to_right" if is_left else "right_to_left"
                z = None if None in (start.z_m, end.z_m) else start.z_m + part * (end.z_m - start.z_m)
                fits = self.asked.dimensions == 2 or z is None or line.band[0] <= z < line.band[1]
                if fits and self.asked.direction in (None, way):
                    edge = start.stamp_us + float(part) * gap_us
                    found.append(
                        Change("crossed", "moved", *key, end.stamp_us, edge, edge,
                               start.x_m + float(part) * (end.x_m - start.x_m),
                               start.y_m + float(part) * (end.y_m - start.y_m), way)
                    )  # fmt: skip
            if left is not None:
                self.came_from[key] = left
        return found
