import csv
from datetime import datetime, timedelta
from itertools import groupby, pairwise

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from semap_service.demo import record_doors
from semap_service.demo.record_walk import FOLDER, record
from shapely import LineString, Point, Polygon

from semap.formats.geojson import read_geojson
from semap.geometry.pose import transform_points
from semap.model.building import Building, Item

WALK = FOLDER / "walk.csv"
PEOPLE = ("ann", "bob", "eve")


@pytest.fixture(scope="module")
def office() -> Building:
    return read_geojson(FOLDER / "office.geojson")


@pytest.fixture(scope="module")
def tracks() -> dict[str, tuple[list[datetime], NDArray[np.float64]]]:
    """Stamps and positions (n, 2) [m] of each person."""
    with WALK.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        track: (
            [datetime.fromisoformat(row["stamp"]) for row in rows if row["track"] == track],
            np.array([(float(row["x_m"]), float(row["y_m"])) for row in rows if row["track"] == track]),
        )
        for track in sorted({row["track"] for row in rows})
    }


def rooms_of(office: Building) -> dict[str, Item]:
    return {item.name: item for item in office.items if item.concept == "Room"}


def line_of(door: Item) -> LineString:
    half_m = door.attributes["width_m"] / 2  # type: ignore[operator]
    return LineString(transform_points(door.pose.matrix(), [[-half_m, 0, 0], [half_m, 0, 0]])[:, :2])


def visited(office: Building, path: NDArray[np.float64]) -> list[str]:
    rooms = rooms_of(office)
    at = [next(name for name, room in rooms.items() if room.footprint.covers(Point(xy))) for xy in path]
    return [name for name, _ in groupby(at)]


def test_running_the_script_again_writes_the_same_bytes(office: Building) -> None:
    assert record(office).encode() == WALK.read_bytes()
    assert WALK.stat().st_size <= 100_000
    doors = record_doors.record(office, WALK.read_text().splitlines())
    assert doors.encode() == (FOLDER / "doors.csv").read_bytes()


def test_the_office_is_one_concave_hallway_with_five_rooms_around_it(office: Building) -> None:
    rooms = rooms_of(office)
    hallway = rooms.pop("hallway").footprint
    assert office.findings == ()
    assert len(rooms) == 5
    assert isinstance(hallway, Polygon)
    assert hallway.area < hallway.convex_hull.area
    whole = shapely.union_all([hallway, *(room.footprint for room in rooms.values())])
    assert whole.equals(shapely.box(0, 0, 14, 9.5))
    assert hallway.area + sum(room.footprint.area for room in rooms.values()) == pytest.approx(whole.area)
    doors = [item for item in office.items if item.concept == "Door"]
    assert {name for door in doors for name in door.joins} == {*rooms, "hallway"}
    for door in doors:
        for name in door.joins:
            footprint = hallway if name == "hallway" else rooms[name].footprint
            assert footprint.boundary.buffer(1e-9).contains(line_of(door))


def test_people_come_and_go_at_their_times(
    tracks: dict[str, tuple[list[datetime], NDArray[np.float64]]],
) -> None:
    assert tuple(tracks) == PEOPLE
    begin, end = tracks["ann"][0][0], tracks["ann"][0][-1]
    assert begin == datetime.fromisoformat("2026-01-05T09:00:00+00:00")
    assert timedelta(seconds=60) <= end - begin <= timedelta(seconds=90)
    assert tracks["bob"][0][0] - begin > timedelta(seconds=10)
    assert end - tracks["eve"][0][-1] > timedelta(seconds=10)
    for stamps, _ in tracks.values():
        assert {later - earlier for earlier, later in pairwise(stamps)} == {timedelta(seconds=0.1)}


@pytest.mark.parametrize("track", PEOPLE)
def test_people_walk_smoothly_and_no_faster_than_people_do(
    tracks: dict[str, tuple[list[datetime], NDArray[np.float64]]], track: str
) -> None:
    _, path = tracks[track]
    velocities_mps = np.diff(path, axis=0) / 0.1
    assert np.linalg.norm(velocities_mps, axis=1).max() <= 1.5
    # Positions are rounded to a millimetre, which alone can look like 0.2 m/s2.
    assert np.linalg.norm(np.diff(velocities_mps, axis=0) / 0.1, axis=1).max() <= 3.0
    assert (np.linalg.norm(velocities_mps, axis=1) == 0).sum() >= 90


@pytest.mark.parametrize("track", PEOPLE)
def test_people_pass_from_room_to_room_through_doors_only(
    office: Building, tracks: dict[str, tuple[list[datetime], NDArray[np.float64]]], track: str
) -> None:
    _, path = tracks[track]
    walls = shapely.union_all([room.footprint.boundary for room in rooms_of(office).values()])
    openings = shapely.union_all(
        [line_of(door).buffer(1e-6) for door in office.items if door.concept == "Door"]
    )
    assert not walls.difference(openings).intersects(LineString(path))
    assert len(visited(office, path)) >= 5


def test_everyone_visits_the_rooms_they_set_out_for(
    office: Building, tracks: dict[str, tuple[list[datetime], NDArray[np.float64]]]
) -> None:
    assert {track: visited(office, path) for track, (_, path) in tracks.items()} == {
        "ann": ["office_1", "hallway", "kitchen", "hallway", "office_2", "office_1"],
        "bob": ["hallway", "meeting_room", "hallway", "lab", "hallway", "office_2"],
        "eve": ["lab", "hallway", "kitchen", "hallway", "meeting_room", "hallway"],
    }
