"""Leaves follow the map: where they are, which lines are theirs, and what an edit does to them."""

from __future__ import annotations

import json
import math

import numpy as np
import psycopg
import pytest
import shapely
from door_plan import SCAN_US, Door, DoorPlan
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from world import World

from semap.formats.door_leaf import LIMITS, OTHERWISE
from semap.store.database.connection import connect

DOORS = [
    Door("north", 2.0, 5.0, 0.0),
    Door("east", 7.0, 2.0, math.radians(-90), hinge="right", width_m=1.2, max_deg=175),
    Door("slanted", -3.0, -1.0, math.radians(217), hinge="right", max_deg=60),
]


@pytest.fixture
def plan(world: World) -> DoorPlan:
    return DoorPlan(world)


def shape_of(plan: DoorPlan, name: str) -> shapely.Geometry:
    return shapely.from_wkb(
        plan.world.one(
            "select st_asbinary(range_of_motion) from semap.door_leaf where instance_id = %s", plan.ids[name]
        )
    )


def leaves(plan: DoorPlan) -> set[str]:
    return {
        name
        for (name,) in plan.world.rows(
            "select name from semap.door_leaf join semap.instance using (instance_id)"
        )
    }


def test_the_range_of_motion_is_the_sector_around_the_hinge(planned: DoorPlan) -> None:
    for door in DOORS:
        found, expected = shape_of(planned, door.name), door.range_of_motion()
        assert shapely.is_valid(found)
        assert found.symmetric_difference(expected).area < 0.02 * expected.area
        for angle in np.radians(np.arange(-4, door.max_deg + 9, 1)):
            assert found.contains(
                shapely.LineString(door.leaf(angle, near_m=-0.05, far_m=door.width_m + 0.05))
            )
        ((x, y, closed, sense),) = planned.world.rows(
            "select hinge_x_m, hinge_y_m, closed_rad, sense from semap.door_leaf where instance_id = %s",
            planned.ids[door.name],
        )
        assert (x, y) == pytest.approx(door.hinge_m)
        assert math.cos(closed - door.closed_rad) == pytest.approx(1)
        assert sense == door.sense


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(DOORS), st.integers(-30, 190), st.integers(-30, 30), st.integers(-40, 130), st.integers(5, 130),
    st.booleans(), st.sampled_from([0.3, 1, 3]), st.sampled_from([2, 10, 40]),
)  # fmt: skip
def test_a_line_is_a_leaf_as_shapely_and_plain_arithmetic_say(
    planned: DoorPlan,
    door: Door,
    angle_deg,
    aside_cm,
    near_cm,
    length_cm,
    turned,
    angle_std_deg,
    offset_std_mm,
) -> None:
    # a little off whole numbers, so that nothing lies on an edge
    near_m, aside_m = near_cm / 100 + 0.00123, aside_cm / 100 + 0.00037
    far_m, angle, std_rad = (
        near_m + length_cm / 100 + 0.00041,
        math.radians(angle_deg + 0.013),
        math.radians(angle_std_deg),
    )
    ends = door.leaf(angle, near_m, far_m, aside_m)
    (x1, y1), (x2, y2) = reversed(ends) if turned else ends
    found = planned.world.rows(
        "select name, angle_rad, angle_std_rad, length_m from semap.leaves_seen(%s, %s, %s, %s, %s, null, %s, %s)"
        " join semap.instance using (instance_id)",
        planned.world.map_id, x1, y1, x2, y2, std_rad, offset_std_mm / 1000,
    )  # fmt: skip
    middle_m, length_m = (near_m + far_m) / 2, far_m - near_m
    # seen from behind its hinge, the line points the other way
    told = angle if middle_m > 0 else angle + math.pi
    told = math.remainder(told, 2 * math.pi)
    noise = math.sqrt((offset_std_mm / 1000) ** 2 + (middle_m * std_rad) ** 2 + 0.03**2)
    is_leaf = (
        door.range_of_motion().contains(shapely.LineString(ends))
        and angle_std_deg < 2
        and length_m >= max(0.25, 0.3 * door.width_m)
        and abs(middle_m) >= length_m / 2 - 0.12
        and abs(aside_m) <= min(0.15, 3 * noise)
        and math.radians(-15) <= told <= math.radians(door.max_deg + 15)
    )
    # the arc of the database is a polygon: lines that end within 5 mm of its edge may be on either side
    edge = door.range_of_motion().boundary
    if is_leaf != bool(found) and edge.distance(shapely.MultiPoint(ends)) < 0.005:
        return
    assert found == (
        [(door.name, pytest.approx(told), pytest.approx(std_rad), pytest.approx(length_m))] if is_leaf else []
    )


