"""Adding, changing and dropping a query, and editing the map under it, while tracks are there."""

from __future__ import annotations

import pytest
import shapely
from stateful_oracle import Asked
from world import SECOND_US, World

ROOM = shapely.box(0, 0, 4, 4)


def told(world: World) -> list[tuple[str, str, str, int]]:
    return [(track, kind, cause, us // SECOND_US) for track, _, kind, cause, us in world.changes()]


@pytest.fixture
def inside(world: World) -> World:
    """One room; `a` deep inside of it, `b` just inside, `c` outside, seen at 1, 2 and 3 s."""
    world.add_room("room", ROOM)
    for second, (name, x) in enumerate({"a": 2.0, "b": 3.9, "c": 5.0}.items(), 1):
        world.add_states([(world.add_track(name), second * SECOND_US, x, 2.0, None)])
    return world


def test_a_query_begins_with_what_holds_and_ends_with_it(inside: World) -> None:
    before = told(inside)
    assert before == [("a", "began", "appeared", 1), ("b", "began", "appeared", 2)]
    query = (
        "insert into semap.continuous_query (map_id, name, object_concept_id, predicate, distance_m)"
        " select %s, 'near', object_concept_id, 'within_distance', 2 from semap.continuous_query where query_id = %s"
    )
    inside.run(query, inside.map_id, inside.query_id)
    added = told(inside)[len(before) :]
    assert sorted(added) == [("a", "began", "map", 1), ("b", "began", "map", 2), ("c", "began", "map", 3)]
    inside.run("update semap.continuous_query set distance_m = 0.5 where name = 'near'")
    assert told(inside)[len(before) + 3 :] == [("c", "ended", "map", 3)]
    inside.run("delete from semap.continuous_query where name = 'near'")
    assert sorted(told(inside)[len(before) + 4 :]) == [("a", "ended", "map", 1), ("b", "ended", "map", 2)]
    assert inside.one("select count(*) from semap.relation where map_id = %s", inside.map_id) == 2


def test_what_changes_only_how_an_edge_counts_changes_no_relation(inside: World) -> None:
    before = told(inside)
    for asked in (
        Asked(enter_margin_m=0.3, leave_margin_m=0.3),
        Asked(longest_gap=9, fastest_mps=9),
        Asked(),
    ):
        inside.run(
            "update semap.continuous_query set enter_margin_m = 0, leave_margin_m = 0, longest_gap = null,"
            " fastest_mps = null where query_id = %s",
            inside.query_id,
        )
        inside.ask(asked)
        assert told(inside) == before
    assert inside.relations() == {("a", "room", SECOND_US), ("b", "room", 2 * SECOND_US)}
    inside.add_states([(inside.rows("select track_id from semap.track where name = 'b'")[0][0],
                        9 * SECOND_US, 4.1, 2.0, None)])  # fmt: skip
    assert told(inside)[len(before) :] == [("b", "ended", "moved", 9)]


def test_a_room_that_is_edited_forgets_who_was_at_its_boundary(inside: World) -> None:
    inside.ask(Asked(enter_margin_m=0.3, leave_margin_m=0.3))
    (b,) = inside.rows("select track_id from semap.track where name = 'b'")[0]
    inside.add_states([(b, 5 * SECOND_US, 4.2, 2.0, None)])
    assert inside.rows("select confirmed, pending, raw from semap.relation where track_id = %s", b) == [
        (True, True, False)
    ]
    inside.edit_room("room", shapely.box(0, 0, 4.1, 4))
    assert told(inside)[2:] == [("b", "ended", "map", 5)]
    assert inside.rows("select from semap.relation where track_id = %s", b) == []


def test_a_query_is_about_the_tracks_that_it_says(inside: World) -> None:
    before = told(inside)
    inside.run(
        "update semap.continuous_query set subject_where = %s where query_id = %s",
        inside.keep_where({"op": "=", "args": [{"property": "name"}, "b"]}),
        inside.query_id,
    )
    assert told(inside)[len(before) :] == [("a", "ended", "map", 1)]
    for name in ("b", "d"):
        inside.add_states([(inside.add_track(name + name), 8 * SECOND_US, 1.0, 1.0, None)])
    (a,) = inside.rows("select track_id from semap.track where name = 'a'")[0]
    inside.add_states([(a, 9 * SECOND_US, 1.0, 1.0, None)])
    assert told(inside)[len(before) + 1 :] == []
    inside.run("update semap.continuous_query set subject_where = null where query_id = %s", inside.query_id)
    found = {each[0] for each in told(inside)[len(before) + 1 :]}
    assert found == {"a", "bb", "dd"}


def test_a_query_is_about_the_instances_that_it_says(inside: World) -> None:
    before = told(inside)
    inside.run("update semap.instance set attributes = '{\"seats\": 4}' where name = 'room'")
    inside.run(
        "update semap.continuous_query set object_where = %s where query_id = %s",
        inside.keep_where({"op": ">", "args": [{"property": "attributes.seats"}, 4]}, "instance"),
        inside.query_id,
    )
    assert sorted(told(inside)[len(before) :]) == [("a", "ended", "map", 1), ("b", "ended", "map", 2)]
    inside.run("update semap.instance set attributes = '{\"seats\": 5}' where name = 'room'")
    assert sorted(told(inside)[len(before) + 2 :]) == [("a", "began", "map", 1), ("b", "began", "map", 2)]


def test_the_sides_of_a_thing_are_those_of_its_own_frame(world: World) -> None:
    world.run(
        "update semap.continuous_query set predicate = 'left_of', distance_m = 1 where query_id = %s",
        world.query_id,
    )
    world.add_room("shelf", shapely.box(0, 0, 2, 1))
    for second, (x, y) in enumerate([(1, 1.5), (1, 2.5), (1, 0.5), (3, 0.5), (1, -0.5), (0.1, 1.9)], 1):
        world.add_states([(world.add_track(f"at {second}"), second * SECOND_US, x, y, None)])
    assert [each[0] for each in told(world)] == ["at 1", "at 6"]
