"""A single fix far off changes nothing; a second one that agrees with it does."""

from __future__ import annotations

import shapely
from world import SECOND_US, World


def states(track_id: int, places: list[tuple[float, float]], start_s: int = 0, *, last: bool = False) -> list:
    return [
        (track_id, (start_s + n) * SECOND_US, x, y, None, last and n == len(places) - 1)
        for n, (x, y) in enumerate(places)
    ]


def told(world: World) -> list[tuple[str, str, str, int]]:
    return [(room, kind, cause, stamp_us // SECOND_US) for _, room, kind, cause, stamp_us in world.changes()]


def outliers(world: World) -> int:
    return world.one("select outliers from semap.source where source_id = %s", world.source_id)


def test_a_single_fix_far_off_changes_nothing_in_any_batches(world: World) -> None:
    world.add_room("here", shapely.box(0, 0, 10, 10))
    world.add_room("there", shapely.box(195, 0, 210, 10))
    walk = [(1, 1), (2, 1), (202, 1), (3, 1), (4, 1), (203, 2), (5, 1)]
    for size in (1, 2, 7):
        track_id = world.add_track(f"in {size}")
        whole = states(track_id, walk)
        for start in range(0, len(whole), size):
            world.add_states(whole[start : start + size])
        assert [each[2:] for each in world.changes() if each[0] == f"in {size}"] == [("began", "appeared", 0)]
        assert world.rows("select x_m, y_m from semap.track_now where track_id = %s", track_id) == [
            (5.0, 1.0)
        ]
    assert outliers(world) == 6


def test_who_is_seen_there_again_has_jumped(world: World) -> None:
    world.add_room("here", shapely.box(0, 0, 10, 10))
    world.add_room("there", shapely.box(195, 0, 210, 10))
    track_id = world.add_track("a")
    for each in states(track_id, [(1, 1), (202, 1), (203, 1), (204, 1)]):
        world.add_states([each])
    assert told(world) == [
        ("here", "began", "appeared", 0), ("here", "ended", "moved", 2), ("there", "began", "moved", 2),
    ]  # fmt: skip
    assert outliers(world) == 0


def test_a_track_whose_last_state_is_far_off_ends_where_it_was(world: World) -> None:
    world.add_room("here", shapely.box(0, 0, 10, 10))
    world.add_room("there", shapely.box(195, 0, 210, 10))
    world.add_states(states(world.add_track("a"), [(1, 1), (2, 1), (202, 1)], last=True))
    assert told(world) == [("here", "began", "appeared", 0), ("here", "ended", "disappeared", 2)]
    assert outliers(world) == 1


def test_a_source_without_the_gate_takes_each_state_as_it_is(world: World) -> None:
    world.run("update semap.source set jump_m = null where source_id = %s", world.source_id)
    world.add_room("here", shapely.box(0, 0, 10, 10))
    world.add_states(states(world.add_track("a"), [(1, 1), (202, 1), (3, 1)]))
    assert [each[1] for each in told(world)] == ["began", "ended", "began"]