@pytest.fixture
def planned(plan: DoorPlan) -> DoorPlan:
    for door in DOORS:
        plan.add(door)
    return plan


def test_what_stands_about_a_closed_door_is_not_its_leaf(plan: DoorPlan) -> None:
    """The wall beside it and before it, the jamb, a leg in the range, a cupboard in the room behind."""
    door = plan.add(Door("d", 0.0, 0.08))
    clutter = [((-3, 0), (-0.45, 0)), ((0.45, 0), (3, 0)), ((-0.8, 0), (-0.46, 0)), ((0.46, 0), (0.8, 0)),
               ((-0.45, 0), (-0.45, 0.08)), ((-0.1, 0.5), (0.0, 0.55)), ((-0.2, 0.7), (0.3, 0.7)),
               ((0.3, 0.2), (0.3, 0.7)), ((-3, 0.0), (3, 0.0)), ((-0.45, -0.4), (-0.45, -1.2))]  # fmt: skip
    plan.observe((n * SCAN_US, a, b, None, 0.01, 0.005) for n, (a, b) in enumerate(clutter))
    assert plan.states() == []
    assert plan.late() == 0
    plan.observe(
        [door.seen(20 * SCAN_US, 0.01), *((20 * SCAN_US, a, b, None, 0.01, 0.005) for a, b in clutter)]
    )
    assert plan.states() == [("d", "closed", 20 * SCAN_US)]


def test_of_several_lines_in_one_scan_the_longest_is_the_leaf(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 0.0, 0.0))
    plan.observe([door.seen(1, math.radians(50), near_m=0.1, far_m=0.45), door.seen(1, math.radians(20))])
    state, angle = plan.present("d")
    assert (state, math.degrees(angle)) == ("open", pytest.approx(20))


def test_a_door_of_another_storey_or_map_does_not_match(plan: DoorPlan) -> None:
    ground = plan.add(Door("ground", 0.0, 0.0))
    plan.add(Door("upper", 0.0, 0.0, z_m=3.0))
    other = World(plan.world.dsn, "other")
    elsewhere = DoorPlan(other)
    elsewhere.add(Door("elsewhere", 0.0, 0.0))
    plan.observe([ground.seen(SCAN_US, 0.0, z_m=0.25)])
    assert [name for name, _, _ in plan.states()] == ["ground"]
    plan.observe([ground.seen(2 * SCAN_US, 0.0, z_m=3.25)])
    assert [name for name, _, _ in plan.states()] == ["ground", "upper"]
    assert elsewhere.states() == []
    plan.observe([ground.seen(3 * SCAN_US, 0.0)])
    assert plan.late() == 0
    other.close()


def test_two_sources_see_one_door(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 0.0, 0.0))
    second = plan.world.add_source("other laser")
    for n, angle in enumerate([0, 0, 5, 14, 30, 50, 72, 90]):
        plan.observe([door.seen((n + 1) * SCAN_US, math.radians(angle))], second if n % 2 else None)
    assert [state for _, state, _ in plan.states()] == ["closed", "opening", "open"]
    sources = plan.world.rows(
        "select n.name from semap.object_state join semap.source n using (source_id) order by stamp"
    )
    assert sources == [("tracker",), ("other laser",), ("other laser",)]
    with pytest.raises(psycopg.errors.CardinalityViolation, match="more than one source"):
        plan.world.run(
            "insert into semap.line_observation (source_id, stamp, x1_m, y1_m, x2_m, y2_m, angle_std_rad, offset_std_m, points)"
            " select s, now(), 0, 0, 1, 1, 0, 0, 5 from unnest(%s::int[]) s", [plan.world.source_id, second],
        )  # fmt: skip


