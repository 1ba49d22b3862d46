"""Queries about pairs: the whole log, and what holds, equal plain Python's, whatever moves, ends or is edited."""

from __future__ import annotations

import random
from dataclasses import fields, replace
from datetime import timedelta
from uuid import NAMESPACE_URL, uuid4, uuid5

import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pair_oracle import Change, PairOracle, Question, Thing
from world import SECOND_US, World

from semap.timeline.stamp import to_datetime

AREAS = [
    shapely.box(0, 0, 4, 4),
    shapely.box(4, 0, 6, 4),
    shapely.box(1, 1, 3, 3),
    shapely.Polygon([(0, 0), (6, 0), (6, 2), (2, 2), (2, 6), (0, 6)]),
    shapely.Polygon([(2, -2), (6, 2), (2, 6), (-2, 2)]),
    shapely.Polygon(shapely.box(0, 0, 4, 4).exterior, [shapely.box(1, 1, 2, 3).exterior]),
    shapely.MultiPolygon([shapely.box(-1, -1, 0, 0), shapely.box(5, 5, 6.5, 6.5)]),
    shapely.box(2.25, 2.25, 2.26, 2.26),
]
LINES = [
    shapely.LineString([(0, 2), (4, 2)]),
    shapely.LineString([(0, 0), (2, 2), (4, 0), (6, 2)]),
    shapely.LineString([(-1, 3), (1, 3), (2, 4), (3, 3), (5, 3), (6, 1)]),
    *AREAS[:4],
    AREAS[5],
]
BANDS = [(float("-inf"), float("inf")), (0.0, 3.0), (3.0, 6.0), (1.0, 1.5)]
HEADINGS = [None, 0.0, 0.0, 0.75, -2.0, 3.0]
CHOSEN = '{"op": "=", "args": [{"property": "attributes.chosen"}, 1]}'

both = st.sampled_from(["track", "instance"])
margin = st.sampled_from([0.0, 0.0, 0.25])
confirm = st.sampled_from([0.0, 0.0, 0.5, 2.0])


@st.composite
def questions(draw: st.DrawFn) -> Question:
    predicate = draw(
        st.sampled_from(["contains", "covers", "intersects", "within_distance", "within_distance", "nearest",
                         "nearest", "on", "in_front_of", "left_of", "facing", "approaching", "approaching",
                         "crosses", "crosses", "crosses"])
    )  # fmt: skip
    kinds = draw(both), draw(both)
    if predicate == "crosses":
        kinds = "track", "instance"
    elif predicate == "on":
        kinds = "instance", "instance"
    elif kinds == ("track", "instance") and predicate not in (
        "intersects",
        "nearest",
        "facing",
        "approaching",
    ):
        kinds = "track", "track"
    elif predicate == "approaching" and kinds == ("instance", "instance"):
        kinds = "instance", "track"
    has_margins = predicate not in ("nearest", "on", "facing", "approaching", "crosses")
    distance = {"within_distance": 1.5, "approaching": 4.0, "in_front_of": 2.0, "left_of": 2.0}.get(predicate)
    if predicate in ("nearest", "facing"):
        distance = draw(st.sampled_from([None, 2.5]))
    return Question(
        predicate, *kinds, distance,
        count=draw(st.integers(1, 2)) if predicate == "nearest" else None,
        angle_rad=draw(st.sampled_from([0.3, 1.1])) if predicate == "facing" else None,
        speed_mps=0.7 if predicate == "approaching" else None,
        direction=draw(st.sampled_from([None, None, "left_to_right"])) if predicate == "crosses" else None,
        dimensions=draw(st.sampled_from([2, 3])),
        enter_margin_m=draw(margin) if has_margins else 0.0,
        leave_margin_m=draw(margin) if has_margins else 0.0,
        enter_confirm=draw(confirm) if predicate != "crosses" else 0.0,
        leave_confirm=draw(confirm) if predicate != "crosses" else 0.0,
        chosen_subjects=draw(st.booleans()), chosen_objects=draw(st.booleans()),
        abstraction=draw(st.sampled_from(["Footprint", "Line"])) if predicate == "crosses" else "Footprint",
    )  # fmt: skip


