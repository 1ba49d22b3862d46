"""Through which door or edge a boundary was crossed between two samples."""

from __future__ import annotations

import random

import shapely
from stateful_oracle import Asked, Sample
from world import SECOND_US, World

ROOM = shapely.Polygon([(0, 0), (6, 0), (6, 4), (3, 4), (3, 2), (0, 2)])
WAYS = Asked(longest_gap=30.0, fastest_mps=30.0)


def crossings(world: World) -> list[tuple]:
    return world.rows(
        "select kind::text, edge, door_name from semap.relation_change where map_id = %s order by change_id",
        world.map_id,
    )


def walk(world: World, *places: tuple[float, float]) -> list[tuple]:
    """What was crossed on the straight ways between these places, a second apart."""
    track_id = world.add_track("walker")
    world.add_samples(track_id, [Sample(n * SECOND_US, x, y, None) for n, (x, y) in enumerate(places)])
    return crossings(world)


def add_door(world: World, name: str, footprint: shapely.Geometry, *rooms: int) -> None:
    door_id = world.add_room(name, footprint)
    world.run(
        "update semap.instance set concept_id = (select concept_id from semap.concept where name = 'Door')"
        " where instance_id = %s",
        door_id,
    )
    for room in rooms:
        world.run("insert into semap.door_room (door_id, room_id) values (%s, %s)", door_id, room)


def test_the_door_is_named_where_the_way_leads_through_it_and_the_edge_everywhere(world: World) -> None:
    world.ask(WAYS)
    room = world.add_room("hall", ROOM)
    add_door(world, "south", shapely.box(1, -0.3, 2, -0.1), room)
    add_door(world, "east", shapely.box(6, 1, 6.2, 2), room)
    add_door(world, "elsewhere", shapely.box(4, 4, 5, 4.1))
    # in by the southern door, out by the eastern one, in and out through walls; the last door is not the hall's
    found = walk(world, (1.5, -1), (1.5, 1), (5, 1.5), (7, 1.5), (7, 3), (4.5, 3), (4.5, 5))
    assert found == [
        ("began", 1, "south"), ("ended", 2, "east"), ("began", 2, None), ("ended", 3, None),
    ]  # fmt: skip


def draw_door(world: World, name: str, place: str, width_m: float | None, room: int) -> None:
    """A door without a shape of its own: a line, or a point."""
    frame_id = world.one(
        "insert into semap.frame (map_id, name, parent_id) values (%s, %s, %s) returning frame_id",
        world.map_id, name, world.frame_id,
    )  # fmt: skip
    world.run(f"select semap.set_transform({frame_id}, row({place})::semap.pose)")
    door_id = world.one(
        "insert into semap.instance (map_id, name, concept_id, frame_id, attributes)"
        " select %s, %s, concept_id, %s, jsonb_strip_nulls(jsonb_build_object('width_m', %s::float))"
        " from semap.concept where name = 'Door' returning instance_id",
        world.map_id, name, frame_id, width_m,
    )  # fmt: skip
    world.run("insert into semap.door_room (door_id, room_id) values (%s, %s)", door_id, room)


def test_doors_that_were_drawn_as_lines_or_points_are_named_as_well(world: World) -> None:
    world.ask(WAYS)
    room = world.add_room("hall", ROOM)
    quarter = 0.5**0.5
    draw_door(world, "south", "1.5, 0, 0, 0, 0, 0, 1", 1.0, room)
    draw_door(world, "east", f"6, 1.5, 0, 0, 0, {quarter}, {quarter}", 1.0, room)
    draw_door(world, "north", "4.5, 4, 0, 0, 0, 0, 1", None, room)
    found = walk(world, (1.1, -1), (1.1, 1), (5, 1.9), (7, 1.9), (7, 3), (4.4, 3), (4.4, 5))
    assert found == [
        ("began", 1, "south"), ("ended", 2, "east"), ("began", 2, None), ("ended", 3, "north"),
    ]  # fmt: skip


