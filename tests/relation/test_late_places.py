"""Places of large frames are written once a second; nothing that is told of relations differs by that."""

from __future__ import annotations

import random

import pytest
import shapely
from oracle import Oracle
from world import World

TRACKS = 210  # more than the trigger takes for few
FRAME_US = 100_000
ROOMS = {
    f"r{column}{row}": shapely.box(4 * column, 4 * row, 4 * column + 4, 4 * row + 4)
    for column in range(3)
    for row in range(3)
}


@pytest.mark.parametrize("seed", range(2))
def test_relations_are_those_of_each_state_whatever_happens_between_frames(world: World, seed: int) -> None:
    dice = random.Random(seed)
    oracle = Oracle()
    for name, room in ROOMS.items():
        world.add_room(name, room)
        oracle.edit(name, (room, None))
    ids = {f"t{n}": world.add_track(f"t{n}") for n in range(TRACKS)}
    places = {name: (dice.uniform(0, 12), dice.uniform(0, 12)) for name in ids}
    alive = set(ids)
    sent = {name: [] for name in ids}
    lazily = 0
    for frame in range(1, 60):
        now_us = frame * FRAME_US
        for name in alive:
            x, y = places[name]
            places[name] = (
                min(max(x + dice.gauss(0, 0.15), 0), 12),
                min(max(y + dice.gauss(0, 0.15), 0), 12),
            )
        batch = [(name, now_us, *places[name], None, False) for name in sorted(alive)]
        what = dice.choice(["whole"] * 8 + ["part", "late", "edit", "end", "last", "again", "split"])
        if what == "part":
            batch = dice.sample(batch, 150)
        elif what == "last":
            gone = dice.choice(sorted(alive))
            batch = [(*each[:5], True) if each[0] == gone else each for each in batch]
            alive.discard(gone)
        elif what == "again" and len(alive) < TRACKS:
            back = dice.choice(sorted(ids.keys() - alive))
            alive.add(back)
            batch.append((back, now_us, *places[back], None, False))
        elif what == "edit":
            room = shapely.box(0, 0, dice.choice([3, 4, 5]), 4)
            world.edit_room("r00", room)
            oracle.edit("r00", (room, None))
        elif what == "end":
            gone = dice.choice(sorted(alive))
            alive.discard(gone)
            sent[gone] = []
            batch = [each for each in batch if each[0] != gone]
            world.end_track(ids[gone], now_us - 1)
            oracle.end(gone, now_us - 1)
        elif what == "late":
            late = dice.choice(sorted(alive))
            if len(sent[late]) == 2:  # one that stands where it stood corrects nothing
                (before_us, *before), (last_us, *_) = sent[late]
                world.add_states([(ids[late], (before_us + last_us) // 2, *before, None, False)])
        for each in batch:
            sent[each[0]] = [] if each[5] else [*sent[each[0]], each[1:4]][-2:]
        cut = dice.randint(1, len(batch) - 1) if what == "split" else len(batch)
        for part in (batch[:cut], batch[cut:]):
            if part:
                oracle.batch(part)
                dice.shuffle(part)
                world.add_states([(ids[name], *rest) for name, *rest in part])
        lazily += world.one(
            "select count(*) from semap.source_count where source_id = %s and frame_stamp > placed_stamp",
            world.source_id,
        )
    assert lazily > 20, "places were written late"
    assert sorted(world.changes()) == sorted(oracle.changes)
    assert world.relations() == oracle.relations()
    world.run("select semap.settle_places(array[%s])", world.source_id)
    written = world.rows(
        "select t.name, n.x_m, n.y_m from semap.track_now n join semap.track t using (track_id)"
        " where n.map_id = %s and n.live",
        world.map_id,
    )
    assert {name: (x, y) for name, x, y in written} == {
        name: oracle.present[name][1:3] for name in oracle.present.keys() - oracle.ended
    }
