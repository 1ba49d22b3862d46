"""The floor: what the experiment needs of it, and that semap imports its map."""

import math
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely
from semap_ingest.simulation.floor import (
    BASE_FROM_LASER_M,
    HALLWAY,
    ROBOT,
    WALL_M,
    office_floor,
    office_map_text,
)
from semap_ingest.simulation.laser_view import ANGLE_STEP_RAD, LaserView
from semap_ingest.simulation.map_folder import write_map
from semap_ingest.simulation.moment import Moment
from semap_service.cli import main

from semap.formats.yaml_map import read_map

FLOOR = office_floor()
WATCHED = [door for door in FLOOR.doors.values() if door.is_watched]


def test_hallway_is_concave_and_there_are_rooms_enough() -> None:
    assert len(FLOOR.rooms) == 10
    assert all(room.is_valid for room in FLOOR.rooms.values())
    assert FLOOR.hallway.convex_hull.area > 1.2 * FLOOR.hallway.area


def test_rooms_are_parted_by_walls() -> None:
    for first, second in combinations(FLOOR.rooms, 2):
        least_m = WALL_M if HALLWAY in (first, second) else 0.12
        assert FLOOR.rooms[first].distance(FLOOR.rooms[second]) > least_m - 0.002


def test_robot_watches_six_doors_and_two_openings_from_near_and_not_at_a_graze() -> None:
    assert sorted(door.hinge is not None for door in WATCHED) == [False] * 2 + [True] * 6
    for door in WATCHED:
        away = np.array(door.position_m) - ROBOT[:2]
        distance_m = np.hypot(*away)
        inwards = door.to_map(np.array([[0.0, 1.0]]))[0] - door.position_m
        assert 2.5 < distance_m < 7
        assert math.degrees(math.asin(away @ inwards / distance_m)) > 45


@pytest.mark.parametrize("door", FLOOR.doors.values(), ids=lambda door: door.name)
def test_door_stands_in_the_middle_of_its_wall(door) -> None:
    """Leaf set back by 9 cm on both sides, in neither footprint."""
    points = shapely.points(door.to_map(np.array([[0.0, -0.091], [0.0, -0.089], [0.0, 0.089], [0.0, 0.091]])))
    assert FLOOR.hallway.covers(points).tolist() == [True, False, False, False]
    assert FLOOR.rooms[door.room].covers(points).tolist() == [False, False, False, True]
    assert door.gap.intersection(FLOOR.hallway.union(FLOOR.rooms[door.room])).area < 0.002 * 2


@pytest.mark.parametrize("degrees", [0, 45, 90, 96])
def test_leaf_swings_about_its_hinge_into_the_room(degrees: int) -> None:
    for door in FLOOR.leaf_doors:
        hinge, tip = door.leaf_m(math.radians(degrees))
        assert np.hypot(*(tip - hinge)) == pytest.approx(door.width_m)
        closed = door.leaf_m(0.0)[1] - hinge
        turned = math.atan2(
            *np.flip([closed @ (tip - hinge), closed[0] * (tip - hinge)[1] - closed[1] * (tip - hinge)[0]])
        )
        assert turned * -door.hinge_sign == pytest.approx(math.radians(degrees))
        if degrees:
            assert FLOOR.rooms[door.room].distance(shapely.Point(tip)) < 1e-9


def test_no_leaf_meets_a_wall() -> None:
    for door in FLOOR.leaf_doors:
        for degrees in range(0, 97, 4):
            leaf = shapely.LineString(door.leaf_m(math.radians(degrees)))
            assert FLOOR.free.covers(leaf), (door.name, degrees)


def test_laser_sees_open_leaves_through_their_doorways() -> None:
    """At least six beams on each; only the beams that end within 1 cm of the leaf are counted."""
    opened = {door.name: math.pi / 2 for door in FLOOR.leaf_doors}
    moment = Moment(0.0, ROBOT, opened, ())
    ranges_m = LaserView(FLOOR).sweep(moment, moment).true_m
    angles = ROBOT[2] - math.radians(135) + ANGLE_STEP_RAD * np.arange(811)
    place = np.array([ROBOT[0], ROBOT[1] + BASE_FROM_LASER_M[0]])
    ends = shapely.points(place + ranges_m[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))
    for door in WATCHED:
        if door.hinge:
            leaf = shapely.LineString(door.leaf_m(math.pi / 2))
            assert (shapely.distance(leaf, ends) < 0.01).sum() >= 6, door.name


def test_surfaces_are_walls_lintels_and_leaves() -> None:
    closed, opened = FLOOR.surfaces({}), FLOOR.surfaces({"Door01": 1.0})
    assert len(closed.segments_m) == len(FLOOR.fixed.segments_m) + 8
    differs = np.flatnonzero((closed.segments_m != opened.segments_m).any(axis=(1, 2)))
    assert differs.tolist() == [len(FLOOR.fixed.segments_m)]
    assert closed.z_m.min() == 0
    assert closed.z_m.max() == 2.6
    assert (closed.z_m[:, 0] < closed.z_m[:, 1]).all()


def test_map_imports(database: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    written = write_map(tmp_path / "map")
    monkeypatch.setenv("SEMAP_DSN", database)
    monkeypatch.setattr("sys.argv", ["semap", "map", "import", str(written.parent)])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert not ended.value.code, printed.err
    assert "1 Hallway" in printed.out
    assert "9 Room" in printed.out
    assert "10 Door" in printed.out


def test_both_forms_of_the_map_say_the_same(tmp_path: Path) -> None:
    (tmp_path / "office.yaml").write_text(office_map_text())
    short, meshed = read_map(tmp_path / "office.yaml"), read_map(write_map(tmp_path / "map").parent)
    assert short.instances == meshed.instances or {each.name for each in short.instances} == {
        each.name for each in meshed.instances
    }
    assert short.frames == meshed.frames