def test_lines_of_no_source_or_that_are_not_finite_are_refused(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 0.0, 0.0))
    with pytest.raises(psycopg.errors.ForeignKeyViolation, match="no source 999"):
        plan.observe([door.seen(1, 0.0)], 999)
    for broken in ((1, (math.nan, 0), (1, 0), None, 0.1, 0.1), (1, (0, 0), (0, 0), None, 0.1, 0.1), (1, (0, 0), (1, 0), math.inf, 0.1, 0.1),
                   (1, (0, 0), (1, 0), None, math.nan, 0.1)):  # fmt: skip
        with pytest.raises(psycopg.errors.CheckViolation):
            plan.observe([broken])
    plan.observe([])
    assert plan.states() == []


def test_late_lines_are_kept_and_counted(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 0.0, 0.0))
    plan.observe([door.seen(10 * SCAN_US, 0.0)])
    plan.observe([door.seen(5 * SCAN_US, 1.0), door.seen(10 * SCAN_US, 1.0), door.seen(11 * SCAN_US, 0.0)])
    assert plan.states() == [("d", "closed", 10 * SCAN_US)]
    assert plan.late() == 2
    assert plan.world.one("select count(*) from semap.line_observation") == 4
    plan.world.run("delete from semap.source where source_id = %s", plan.world.source_id)
    assert plan.world.one("select count(*) from semap.line_observation") == 0


def test_a_door_that_was_moved_is_seen_where_it_is_now(plan: DoorPlan) -> None:
    before = plan.add(Door("d", 0.0, 0.0))
    plan.observe([before.seen(SCAN_US, math.radians(90))])
    plan.world.run("update semap.frame_pose set x_m = 10, y_m = 1, qz = sin(0.25), qw = cos(0.25)"
                   " from semap.frame f where f.frame_id = frame_pose.frame_id and f.name = 'd'")  # fmt: skip
    after = Door("d", 10.0, 1.0, 0.5)
    assert shape_of(plan, "d").symmetric_difference(after.range_of_motion()).area < 0.02
    assert plan.present("d") == (None, None)
    plan.observe([before.seen(2 * SCAN_US, 0.0)])
    assert plan.present("d") == (None, None)
    plan.observe([after.seen(3 * SCAN_US, 0.0)])
    assert plan.states() == [("d", "open", SCAN_US), ("d", "closed", 3 * SCAN_US)]
    # below another frame, and that one moved
    cart = plan.world.one("insert into semap.frame (map_id, name, parent_id) values (%s, 'cart', %s) returning frame_id",
                          plan.world.map_id, plan.world.frame_id)  # fmt: skip
    plan.world.run("insert into semap.frame_pose (frame_id, x_m) values (%s, 2)", cart)
    plan.world.run("update semap.frame set parent_id = %s where name = 'd'", cart)
    assert shape_of(plan, "d").symmetric_difference(Door("d", 12.0, 1.0, 0.5).range_of_motion()).area < 0.02
    plan.world.run("update semap.frame_pose set x_m = 3 where frame_id = %s", cart)
    assert shape_of(plan, "d").symmetric_difference(Door("d", 13.0, 1.0, 0.5).range_of_motion()).area < 0.02


def test_an_edit_elsewhere_leaves_the_state(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 0.0, 0.0))
    plan.observe([door.seen(SCAN_US, math.radians(90))])
    plan.world.run("update semap.instance set alias = 'gate', updated_at = now() where name = 'd'")
    plan.world.run("insert into semap.concept (name) values ('Portal')")
    plan.world.run("update semap.frame_pose set x_m = x_m")
    assert plan.present("d") == ("open", pytest.approx(math.radians(90)))


def test_a_leaf_comes_and_goes_with_the_attribute_the_concept_and_the_instance(plan: DoorPlan) -> None:
    plan.add(Door("d", 0.0, 0.0))
    assert leaves(plan) == {"d"}
    for attributes, there in (({"width_m": 0.9}, set()), ({"leaf": "left"}, set()), ({"width_m": 0.9, "leaf": "right"}, {"d"}),
                              ({"leaf": {"hinge": "left", "width_m": 0.8}}, {"d"}), ({"leaf": None, "width_m": 1}, set()),
                              ({"leaf": "left", "width_m": "wide"}, set()), ({"leaf": "left", "width_m": 1}, {"d"})):  # fmt: skip
        plan.set_attributes("d", attributes)
        assert leaves(plan) == there, attributes
    concept = "update semap.instance set concept_id = (select concept_id from semap.concept where name = %s)"
    for name, there in (("Opening", set()), ("Window", set()), ("Door", {"d"})):
        plan.world.run(concept, name)
        assert leaves(plan) == there
    plan.world.run("insert into semap.concept (name) values ('Gate')")
    plan.world.run(concept, "Gate")
    assert leaves(plan) == set()
    plan.world.run("insert into semap.concept_parent select g.concept_id, d.concept_id from semap.concept g, semap.concept d"
                   " where g.name = 'Gate' and d.name = 'Door'")  # fmt: skip
    assert leaves(plan) == {"d"}
    plan.world.run("delete from semap.instance where name = 'd'")
    assert leaves(plan) == set()
    assert plan.world.one("select count(*) from semap.door_now") == 0


