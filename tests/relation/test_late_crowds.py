"""Of a crowd that crosses lines some states come first, and the rest late, in any order and many at once.

More come late in one statement than are replayed together, and of one track several in a row.
"""

from __future__ import annotations

import random
from itertools import pairwise

import numpy as np
import pytest
import shapely
from data_sets import data_set
from world import SECOND_US, World

from semap.store.operate.doctor.verification import verify

STANDING = """
    select track_name, instance_name, (extract(epoch from stamp) * 1000000)::bigint, direction
    from semap.relation_change c
    where query_name = 'crossed' and amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change d where d.retracts = c.uid)
"""
FRAME_US = SECOND_US // 25

Seen = tuple[str, int, float, float]


def draw_lines(world: World, heights_m: list[float]) -> None:
    world.run(
        "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, abstraction)"
        " values (%s, 'crossed', 'crosses', 'track', 'instance', 'Line')",
        world.map_id,
    )
    for y_m in heights_m:
        line = shapely.LineString([(-50, y_m), (50, y_m)])
        world.run(
            "with i as (insert into semap.instance (map_id, uid, name, concept_id, frame_id)"
            " select %s, gen_random_uuid(), %s, concept_id, %s from semap.concept where name = 'Room' returning *)"
            " insert into semap.abstraction (description_id, instance_id, type, geometry)"
            " select absolute_description_id, instance_id, 'Line', %s from i",
            world.map_id, f"y {y_m}", world.frame_id, shapely.to_wkb(line, hex=True),
        )  # fmt: skip


def hash_of(name: str) -> int:
    """The same in each process."""
    return sum(map(ord, name))


def crossings(walks: dict[str, list[Seen]], heights_m: list[float]) -> list[tuple[str, str, int, str]]:
    """Of ways that do not touch a line at a state: leads a line east, then north of it is its left."""
    return sorted(
        (name, f"y {y_m}", after[1], "left_to_right" if before[3] > y_m else "right_to_left")
        for name, walk in walks.items()
        for y_m in heights_m
        for before, after in pairwise(walk)
        if (before[3] - y_m) * (after[3] - y_m) < 0
    )


def check(world: World, states: list[Seen], heights_m: list[float], batch: int, dice: random.Random) -> None:
    """Some of the states first, in order, then the rest in any order, `batch` states a statement."""
    draw_lines(world, heights_m)
    world.run("update semap.source set jump_m = null")
    tracks = {name: world.add_track(name) for name in sorted({each[0] for each in states})}
    run = dice.choice([1, 6, 12, 12])
    is_first, seen = [], dict.fromkeys(tracks, 0)
    for name, *_ in states:
        is_first.append((seen[name] + hash_of(name)) // run % 2 == 0)
        seen[name] += 1
    first = [each for each, now in zip(states, is_first, strict=True) if now]
    late = [each for each, now in zip(states, is_first, strict=True) if not now]
    for part in (first, dice.sample(late, len(late))):
        for begin in range(0, len(part), batch):
            world.add_states(
                [
                    (tracks[name], stamp_us, x_m, y_m, None)
                    for name, stamp_us, x_m, y_m in part[begin : begin + batch]
                ]
            )
    walks = {name: [each for each in states if each[0] == name] for name in tracks}
    assert sorted(world.rows(STANDING)) == crossings(walks, heights_m)
    verification = verify(world.dsn, lambda said: None)
    with verification.connection:
        assert [each for each in verification.look(None) if each.differ] == []


@pytest.mark.parametrize("seed", range(4))
def test_a_crowd_half_of_which_comes_late_crosses_as_it_walked(world: World, seed: int) -> None:
    dice = random.Random(seed)
    states: list[Seen] = []
    for person in range(40):
        y_m = dice.uniform(-2, 2)
        for frame in range(40):
            y_m += dice.choice([-0.6, -0.3, 0.2, 0.7]) * dice.random()
            states.append((f"p{person}", frame * SECOND_US, person / 2, y_m))
    states.sort(key=lambda each: each[1])
    check(world, states, [-0.503, 0.701], [1000, 1000, 300, 150][seed], dice)


def test_people_of_whom_every_second_sample_comes_late_cross_as_they_walked(world: World) -> None:
    """A crowd in a laboratory, three times a second."""
    rows = np.loadtxt(data_set("bottleneck") / "040_c_56_h-.txt")
    rows = rows[(rows[:, 1] % 8 == 0) & (rows[:, 0] <= 40)]
    rows = rows[np.argsort(rows[:, 1], kind="stable")]
    states = [(str(int(p)), int(frame) * FRAME_US, float(x_m), float(y_m)) for p, frame, x_m, y_m, *_ in rows]
    check(world, states, [-0.6, 0.5], 400, random.Random(1))
