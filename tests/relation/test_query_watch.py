"""What holds, and then each change of it, while others write: none is missed and none comes twice."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from threading import Thread

import shapely
from made_relations import KINDS, Thing, at, change, hold, pair_query, sides
from world import SECOND_US, World

from semap.worker.query_watch import Delta, watch_query


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


def test_a_watch_tells_either_kind_of_side_and_what_is_crossed(world: World) -> None:
    """Relations by hand, of queries that rest."""
    things: dict[str, list[Thing]] = {
        "track": [("track", world.add_track(name), name) for name in ("ann", "bob")],
        "instance": [
            ("instance", world.add_room(name, shapely.box(0, 0, 1, 1)), name) for name in ("cup", "desk")
        ],
    }
    for subject, object_ in KINDS:
        name = f"{subject} {object_}"
        query_id = pair_query(world, name, subject, object_)
        a, b = things[subject][0], things[object_][1]
        hold(world, query_id, a, b, 5)
        deltas = watch_query(world.dsn, query_id)
        held = next(deltas)
        assert held is not None
        assert (held.subject, held.object, held.kind, held.at) == (a[2], b[2], None, at(5))
        assert ids(held) == sides(a, b, named=False)
        assert next(deltas) is None
        change(world, query_id, name, "ended", a, b, 9, 5, x_m=1.5, y_m=2.5)
        change(
            world, query_id, name, "crossed", a, b, 10, direction="right_to_left", door_id=1, door_name="gate"
        )
        ended, crossed = (told(deltas) for _ in range(2))
        assert ids(ended) == ids(crossed) == sides(a, b, named=False)
        assert (ended.kind, ended.at, ended.known, ended.x_m, ended.y_m) == ("ended", at(9), at(9), 1.5, 2.5)
        assert (crossed.kind, crossed.direction, crossed.door) == ("crossed", "right_to_left", "gate")
        deltas.close()


def ids(delta: Delta) -> dict[str, int]:
    names = ("track_id", "subject_instance_id", "instance_id", "object_track_id")
    return {name: getattr(delta, name) for name in names if getattr(delta, name) is not None}


def told(deltas: Iterator[Delta | None]) -> Delta:
    return next(delta for delta in deltas if delta is not None)


def test_a_watch_tells_what_late_states_correct(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    track_id = world.add_track("t")
    world.add_states([(track_id, SECOND_US, 9.0, 1.0, None), (track_id, 5 * SECOND_US, 1.0, 1.0, None)])
    deltas = watch_query(world.dsn, world.query_id)
    assert [delta and delta.at.second for delta in (next(deltas), next(deltas))] == [5, None]
    world.add_states([(track_id, 3 * SECOND_US, 1.0, 1.0, None)])
    told = []
    while len(told) < 2:
        if (delta := next(deltas)) is not None:
            told.append((delta.kind, delta.at.second, delta.amendment))
    deltas.close()
    assert told == [("began", 5, "retracted"), ("began", 3, "added")]
