"""Which rooms stairs and lifts join, whatever model they are of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import LineString, affinity, box

from semap.formats.ifc_boundary import Boundary, meetings
from semap.formats.ifc_passage import Place, joined_by_lift, joined_by_stair
from semap.model.building import HeightBand

STOREY_M = 3.0


def place(name: str, level: int, x_min: float, x_max: float, turn_deg: float = 0.0) -> Place:
    footprint = affinity.rotate(box(x_min, 0, x_max, 4), turn_deg, origin=(0, 0))
    return Place(name, footprint, HeightBand(level * STOREY_M, (level + 1) * STOREY_M), f"level {level}")


def corners(x_min: float, x_max: float, z_min: float, z_max: float) -> list[tuple[float, float, float]]:
    return [(x, y, z) for x in (x_min, x_max) for y in (1.0, 2.0) for z in (z_min, z_max)]


def steps(level: int, turn_deg: float = 0.0) -> NDArray[np.float64]:
    """A flight that begins in the west, at x = 4, and ends in the east, at x = 8, a storey above."""
    points = np.array(
        [
            corner
            for n in range(16)
            for corner in corners(
                4 + n / 4, 4.25 + n / 4, level * STOREY_M, (level + (n + 1) / 16) * STOREY_M
            )
        ]
    )
    turn = np.radians(turn_deg)
    points[:, :2] = points[:, :2] @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return points


@given(level=st.integers(-2, 5), turn_deg=st.floats(0, 360))
def test_a_stair_joins_the_rooms_at_its_foot_and_its_head(level: int, turn_deg: float) -> None:
    places = [
        place(f"{side} {n}", n, x_min, x_max, turn_deg)
        for n in range(-3, 8)
        for side, x_min, x_max in (("west", 0.0, 4.0), ("east", 8.0, 12.0))
    ]
    found = joined_by_stair(steps(level, turn_deg), places)
    assert found == tuple(sorted((f"west {level}", f"east {level + 1}")))


def test_a_stair_with_a_room_of_its_own_leads_out_of_it() -> None:
    well = Place("well", box(4, 0, 8.2, 4), HeightBand(0, 2 * STOREY_M), "level 0")
    upstairs = place("upstairs", 1, 8.2, 12)
    assert joined_by_stair(steps(0), [well, upstairs]) == ("upstairs", "well")


def test_a_stair_to_nowhere_joins_one_room_or_none() -> None:
    assert joined_by_stair(steps(0), [place("west", 0, 0, 4)]) == ("west",)
    assert joined_by_stair(steps(5), [place("west", 0, 0, 4)]) == ()


@pytest.mark.parametrize("is_shaft", [True, False])
def test_a_lift_joins_the_rooms_that_it_reaches_on_all_storeys(is_shaft: bool) -> None:
    car = np.array(corners(4.1, 5.9, 0, 2.2))
    places = [place(f"hall {n}", n, 0, 4) for n in range(4)] + [place(f"far {n}", n, 7, 9) for n in range(4)]
    if is_shaft:
        places += [place(f"shaft {n}", n, 4, 6) for n in range(4)]
    word = "shaft" if is_shaft else "hall"
    assert joined_by_lift(car, places) == tuple(f"{word} {n}" for n in range(4))


WALL = LineString([(0, 0), (4, 0)])


@pytest.mark.parametrize(
    ("other", "heights_m", "width_m"),
    [
        (WALL, (0, 2.6), 4),
        (LineString([(3, 0.1), (1, 0.1)]), (0, 2.6), 2),
        (LineString([(3, 0.2), (1, 0.2)]), (0, 2.6), None),
        (LineString([(3.8, 0), (9, 0)]), (0, 2.6), None),
        (LineString([(2, -1), (2, 1)]), (0, 2.6), None),
        (WALL, (2, 5), None),
        (WALL, (1, 2.6), 4),
    ],
)
def test_spaces_meet_where_their_virtual_boundaries_lie_at_one_place(
    other: LineString, heights_m: tuple[float, float], width_m: float | None
) -> None:
    found = list(meetings([Boundary(7, WALL, 0, 2.6), Boundary(3, other, *heights_m)]))
    assert [each.spaces for each in found] == ([] if width_m is None else [(3, 7)])
    assert [round(each.line.length, 6) for each in found] == ([] if width_m is None else [width_m])


def test_a_space_does_not_meet_itself() -> None:
    assert list(meetings([Boundary(7, WALL, 0, 2.6), Boundary(7, WALL, 0, 2.6)])) == []
    assert list(meetings([])) == []
