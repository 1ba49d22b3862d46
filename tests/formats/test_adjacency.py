import pytest
import shapely
from shapely import LineString, Point, box

from semap.formats.adjacency import Floor, joined_rooms

WEST, EAST = box(0, 0, 4, 3), box(4.2, 0, 8, 3)
NORTH = box(4.2, 3.1, 8, 6)


@pytest.mark.parametrize(
    "opening",
    [
        box(4.0, 1, 4.2, 2),
        box(3.95, 1, 4.25, 2),
        LineString([(4.1, 1), (4.1, 2)]),
        LineString([(4.1, 2), (4.1, 1.5), (4.1, 1)]),
        Point(4.1, 1.5),
    ],
)
@pytest.mark.parametrize("turn_deg", [0, 33, 90, 200])
def test_a_door_joins_the_rooms_on_its_two_sides(opening: shapely.Geometry, turn_deg: float) -> None:
    rooms = {"west": WEST, "east": EAST, "far": box(9, 0, 12, 3)}
    turned = {name: shapely.affinity.rotate(room, turn_deg, origin=(0, 0)) for name, room in rooms.items()}
    door = shapely.affinity.rotate(opening, turn_deg, origin=(0, 0))
    assert joined_rooms(door, Floor(turned)) == ("east", "west")


def test_a_room_beyond_the_doors_end_is_not_joined() -> None:
    door = box(4.0, 1.99, 4.2, 2.99)
    assert joined_rooms(door, Floor({"west": WEST, "east": EAST, "north": NORTH})) == ("east", "west")


def test_a_door_to_the_outside_joins_one_room() -> None:
    assert joined_rooms(LineString([(1, 0), (2, 0)]), Floor({"west": WEST, "east": EAST})) == ("west",)


def test_the_room_that_fills_more_of_a_side_is_joined() -> None:
    rooms = {"west": WEST, "low": box(4.2, 0, 8, 1.3), "high": box(4.2, 1.3, 8, 3)}
    assert joined_rooms(LineString([(4.1, 1), (4.1, 2)]), Floor(rooms)) == ("high", "west")


def test_an_opening_within_one_room_joins_it_alone_and_one_far_away_none() -> None:
    assert joined_rooms(LineString([(1, 1), (2, 1)]), Floor({"west": WEST, "east": EAST})) == ("west",)
    assert joined_rooms(LineString([(20, 1), (21, 1)]), Floor({"west": WEST, "east": EAST})) == ()
    assert joined_rooms(Point(20, 1), Floor({"west": WEST})) == ()
