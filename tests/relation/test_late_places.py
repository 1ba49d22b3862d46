"""Positions are flushed once for many batches; nothing that is told of relations differs by that."""

from __future__ import annotations

import random

import pytest
import shapely
from oracle import Oracle
from world import World

from semap.timeline.stamp import to_datetime

MANY = 60
FRAME_US = 100_000
ROOMS = {
    f"r{column}{row}": shapely.box(4 * column, 4 * row, 4 * column + 4, 4 * row + 4)
    for column in range(3)
    for row in range(3)
}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("tracks", "in_batches"), [(MANY, False), (MANY, True), (12, True)])
def test_relations_are_those_of_each_state_whatever_happens_between_frames(
    world: World, tracks: int, in_batches: bool, seed: int
) -> None:
    dice = random.Random(seed)
    oracle = Oracle()
    for name, room in ROOMS.items():
        world.add_room(name, room)
        oracle.edit(name, (room, None))
    ids = {f"t{n}": world.add_track(f"t{n}") for n in range(tracks)}
    places = {name: (dice.uniform(0, 12), dice.uniform(0, 12)) for name in ids}
    alive = set(ids)
    sent = {name: [] for name in ids}
    lazily = 0
    stored = set()
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
        if len(alive) < 4 and what in ("last", "end"):
            what = "whole"
        if what == "part":
            batch = dice.sample(batch, max(1, len(batch) * 2 // 3))
        elif what == "last":
            gone = dice.choice(sorted(alive))
            batch = [(*each[:5], True) if each[0] == gone else each for each in batch]
            alive.discard(gone)
        elif what == "again" and len(alive) < tracks:
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
                late_us = (before_us + last_us) // 2
                world.add_states([(ids[late], late_us, *before, None, False)])
                stored.add((ids[late], to_datetime(late_us), *before))
        for each in batch:
            sent[each[0]] = [] if each[5] else [*sent[each[0]], each[1:4]][-2:]
        cut = dice.randint(1, len(batch) - 1) if what == "split" else len(batch)
        for part in (batch[:cut], batch[cut:]):
            if part:
                oracle.batch(part)
                dice.shuffle(part)
                states = [(ids[name], *rest) for name, *rest in part]
                stored |= {
                    (track_id, to_datetime(stamp_us), x_m, y_m) for track_id, stamp_us, x_m, y_m, *_ in states
                }
                if in_batches and not any(is_last for *_, is_last in states):
                    world.add_batch(states)
                else:
                    world.add_states(states)
        if dice.random() < 0.5:
            assert places_of(world) == {name: oracle.present[name][1:3] for name in alive}
        if dice.random() < 0.1:
            world.run("select semap.compact_states(%s, 0)", world.source_id)
        lazily += world.one(
            "select count(*) from semap.source_count where source_id = %s and unflushed > 0",
            world.source_id,
        )
    assert lazily > 20, "places were written late"
    assert sorted(world.changes()) == sorted(oracle.changes)
    assert world.relations() == oracle.relations()
    world.run("select semap.flush_positions(array[%s])", world.source_id)
    assert places_of(world, "track_now") == places_of(world)
    for is_compacted in (False, True):
        states = world.rows("select track_id, stamp, x_m, y_m from semap.stored_state")
        assert len(states) == len(stored), is_compacted
        assert set(states) == stored
        world.run("select semap.compact_all(array[%s])", world.source_id)
    assert world.one("select count(*) from semap.state_chunk where track_id is null") == 0


def places_of(world: World, table: str = "track_place") -> dict[str, tuple[float, float]]:
    """Where each track that lives is."""
    return {
        name: (x_m, y_m)
        for name, x_m, y_m in world.rows(
            f"select t.name, n.x_m, n.y_m from semap.{table} n join semap.track t using (track_id)"
            " where n.map_id = %s and n.live",
            world.map_id,
        )
    }