def test_what_becomes_a_door_with_a_wrong_leaf_has_none(plan: DoorPlan) -> None:
    """Whoever edits the concepts is not to blame for what was said of things that were no doors."""
    plan.world.run("insert into semap.concept (name) values ('Gate')")
    for number, (leaf, _) in enumerate(WRONG):
        plan.world.run("insert into semap.instance (map_id, name, concept_id, frame_id, attributes)"
                       " select %s, %s, concept_id, %s, %s from semap.concept where name = 'Gate'",
                       plan.world.map_id, f"gate {number}", plan.world.frame_id,
                       json.dumps({"width_m": 1, "leaf": leaf}))  # fmt: skip
    plan.world.run("insert into semap.concept_parent select g.concept_id, d.concept_id from semap.concept g, semap.concept d"
                   " where g.name = 'Gate' and d.name = 'Door'")  # fmt: skip
    plan.world.run("update semap.frame_pose set x_m = 1")
    assert leaves(plan) == set()


def test_with_a_map_goes_what_was_seen_of_its_doors(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 0.0, 0.0))
    plan.observe([door.seen(SCAN_US, 0.0)])
    a, b = plan.world.add_track("a"), plan.world.add_track("b")
    plan.world.run("insert into semap.track_amendment (track_id, other_track_id, kind, since, found)"
                   " values (%s, %s, 'merged', now(), now())", a, b)  # fmt: skip
    plan.world.run("delete from semap.map where map_id = %s", plan.world.map_id)
    for table in ("door_leaf", "door_now", "line_observation", "object_state", "track_amendment"):
        assert plan.world.one(f"select count(*) from semap.{table}") == 0, table


def test_a_door_is_as_wide_and_high_as_its_shape_where_nothing_else_says(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 4.0, 2.0, math.radians(90)))
    plan.set_attributes("d", {"leaf": "left"})
    assert leaves(plan) == set()
    description = plan.world.one(
        "insert into semap.description (map_id) values (%s) returning description_id", plan.world.map_id
    )
    plan.world.run(
        "insert into semap.abstraction (description_id, type, geometry, z_min_m, z_max_m)"
        " select %s, t, %s, 0.1, 2.2 from unnest(array['Footprint', 'FootprintHull']) t",
        description, shapely.to_wkb(shapely.box(0, 0.1, 1.1, 0.14), hex=True),
    )  # fmt: skip
    plan.world.run("update semap.instance set relative_description_id = %s where name = 'd'", description)
    ((x, y, width, low, high),) = plan.world.rows(
        "select hinge_x_m, hinge_y_m, width_m, z_min_m, z_max_m from semap.door_leaf"
    )
    assert (x, y, width, low, high) == pytest.approx((door.x_m - 0.12, door.y_m, 1.1, 0.1, 2.2))
    plan.world.run("update semap.abstraction set geometry = %s where description_id = %s",
                   shapely.to_wkb(shapely.box(-0.4, 0, 0.4, 0.1), hex=True), description)  # fmt: skip
    assert plan.world.one("select width_m from semap.door_leaf") == pytest.approx(0.8)
    plan.set_attributes("d", {"leaf": {"hinge": "left", "at": [0.3, 0.06]}, "width_m": 0.8})
    ((x, y),) = plan.world.rows("select hinge_x_m, hinge_y_m from semap.door_leaf")
    assert (x, y) == pytest.approx((4.0 - 0.06, 2.0 + 0.3 - 0.4))


