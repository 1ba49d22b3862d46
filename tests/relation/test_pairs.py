"""Queries about pairs: the whole log, and what holds, equal plain Python's, whatever moves, ends or is edited."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
import shapely
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st
from line_oracle import walked
from pair_oracle import Question, Thing
from pair_town import ANY_HEIGHT, Town, boundary_of
from world import SECOND_US, World

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
BANDS = [ANY_HEIGHT, (0.0, 3.0), (3.0, 6.0), (1.0, 1.5)]
HEADINGS = [None, 0.0, 0.0, 0.75, -2.0, 3.0]

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
        town.put(name, **shape_of(dice, town.oracle.asked), yaw_rad=dice.choice([0.0, 0.0, 0.4, -2.0]),
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
                town.put(name, **shape_of(dice, town.oracle.asked), yaw_rad=dice.choice([0.0, 0.4, -2.0]))
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
    note(f"{asked} {seed}")
    town = Town(database, asked)
    try:
        play(town, random.Random(seed), steps)
        town.check()
    finally:
        town.close()


def test_lines_are_crossed_on_the_sides_that_rational_numbers_say(world: World) -> None:
    """Walks between the points of a grid on which all corners lie: along edges, through corners, past ends."""
    dice, crossings = random.Random(7), 0
    for _ in range(150):
        line = dice.choice(LINES)
        lines, left = shapely.to_wkb(boundary_of(line), hex=True), None
        start = (float(dice.randint(-1, 6)), float(dice.randint(-1, 6)))
        for _ in range(8):
            end = (float(dice.randint(-1, 6)), float(dice.randint(-1, 6)))
            *wanted, (_, _, after) = walked(line, start, end, left)
            ((parts, sides, came),) = world.rows(
                "select coalesce(parts, '{}'), coalesce(from_left, '{}'), came_from_left"
                " from semap.way_across(%s, %s, %s, %s, %s, %s)",
                lines, *start, *end, left,
            )  # fmt: skip
            assert sides == [is_left for _, is_left, _ in wanted], (line, start, end, left)
            assert parts == pytest.approx([float(part) for part, _, _ in wanted])
            on_line = shapely.intersects(shapely.Point(end), boundary_of(line))
            assert not on_line or line.geom_type == "LineString" or came == after
            start, left, crossings = end, came, crossings + len(sides)
    assert crossings > 200
