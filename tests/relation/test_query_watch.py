"""What holds, and then each change of it, while others write: none is missed and none comes twice."""

from __future__ import annotations

from itertools import pairwise
from threading import Thread

import shapely
from world import SECOND_US, World

from semap.worker.query_watch import watch_query


def test_a_watch_begins_with_what_holds_and_tells_each_change(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    other = World(world.dsn, "other")
    other.add_room("room", shapely.box(0, 0, 4, 4))
    ids = [world.add_track(f"t{n}") for n in range(3)]
    strange = other.add_track("strange")
    for second, track_id in enumerate(ids, 1):
        world.add_states([(track_id, second * SECOND_US, 1.0, 1.0, None)])

    def write() -> None:
        for step in range(40):
            x = 5.0 if step % 2 == 0 else 1.0
            other.add_states([(strange, (10 + step) * SECOND_US, x, 1.0, None)])
            world.add_states([(track_id, (10 + step) * SECOND_US, x, 1.0, None) for track_id in ids])

    writing = Thread(target=write)
    deltas = watch_query(world.dsn, world.query_id)
    held = []
    while (delta := next(deltas)) is not None:
        held.append(delta)
    assert [(each.kind, each.track, each.at.second) for each in held] == [
        (None, "t0", 1), (None, "t1", 2), (None, "t2", 3)
    ]  # fmt: skip
    writing.start()
    seen = []
    while len(seen) < 120:
        delta = next(deltas)
        if delta is not None:
            seen.append((delta.track, delta.kind))
    writing.join()
    deltas.close()
    for n in range(3):
        assert [kind for track, kind in seen if track == f"t{n}"] == ["ended", "began"] * 20
    assert {track for track, _ in seen} == {"t0", "t1", "t2"}
    other.close()


def test_a_watch_that_starts_while_others_write_misses_nothing(world: World) -> None:
    """What is held at its beginning, with what is told after it, gives what holds in the end."""
    world.add_room("room", shapely.box(0, 0, 4, 4))
    track_id = world.add_track("t")
    total = 200

    def write() -> None:
        for step in range(total):
            world.add_states([(track_id, step * SECOND_US, 5.0 if step % 2 else 1.0, 1.0, None)])

    writing = Thread(target=write)
    writing.start()
    deltas = watch_query(world.dsn, world.query_id)
    first = []
    while (delta := next(deltas)) is not None:
        first.append(delta)
    began = first[0].at.minute * 60 + first[0].at.second if first else None
    kinds, last = [], -1
    while last < total - 1:
        delta = next(deltas)
        if delta is not None:
            kinds.append(delta.kind)
            last = delta.at.minute * 60 + delta.at.second
    writing.join()
    deltas.close()
    assert all(a != b for a, b in pairwise(kinds))
    assert kinds[0] == ("ended" if began is not None else "began")
    if began is not None:
        assert total - 1 - began == len(kinds)