def test_a_change_that_is_not_on_the_boundary_names_neither(world: World) -> None:
    world.ask(Asked(longest_gap=1.5, fastest_mps=3.0))
    room = world.add_room("hall", ROOM)
    add_door(world, "south", shapely.box(1, -0.3, 2, -0.1), room)
    # too fast to be a way; then one appears within
    assert walk(world, (1.5, -9), (1.5, 1)) == [("began", None, None)]


def test_what_late_states_correct_says_through_what_as_well(world: World) -> None:
    world.ask(WAYS)
    room = world.add_room("hall", ROOM)
    add_door(world, "south", shapely.box(1, -0.3, 2, -0.1), room)
    add_door(world, "east", shapely.box(6, 1, 6.2, 2), room)
    places = [(1.5, -1), (1.5, 1), (5, 1.5), (7, 1.5), (7, 3), (4.5, 3), (4.5, 5)]
    walk(world, *places)
    standing = (
        "select kind::text, transition_at, edge, door_id, door_name from semap.relation_change c"
        " where track_name = %s and amendment is distinct from 'retracted'"
        " and not exists (select from semap.relation_change d where d.retracts = c.uid) order by transition_at"
    )
    late = world.add_track("late")
    seen = [Sample(n * SECOND_US, x, y, None) for n, (x, y) in enumerate(places)]
    world.add_samples(late, seen[::3])
    world.add_samples(late, [each for n, each in enumerate(seen) if n % 3])
    assert world.rows(standing, "late") == world.rows(standing, "walker")
    told = "uid, edge, door_id, door_name"
    taken_back = world.rows(
        f"select {told} from semap.relation_change where uid in (select retracts from semap.relation_change)"
        " order by uid"
    )
    assert taken_back
    assert taken_back == world.rows(
        f"select {told.replace('uid', 'retracts')} from semap.relation_change where amendment = 'retracted'"
        " order by retracts"
    )


def test_outlines_are_not_looked_at_where_nobody_asks_for_ways(world: World) -> None:
    world.add_room("hall", ROOM)
    track_id = world.add_track("walker")
    world.run("set track_functions = 'all'")
    with world.connection.transaction():
        world.add_states([(track_id, n * SECOND_US, x, 1.0, None) for n, x in enumerate((-1.0, 1.0, 7.0))])
        calls = world.rows(
            "select funcname::text from pg_stat_xact_user_functions where schemaname = 'semap'"
        )
    assert len(world.changes()) == 2
    assert ("record_crossings",) in calls
    assert ("crossed_at",) not in calls


def test_edges_are_those_that_are_nearest_to_the_place(world: World) -> None:
    world.ask(WAYS)
    dice = random.Random(7)
    ring = [
        (r * x, r * y) for r, x, y in zip((5, 2, 6, 3, 7, 2, 4, 3), *zip(*OCTAGON, strict=True), strict=True)
    ]
    shape = shapely.Polygon(ring, [[(-0.5, -0.5), (0.5, -0.5), (0, 0.5)]])
    world.add_room("star", shape)
    edges = [
        shapely.LineString(pair)
        for each in (shape.exterior, *shape.interiors)
        for pair in zip(each.coords, each.coords[1:], strict=False)
    ]
    walk(world, *((dice.uniform(-8, 8), dice.uniform(-8, 8)) for _ in range(60)))
    found = world.rows(
        "select x_m, y_m, edge from semap.relation_change where map_id = %s and cause = 'moved'", world.map_id
    )
    assert len(found) > 40
    for x, y, edge in found:
        distances = [each.distance(shapely.Point(x, y)) for each in edges]
        assert distances[edge - 1] == min(distances) < 1e-6


OCTAGON = [(1, 0), (0.7, 0.7), (0, 1), (-0.7, 0.7), (-1, 0), (-0.7, -0.7), (0, -1), (0.7, -0.7)]