class Town:
    """A map with one query about pairs, driven in the database and told to the oracle."""

    def __init__(self, database: str, asked: Question, name: str | None = None) -> None:
        self.world = World(database, name or f"map {uuid4()}")
        self.oracle = PairOracle(asked)
        self.tracks: dict[str, int] = {}
        self.last: dict[str, Thing] = {}
        self.heard: dict[str, int] = {}
        self.sources = [self.world.source_id, self.world.add_source("other")]
        self.query_id: int | None = None
        self.ask(asked)
        self.world.run("update semap.source set jump_m = null where map_id = %s", self.world.map_id)

    def close(self) -> None:
        self.world.close()

    def uid(self, name: str):
        return uuid5(NAMESPACE_URL, f"{self.world.name}/{name}")

    def ask(self, asked: Question) -> None:
        values: dict[str, object] = {}
        for each in fields(asked):
            value = getattr(asked, each.name)
            if each.name.startswith("chosen"):
                column = "subject_where" if each.name == "chosen_subjects" else "object_where"
                values[column] = CHOSEN if value else None
            else:
                values[each.name] = timedelta(seconds=value) if each.name.endswith("confirm") else value
        if self.query_id is None:
            names = ", ".join(values)
            self.query_id = self.world.one(
                f"insert into semap.continuous_query (map_id, name, {names})"
                f" values (%s, 'pairs', {', '.join(['%s'] * len(values))}) returning query_id",
                self.world.map_id, *values.values(),
            )  # fmt: skip
        else:
            self.world.run(
                f"update semap.continuous_query set {', '.join(f'{name} = %s' for name in values)}"
                " where query_id = %s",
                *values.values(), self.query_id,
            )  # fmt: skip
            self.oracle.ask(asked)

    # what happens, in both

    def put(
        self, name: str, shape: shapely.Geometry, band: tuple[float, float] = BANDS[0],
        yaw_rad: float = 0.0, chosen: bool = True,
    ) -> None:  # fmt: skip
        """An instance is there, as this."""
        place = shapely.Point(*(round(value * 64) / 64 for value in shapely.centroid(shape).coords[0]))
        drawn = boundary_of(shape) if self.oracle.asked.abstraction == "Line" else shape
        low, high = (None if abs(z) == float("inf") else z for z in band)
        world, known = self.world, name in self.oracle.things
        if not known:
            turn = shapely.affinity.rotate(shapely.Point(1, 0), yaw_rad / 2, origin=(0, 0), use_radians=True)
            frame_id = world.one(
                "insert into semap.frame (map_id, name, parent_id) values (%s, %s, %s) returning frame_id",
                world.map_id, name, world.frame_id,
            )  # fmt: skip
            world.run(
                "insert into semap.frame_pose (frame_id, qz, qw) values (%s, %s, %s)",
                frame_id,
                turn.y,
                turn.x,
            )
            world.run(
                "insert into semap.instance (map_id, uid, name, concept_id, frame_id, attributes)"
                " select %s, %s, %s, concept_id, %s, jsonb_build_object('chosen', %s::integer)"
                " from semap.concept where name = 'Room'",
                world.map_id, self.uid(name), name, frame_id, int(chosen),
            )  # fmt: skip
            world.run(
                "insert into semap.abstraction (description_id, instance_id, type, geometry, z_min_m, z_max_m)"
                " select absolute_description_id, instance_id, t.type, t.geometry, %s, %s from semap.instance,"
                " (values (%s, %s::geometry), ('Position2D', %s)) t (type, geometry)"
                " where map_id = %s and name = %s",
                low, high, self.oracle.asked.abstraction, shapely.to_wkb(drawn, hex=True), shapely.to_wkb(place, hex=True),
                world.map_id, name,
            )  # fmt: skip
        else:
            world.run(
                "update semap.abstraction a set z_min_m = %s, z_max_m = %s,"
                " geometry = case when type = 'Position2D' then %s::geometry else %s end from semap.instance i"
                " where a.instance_id = i.instance_id and i.map_id = %s and i.name = %s",
                low, high, shapely.to_wkb(place, hex=True), shapely.to_wkb(drawn, hex=True), world.map_id, name,
            )  # fmt: skip
            yaw_rad, chosen = self.oracle.things[name].yaw_rad, self.oracle.things[name].chosen
        self.oracle.edit(
            name,
            Thing(name, self.uid(name), False, chosen, place.x, place.y, yaw_rad, shape=shape, band=band),
        )

    def remove(self, name: str) -> None:
        self.world.run("delete from semap.instance where map_id = %s and name = %s", self.world.map_id, name)
        self.oracle.edit(name, None)

    def choose(self, name: str, chosen: bool) -> None:
        """A track or an instance is described in another way."""
        table = "track" if name in self.tracks else "instance"
        self.world.run(
            f"update semap.{table} set attributes = jsonb_build_object('chosen', %s::integer)"
            " where map_id = %s and name = %s",
            int(chosen), self.world.map_id, name,
        )  # fmt: skip
        if table == "track":
            self.last[name] = replace(self.last[name], chosen=chosen)
        if name in self.oracle.things:
            self.oracle.edit(name, replace(self.oracle.things[name], chosen=chosen))

    def track(self, name: str, source: int = 0, chosen: bool = True) -> None:
        self.tracks[name] = self.world.one(
            "insert into semap.track (uid, source_id, map_id, name, attributes)"
            " values (%s, %s, %s, %s, jsonb_build_object('chosen', %s::integer)) returning track_id",
            self.uid(name), self.sources[source], self.world.map_id, name, int(chosen),
        )  # fmt: skip
        self.last[name] = Thing(name, self.uid(name), True, chosen)
        self.heard[name] = -1

    def see(self, *states: tuple[Thing, bool]) -> None:
        """States of tracks of one source, in one statement, in any order; the late ones change nothing."""
        statement = (
            "copy semap.track_state (track_id, stamp, x_m, y_m, z_m, heading_rad, length_m, width_m, is_last)"
            " from stdin"
        )
        with self.world.connection.cursor() as cursor, cursor.copy(statement) as copy:
            for thing, is_last in states:
                copy.write_row((self.tracks[thing.name], to_datetime(thing.stamp_us), thing.x_m, thing.y_m,
                                thing.z_m, thing.yaw_rad, thing.length_m, thing.width_m, is_last))  # fmt: skip
        told = [state for state in states if state[0].stamp_us > self.heard[state[0].name]]
        self.oracle.states(told)
        for thing, _ in told:
            self.heard[thing.name] = max(self.heard[thing.name], thing.stamp_us)
            if thing.stamp_us == self.heard[thing.name]:
                self.last[thing.name] = thing

    def end(self, name: str, stamp_us: int) -> None:
        self.world.end_track(self.tracks[name], stamp_us)
        self.oracle.end(name, stamp_us)
        self.heard[name] = max(stamp_us, self.heard[name])

    def forget(self, name: str) -> None:
        self.world.run("delete from semap.track where track_id = %s", self.tracks.pop(name))
        self.oracle.delete_track(name)

    # what came of it

    def log(self) -> list[Change]:
        return [
            Change(*row)
            for row in self.world.rows(
                "select kind::text, cause::text, coalesce(track_name, subject_instance_name),"
                " coalesce(instance_name, object_track_name), (extract(epoch from stamp) * 1000000)::bigint,"
                " (extract(epoch from edge_at) * 1000000)::bigint, (extract(epoch from since) * 1000000)::bigint,"
                " x_m, y_m, direction from semap.relation_change where query_id = %s order by change_id",
                self.query_id,
            )
        ]

    def held(self) -> set[tuple[str, str, int]]:
        return {
            (subject, object_, since)
            for subject, object_, since in self.world.rows(
                "select s.name, o.name, (extract(epoch from h.since) * 1000000)::bigint"
                " from semap.relation_held h"
                " join semap.pair_member s on s.key = coalesce(h.track_id, -h.subject_instance_id)"
                " and s.query_id = h.query_id and not s.is_object"
                " join semap.pair_member o on o.key = coalesce(h.object_track_id, -h.instance_id)"
                " and o.query_id = h.query_id and o.is_object where h.query_id = %s",
                self.query_id,
            )
        }

    def check(self) -> None:
        wanted, found = self.oracle.log, self.log()
        by_clock = "track" not in (self.oracle.asked.subject_kind, self.oracle.asked.object_kind)
        plain = [(each.kind, each.cause, each.subject, each.object, each.direction) for each in found]
        assert plain == [(e.kind, e.cause, e.subject, e.object, e.direction) for e in wanted]
        held = {(key, pair.since_us) for key, pair in self.oracle.pairs.items() if pair.held}
        assert {each[:2] for each in self.held()} == {key for key, _ in held}
        if by_clock:
            return
        assert [each.stamp_us for each in found] == [each.stamp_us for each in wanted]
        for name in ("edge_us", "since_us"):
            times = [getattr(each, name) for each in wanted]
            assert [getattr(each, name) for each in found] == pytest.approx(times, abs=2)
        places = [(each.x_m or 0, each.y_m or 0) for each in wanted]
        assert [each.x_m or 0 for each in found] == pytest.approx([x for x, _ in places], abs=1e-9)
        assert [each.y_m or 0 for each in found] == pytest.approx([y for _, y in places], abs=1e-9)
        assert self.held() == {(*key, round(since)) for key, since in held}


