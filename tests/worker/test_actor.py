"""The likeliest actor against normal densities of scipy, and candidates against plain geometry."""

from __future__ import annotations

import random

import numpy as np
import pytest
import shapely
from door_scene import DOOR, DoorScene, us
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm
from world import World

from semap.intake.actor import Candidate, likeliest
from semap.intake.enrichment import enriched
from semap.rules.needs import Needs
from semap.rules.row import Row
from semap.store.database.connection import connect

NEEDS = Needs({"door": 1.5}, frozenset({"track_in_room", "door"}), frozenset({"door"}))


@given(
    st.lists(st.tuples(st.floats(0, 2), st.one_of(st.none(), st.floats(0.05, 1))), max_size=6),
    st.floats(0.5, 1.5),
)
def test_likelihoods_are_normal_densities(near: list[tuple[float, float | None]], within_m: float) -> None:
    candidates = [
        Candidate(number, f"t{number}", distance_m, std_m) for number, (distance_m, std_m) in enumerate(near)
    ]
    actor = likeliest(candidates, within_m)
    densities = {
        each.track_id: norm.pdf(each.distance_m, scale=np.hypot(within_m / 2, each.std_m or 0.3))
        for each in candidates
        if each.distance_m <= within_m
    }
    if not densities:
        assert actor is None
        return
    assert actor is not None
    total = sum(densities.values()) + norm.pdf(within_m, scale=within_m / 2)
    assert densities[actor.candidate.track_id] == pytest.approx(max(densities.values()))
    assert actor.likelihood == pytest.approx(max(densities.values()) / total)


def test_far_away_nobody_is_as_likely_as_somebody() -> None:
    actor = likeliest([Candidate(1, "ann", 80.0, None)], 80.0)
    assert actor is not None
    assert actor.likelihood == pytest.approx(0.5, abs=1e-4)


def test_actors_and_shapes_are_looked_up_as_plain_geometry_says(world: World) -> None:
    """Random walks, some of which end; where each was by its last two states of two seconds."""
    scene = DoorScene(world)
    dice = random.Random(5)
    ways: dict[str, list[tuple[float, float, float]]] = {}
    for number in range(12):
        at_s, x, y, way = 100 + dice.random(), dice.uniform(2, 6), dice.uniform(0, 4), []
        while at_s < 120:
            way.append((at_s, x, y))
            at_s += dice.choice((0.2, 0.7, 2.5))
            x, y = x + dice.uniform(-0.5, 0.5), y + dice.uniform(-0.5, 0.5)
        ways[f"p{number}"] = way
        scene.walk(f"p{number}", way)
    asked_s = [101 + 0.37 * number for number in range(50)]
    rows = [
        Row(us(at_s), 1, str(number), "object_state", {"input": "door", "type": "open", "instance_id": scene.door_id})
        for number, at_s in enumerate(asked_s)
    ]  # fmt: skip
    with connect(world.dsn) as connection:
        found = enriched(connection, world.map_id, rows, NEEDS)
    for at_s, row in zip(asked_s, found, strict=True):
        candidates = []
        for name, way in ways.items():
            recent = [state for state in way if at_s - 2 < state[0] <= at_s][-2:]
            if not recent:
                continue
            (t1, x, y), (t0, x0, y0) = recent[-1], recent[0]
            ahead = (at_s - t1) / (t1 - t0) if t1 > t0 else 0.0
            point = shapely.Point(x + (x - x0) * ahead, y + (y - y0) * ahead)
            candidates.append(Candidate(scene.tracks[name], name, DOOR.distance(point), None))
        actor = likeliest(candidates, 1.5)
        assert row.values.get("actor") == (None if actor is None else actor.candidate.name)
        if actor is not None:
            assert row.values["actor_likelihood"] == pytest.approx(actor.likelihood, abs=1e-6)
            assert row.values["actor_distance_m"] == pytest.approx(actor.candidate.distance_m, abs=1e-6)
        assert shapely.equals(row.values["footprint"], DOOR)
        assert shapely.equals(row.values["position"], DOOR.centroid)


def test_a_track_that_has_ended_is_no_actor_and_a_position_is_of_its_stamp(world: World) -> None:
    scene = DoorScene(world)
    track = world.add_track("ann")
    world.add_states([(track, us(100), 3.5, 2, None), (track, us(101), 3.6, 2, 1.5, True)])
    base = {"input": "door", "instance_id": scene.door_id}
    visit = {"input": "track_in_room", "instance_id": scene.west_id, "track_id": track}
    rows = [
        Row(us(101), 1, "a", "object_state", base),
        Row(us(101.1), 1, "b", "object_state", base),
        Row(us(101), 2, "c", "relation", visit),
    ]
    with connect(world.dsn) as connection:
        at_end, after, there = enriched(connection, world.map_id, rows, NEEDS)
    assert at_end.values["actor"] == "ann"
    assert "actor" not in after.values
    assert there.values["position"] == shapely.Point(3.6, 2, 1.5)
    assert "actor" not in there.values