def test_undo_brings_a_leaf_back(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 0.0, 0.0))
    plan.observe([door.seen(SCAN_US, 0.0)])
    shape = shape_of(plan, "d")
    plan.set_attributes("d", {"width_m": 0.9})
    assert leaves(plan) == set()
    (change_set,) = plan.world.rows("select max(change_set_id) from semap.change_set")[0]
    plan.world.run("begin")
    plan.world.run("select semap.undo_change_set(%s)", change_set)
    plan.world.run("commit")
    assert shape_of(plan, "d").equals(shape)
    plan.observe([door.seen(2 * SCAN_US, math.radians(90))])
    assert plan.states()[-1] == ("d", "open", 2 * SCAN_US)
    plan.world.run("delete from semap.instance where name = 'd'")
    (change_set,) = plan.world.rows("select max(change_set_id) from semap.change_set")[0]
    plan.world.run("select semap.undo_change_set(%s)", change_set)
    assert shape_of(plan, "d").equals(shape)


WRONG = [
    ("middle", "neither left nor right"), (7, "neither a side nor a mapping"), ([], "neither a side nor a mapping"),
    ({}, "neither left nor right"), ({"hinge": "left", "widht_m": 1}, "no widht_m"),
    ({"hinge": "left", "max_deg": "90"}, "max_deg is no number from 10 to 180"),
    ({"hinge": "left", "max_deg": 5}, "max_deg is no number"), ({"hinge": "left", "max_deg": None}, "max_deg is no number"),
    ({"hinge": "left", "at": [1]}, "no point"), ({"hinge": "left", "at": "here"}, "no point"),
    ({"hinge": "left", "at": [1, "2"]}, "no point"), ({"hinge": "left", "at": [1, 1e9]}, "no point"),
    ({"hinge": "left", "closed_below_deg": 12}, "do not rise"), ({"hinge": "left", "opening_above_deg": 20, "max_deg": 15}, "do not rise"),
]  # fmt: skip


def test_a_wrong_leaf_is_refused_with_its_remedy(plan: DoorPlan) -> None:
    plan.add(Door("d", 0.0, 0.0))
    for number, (leaf, fault) in enumerate(WRONG):
        with pytest.raises(
            psycopg.errors.CheckViolation, match=f"The leaf of d is wrong: .*{fault}"
        ) as refused:
            plan.set_attributes("d", {"width_m": 0.9, "leaf": leaf})
        assert "leaf: left" in refused.value.diag.message_hint
        # what has no leaf may say of one what it likes
        plan.world.run("insert into semap.instance (map_id, name, concept_id, frame_id, attributes)"
                       " select %s, %s, concept_id, %s, %s from semap.concept where name = 'Table'",
                       plan.world.map_id, f"table {number}", plan.world.frame_id, json.dumps({"leaf": leaf}))  # fmt: skip


def test_maps_and_the_database_agree_on_what_a_leaf_may_say(world: World) -> None:
    numbers = world.rows("select key, low, high, otherwise from semap.leaf_numbers()")
    assert {key: (low, high) for key, low, high, _ in numbers} == LIMITS
    assert OTHERWISE.items() <= {key: otherwise for key, *_, otherwise in numbers}.items()


def test_the_ingest_role_writes_lines_and_nobody_else_does(plan: DoorPlan) -> None:
    door = plan.add(Door("d", 0.0, 0.0))
    (near, far) = door.leaf(0.0)
    insert = (
        "insert into semap.line_observation (source_id, stamp, x1_m, y1_m, x2_m, y2_m, angle_std_rad, offset_std_m, points)"
        f" values ({plan.world.source_id}, to_timestamp(1), {near[0]}, {near[1]}, {far[0]}, {far[1]}, 0.01, 0.01, 9)"
    )
    for role in ("semap_api", "semap_worker", "semap_read"):
        with connect(plan.world.dsn, role) as connection, pytest.raises(psycopg.errors.InsufficientPrivilege):
            connection.execute(insert)
    with connect(plan.world.dsn, "semap_ingest") as connection:
        connection.execute(insert)
        for forbidden in (
            "update semap.door_now set state = 'open'",
            "delete from semap.door_leaf",
            "delete from semap.line_observation",
        ):
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                connection.execute(forbidden)
    assert plan.states() == [("d", "closed", 1_000_000)]
    with connect(plan.world.dsn, "semap_api") as connection:
        connection.execute("delete from semap.instance where name = 'd'")