def boundary_of(shape: shapely.Geometry) -> shapely.Geometry:
    """The lines of an area with its inside on the left."""
    if shape.geom_type == "LineString":
        return shape
    return shapely.boundary(shapely.orient_polygons(shape))


NUMBERS = [0, 0, 0.25, 0.5, 1, 2]


def step(dice: random.Random, before: Thing, stamp_us: int) -> Thing:
    """Where somebody is next; numbers that are exact in binary, often on a grid that corners lie on."""
    if before.stamp_us is None or dice.random() < 0.1:
        x, y = dice.randint(0, 8) / 2, dice.randint(0, 8) / 2
    else:
        scale = dice.choice([0.5, 0.5, 1 / 1024])
        reach = dice.choice([0, 1, 2, 4]) if scale == 0.5 else 2048
        x, y = (
            min(max(value + dice.randint(-reach, reach) * scale, -0.5), 4.5)
            for value in (before.x_m, before.y_m)
        )
    return replace(
        before, stamp_us=stamp_us, x_m=x, y_m=y, z_m=dice.choice([None, None, 1.0, 1.25, 3.0]),
        yaw_rad=dice.choice(HEADINGS), length_m=dice.choice([None, 1.0, 3.0]),
        width_m=dice.choice([None, 0.5, 2.0]),
    )  # fmt: skip


