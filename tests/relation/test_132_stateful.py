"""Queries with margins, times to confirm, probabilities and ways between samples: equal to plain Python's."""

from __future__ import annotations

import math
import random
from uuid import uuid4

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from stateful_oracle import Asked, Follower, Sample
from test_oracle import BANDS, SHAPES
from world import SECOND_US, World

from semap.timeline.stamp import to_datetime

margin = st.sampled_from([0.0, 0.0, 0.15, 0.4])
confirm = st.sampled_from([0.0, 0.0, 0.25, 1.0, 3.0])
ways = st.sampled_from(
    [{}, {"longest_gap": 2.5, "fastest_mps": 6.0}, {"longest_gap": 30.0, "fastest_mps": 30.0}]
)
odds = st.sampled_from([{}, {}, {"enter_probability": 0.9, "leave_probability": 0.1, "widest_std_m": 1.0}])
predicate = st.sampled_from(
    [
        {},
        {},
        {"predicate": "covers"},
        {"predicate": "within_distance", "distance_m": 0.75},
        {"predicate": "on"},
    ]
)
asked = st.builds(
    lambda what, enter, leave, enter_s, leave_s, way, sure: Asked(
        enter_margin_m=enter, leave_margin_m=leave, enter_confirm=enter_s, leave_confirm=leave_s, **what, **way, **sure
    ),
    predicate, margin, margin, confirm, confirm, ways, odds,
)  # fmt: skip
YAWS = [0.0, *(float(np.float32(yaw)) for yaw in (0.3, math.pi / 4, math.pi / 2, -1.2, 2.5))]
QUICK = settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def walk(dice: random.Random, steps: int) -> list[Sample]:
    """Somebody who stands, walks and jumps, seen at uneven times; numbers that are exact in binary."""
    x, y, z, stamp_us = dice.randint(0, 6144) / 1024, dice.randint(0, 6144) / 1024, 1.5, 0
    seen = []
    for _ in range(steps):
        stamp_us += dice.choice([SECOND_US // 10, SECOND_US // 4, SECOND_US, 4 * SECOND_US])
        reach = dice.choice([0, 20, 200, 1000, 6000])
        x = min(max(x + dice.randint(-reach, reach) / 1024, -4), 12)
        y = min(max(y + dice.randint(-reach, reach) / 1024, -4), 12)
        z = dice.choice([z, z, z, z, 0.0, 1.5, 2.75, 3.25, 4.0])
        std_m = dice.choice([None, 0.0, 0.0625, 0.25, 0.5, 2.0])
        height = None if dice.random() < 0.1 else z
        ellipse = (None, None)
        if std_m is not None and dice.random() < 0.6:
            ellipse = (std_m * dice.choice([0, 2**-11, 0.25, 0.5, 1]), dice.choice(YAWS))
        seen.append(Sample(stamp_us, x, y, height, std_m, dice.random() < 0.04, *ellipse))
    return seen


def add_as_frames(world: World, source_id: int, track_id: int, samples: list[Sample]) -> None:
    """Each state of the one track of a source as a frame, but for one that is the last, in the order of stamps."""
    for each in samples:
        if each.is_last:
            world.add_samples(track_id, [each])
            continue
        values = (each.x_m, each.y_m, each.z_m, each.std_m, each.std_across_m, each.std_yaw_rad)
        world.run(
            "select semap.add_states(%s, %s, %s, %s::float8[], %s::float8[], %s::float8[], %s::real[],"
            " std_across_m => %s::real[], std_yaw_rad => %s::real[])",
            source_id, to_datetime(each.stamp_us), [track_id], *(None if v is None else [v] for v in values),
        )  # fmt: skip


def check(
    database: str, question: Asked, rooms: list, seed: int, steps: int, *, in_batches: bool = False
) -> None:
    dice = random.Random(seed)
    world = World(database, f"map {uuid4()}")
    try:
        world.ask(question)
        for number, (shape, band) in enumerate(rooms):
            world.add_room(f"r{number}", shape, band)
        sources = {name: world.add_source(name) for name in ("a", "b")}
        world.run("update semap.source set jump_m = null where map_id = %s", world.map_id)
        tracks = {name: walk(dice, steps) for name in ("a", "b")}
        for name, seen in tracks.items():
            track_id, start = world.add_track(name, sources[name]), 0
            while start < len(seen):
                end = start + dice.choice([1, 1, 1, 2, 5, 100])
                batch = seen[start:end]
                if in_batches:
                    add_as_frames(world, sources[name], track_id, batch)
                else:
                    world.add_samples(track_id, dice.sample(batch, len(batch)))
                start = end
        for number, (shape, band) in enumerate(rooms):
            for name, seen in tracks.items():
                oracle = Follower(shape, band, question)
                for sample in seen:
                    oracle.take(sample)
                found = world.rows(
                    "select kind::text, cause::text, (extract(epoch from stamp) * 1000000)::bigint,"
                    " (extract(epoch from transition_at) * 1000000)::bigint from semap.relation_change"
                    " where map_id = %s and track_name = %s and instance_name = %s order by change_id",
                    world.map_id, name, f"r{number}",
                )  # fmt: skip
                wanted = [(f.kind, f.cause, f.stamp_us) for f in oracle.found]
                assert [row[:3] for row in found] == wanted
                assert [row[3] for row in found] == pytest.approx([f.edge_us for f in oracle.found], abs=2)
                held = world.rows(
                    "select from semap.relation_now where map_id = %s and track = %s and instance = %s",
                    world.map_id, name, f"r{number}",
                )  # fmt: skip
                assert bool(held) == oracle.held
    finally:
        world.close()


@QUICK
@given(
    question=asked,
    rooms=st.lists(st.tuples(st.sampled_from(SHAPES), st.sampled_from(BANDS)), min_size=1, max_size=3),
    seed=st.integers(0, 2**32),
    in_batches=st.booleans(),
)
def test_stateful_relations_equal_the_oracle(
    database: str, question: Asked, rooms: list, seed: int, in_batches: bool
) -> None:
    check(database, question, rooms, seed, 40, in_batches=in_batches)