def shape_of(dice: random.Random, asked: Question) -> dict:
    if asked.predicate == "crosses" and asked.abstraction == "Line":
        shape = dice.choice(LINES)
    else:
        shape = shapely.affinity.translate(
            dice.choice(AREAS), dice.randint(-2, 2) / 2, dice.randint(-2, 2) / 2
        )
    return {"shape": shape, "band": dice.choice(BANDS)}


def frames(dice: random.Random, town: Town, source: int, now_us: int) -> tuple[list[tuple[Thing, bool]], int]:
    """A statement of one source: some of its tracks at some stamps, in any order, some of them too late."""
    names = [name for name in town.tracks if (ord(name[-1]) % 2) == source]
    states = []
    last = dict(town.last)
    for _ in range(dice.choice([1, 1, 2, 4])):
        now_us += dice.choice([SECOND_US // 4, SECOND_US, 2 * SECOND_US, 40 * SECOND_US])
        for name in dice.sample(names, dice.randint(0, len(names))):
            last[name] = step(dice, last[name], now_us)
            states.append((last[name], dice.random() < 0.06))
    return dice.sample(states, len(states)), now_us


def play(town: Town, dice: random.Random, steps: int) -> None:
    now_us = [0, 0]
    for number in range(4):
        town.track("abcd"[number], ord("abcd"[number]) % 2, dice.random() < 0.9)
    for name in ("P", "Q", "R")[: dice.randint(1, 3)]:
        town.put(name, **shape_of(dice, town.oracle.asked), yaw_rad=dice.choice([0.0, 0.0, 0.3, -2.0]),
                 chosen=dice.random() < 0.9)  # fmt: skip
    for _ in range(steps):
        what = dice.random() if town.oracle.asked.enabled else 0.94
        if what < 0.65:
            source = dice.randint(0, 1)
            states, now_us[source] = frames(dice, town, source, now_us[source])
            if states:
                town.see(*states)
        elif what < 0.75:
            name = dice.choice("PQRS")
            if name in town.oracle.things and dice.random() < 0.3:
                town.remove(name)
            else:
                town.put(name, **shape_of(dice, town.oracle.asked), yaw_rad=dice.choice([0.0, 0.3, -2.0]))
        elif what < 0.82:
            name = dice.choice(sorted([*town.tracks, *(set("PQRS") & set(town.oracle.things))]))
            town.choose(name, dice.random() < 0.7)
        elif what < 0.88:
            name = dice.choice(sorted(town.tracks))
            now_us[ord(name[-1]) % 2] += SECOND_US
            town.end(name, now_us[ord(name[-1]) % 2])
        elif what < 0.9:
            name = dice.choice(sorted(town.tracks))
            town.forget(name)
            town.track(name + name[-1], ord(name[-1]) % 2)
        elif what < 0.95:
            town.ask(replace(town.oracle.asked, enabled=not town.oracle.asked.enabled))
        else:
            asked = town.oracle.asked
            town.ask(replace(
                asked, dimensions=5 - asked.dimensions, chosen_subjects=not asked.chosen_subjects,
                leave_confirm=0.0 if asked.predicate == "crosses" else dice.choice([0.0, 1.0]),
                distance_m=None if asked.distance_m is None else dice.choice([1.0, 3.0]),
            ))  # fmt: skip


QUICK = settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@QUICK
@given(asked=questions(), seed=st.integers(0, 2**32))
def test_pairs_equal_the_oracle(database: str, asked: Question, seed: int) -> None:
    check(database, asked, seed, 25)


@pytest.mark.slow
@settings(QUICK, max_examples=1500)
@given(asked=questions(), seed=st.integers(0, 2**32))
def test_pairs_equal_the_oracle_in_long_plays(database: str, asked: Question, seed: int) -> None:
    check(database, asked, seed, 60)


def check(database: str, asked: Question, seed: int, steps: int) -> None:
    town = Town(database, asked)
    try:
        play(town, random.Random(seed), steps)
        town.check()
    finally:
        town.close()


# What a reader learns from


def seen(town: Town, name: str, second: float, x: float, y: float, **more: float | None) -> None:
    town.see((replace(town.last[name], stamp_us=round(second * SECOND_US), x_m=x, y_m=y, **more), False))


def told(town: Town) -> list[tuple[str, str, str, str, float]]:
    return [(e.kind, e.cause, e.subject, e.object, e.stamp_us / SECOND_US) for e in town.log()]


@pytest.fixture
def town_of(database: str):
    made = []

    def make(asked: Question) -> Town:
        made.append(Town(database, asked, f"town {len(made)}"))
        return made[-1]

    yield make
    for each in made:
        each.check()
        each.close()


def test_two_persons_meet_and_part(town_of) -> None:
    """Each of the two is near the other, at the moment at which the second one is seen there."""
    town = town_of(Question("within_distance", distance_m=2.0))
    town.track("Ann", source=0)
    town.track("Bob", source=1)
    seen(town, "Ann", 1, 0, 0)
    seen(town, "Bob", 1.5, 5, 0)
    seen(town, "Ann", 2, 3, 0)
    assert town.held() == {("Ann", "Bob", 2 * SECOND_US), ("Bob", "Ann", 2 * SECOND_US)}
    seen(town, "Bob", 3, 6, 0)
    town.end("Bob", 4 * SECOND_US)
    assert told(town) == [
        ("began", "moved", "Ann", "Bob", 2), ("began", "moved", "Bob", "Ann", 2),
        ("ended", "moved", "Ann", "Bob", 3), ("ended", "moved", "Bob", "Ann", 3),
    ]  # fmt: skip
    past = "select track_name, object_track_name, until - since from semap.relation_past where query_id = %s"
    assert town.world.rows(past, town.query_id) == [
        ("Ann", "Bob", timedelta(seconds=1)), ("Bob", "Ann", timedelta(seconds=1)),
    ]  # fmt: skip


def test_a_cup_is_put_on_the_table_and_taken_away(town_of) -> None:
    town = town_of(Question("on", "instance", "instance"))
    town.put("table", shapely.box(0, 0, 2, 1), (0.0, 0.75))
    town.put("cup", shapely.box(4, 4, 4.1, 4.1), (0.75, 0.85))
    assert town.log() == []
    town.put("cup", shapely.box(1, 0.5, 1.1, 0.6), (0.75, 0.85))
    assert [(e.kind, e.cause, e.subject, e.object) for e in town.log()] == [("began", "map", "cup", "table")]
    town.remove("cup")
    assert [e.kind for e in town.log()] == ["began", "ended"]
    assert town.held() == set()


def test_a_robot_stands_in_front_of_a_dock_and_its_ground_in_a_zone(town_of) -> None:
    """An instance in front of a track, a track's ground in an area: what regions cannot ask."""
    town = town_of(Question("in_front_of", "instance", "track", 1.0))
    zone = town_of(Question("intersects", "track", "instance"))
    for each in (town, zone):
        each.track("robot")
    town.put("dock", shapely.box(2, -0.5, 3, 0.5))
    zone.put("dock", shapely.box(2, -0.5, 3, 0.5))
    for each in (town, zone):
        seen(each, "robot", 1, 0, 0, yaw_rad=0.0, length_m=1.0, width_m=1.0)
        seen(each, "robot", 2, 1, 0, yaw_rad=3.0)
        seen(each, "robot", 3, 1, 0, yaw_rad=0.0)
        seen(each, "robot", 4, 1.5, 0)
        seen(each, "robot", 5, 4, 0)
    assert told(town) == [("began", "moved", "dock", "robot", 3), ("ended", "moved", "dock", "robot", 5)]
    assert told(zone) == [("began", "moved", "robot", "dock", 4), ("ended", "moved", "robot", "dock", 5)]


def test_a_line_is_crossed_at_a_point_and_a_time(town_of) -> None:
    """The line leads east; who walks south crosses it from its left, the north, to its right."""
    town = town_of(Question("crosses", "track", "instance", abstraction="Line"))
    town.put("line", shapely.LineString([(0, 2), (4, 2)]))
    town.track("Ann")
    seen(town, "Ann", 1, 1, 3)
    seen(town, "Ann", 2, 2, 2)  # on the line: still north of it
    seen(town, "Ann", 3, 2, 3)
    assert told(town) == []
    seen(town, "Ann", 5, 3, 1)
    seen(town, "Ann", 6, 5, 3)  # around its end
    seen(town, "Ann", 7, 4, 2)
    seen(town, "Ann", 8, 3, 1)  # through its very end
    assert [(e.kind, e.direction, e.stamp_us, e.edge_us, e.x_m, e.y_m) for e in town.log()] == [
        ("crossed", "left_to_right", 5 * SECOND_US, 4 * SECOND_US, 2.5, 2.0)
    ]
    assert town.held() == set()


def test_who_approaches_is_told_from_who_is_near(town_of) -> None:
    town = town_of(Question("approaching", "track", "instance", 5.0, speed_mps=1.0))
    town.put("door", shapely.box(10, 0, 11, 1))
    town.track("Ann")
    for second, x in enumerate([3, 4, 6, 7, 8.5, 8.5, 9.25, 6], 1):
        seen(town, "Ann", second, x, 0.5)
    assert told(town) == [
        ("began", "moved", "Ann", "door", 4), ("ended", "moved", "Ann", "door", 6),
    ]  # fmt: skip


def test_the_nearest_changes_though_neither_side_moved(town_of) -> None:
    town = town_of(Question("nearest", count=1))
    for name in ("Ann", "Bob", "Cid"):
        town.track(name)
    seen(town, "Ann", 1, 0, 0)
    seen(town, "Bob", 2, 3, 0)
    seen(town, "Cid", 3, 1, 0)
    town.end("Cid", 9 * SECOND_US)
    assert [each for each in told(town) if each[2] == "Ann"] == [
        ("began", "appeared", "Ann", "Bob", 2), ("ended", "moved", "Ann", "Bob", 3),
        ("began", "appeared", "Ann", "Cid", 3), ("ended", "disappeared", "Ann", "Cid", 9),
        ("began", "moved", "Ann", "Bob", 9),
    ]  # fmt: skip


def test_a_query_begins_with_what_holds(town_of) -> None:
    """And one that asks something else goes on with what still holds."""
    town = town_of(Question("within_distance", distance_m=2.0, enabled=False))
    for name, x in {"Ann": 0.0, "Bob": 1.0, "Cid": 2.5}.items():
        town.track(name)
        seen(town, name, 1, x, 0)
    assert told(town) == []
    town.ask(replace(town.oracle.asked, enabled=True))
    assert {each[:4] for each in told(town)} == {
        ("began", "map", *pair) for pair in [("Ann", "Bob"), ("Bob", "Ann"), ("Bob", "Cid"), ("Cid", "Bob")]
    }
    before = len(told(town))
    town.world.run("update semap.continuous_query set name = 'close' where query_id = %s", town.query_id)
    assert len(told(town)) == before
    town.ask(replace(town.oracle.asked, distance_m=1.0))
    assert {each[:4] for each in told(town)[before:]} == {
        ("ended", "map", "Bob", "Cid"), ("ended", "map", "Cid", "Bob")
    }  # fmt: skip
    town.world.run("delete from semap.continuous_query where query_id = %s", town.query_id)
    assert town.held() == set()
    assert town.world.rows("select from semap.pair_member where query_id = %s", town.query_id) == []
    for each in ("Ann", "Bob"):
        other = "Bob" if each == "Ann" else "Ann"
        town.oracle.log.append(Change("ended", "map", each, other, SECOND_US, SECOND_US, SECOND_US))
    town.oracle.pairs.clear()


def test_an_outlier_moves_nobody(town_of) -> None:
    town = town_of(Question("within_distance", distance_m=2.0))
    town.world.run("update semap.source set jump_m = 15, jump_mps = 30 where map_id = %s", town.world.map_id)
    for name in ("Ann", "Bob"):
        town.track(name)
    seen(town, "Bob", 1, 0, 0)
    seen(town, "Ann", 1, 1, 0)
    before = told(town)
    town.world.add_states([(town.tracks["Ann"], 2 * SECOND_US, 300.0, 0.0, None)])
    assert told(town) == before
    seen(town, "Ann", 3, 1, 0.5)
    assert told(town) == before


def test_a_map_that_goes_takes_its_pairs_along(town_of) -> None:
    town = town_of(Question("within_distance", distance_m=2.0))
    for name in ("Ann", "Bob"):
        town.track(name)
        seen(town, name, 1, 0, 0)
    assert len(town.held()) == 2
    town.world.run("delete from semap.map where map_id = %s", town.world.map_id)
    for table in ("pair", "pair_member", "relation_change", "relation_past"):
        assert town.world.rows(f"select from semap.{table} where map_id = %s", town.world.map_id) == []
    town.oracle = PairOracle(town.oracle.asked)
