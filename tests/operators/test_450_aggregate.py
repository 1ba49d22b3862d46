"""What is in what: containment closed over levels, held against shapely and a walk over the graph."""

from collections.abc import Iterator
from uuid import uuid4

import pytest
from furnishing import House, box, room, thing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import Point
from shapely import box as area
from sqlalchemy import text

from semap.model.building import Item, Storey
from semap.model.pose import Pose
from semap.store.database.connection import one_transaction

QUICK = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
CONTAINED = "select container_id, target_id, level, via_id, link from semap.contained_in({})"


@pytest.fixture
def house(database: str) -> Iterator[House]:
    with one_transaction(database, "semap_api") as connection:
        yield House(connection)


def chair(name: str, x_m: float, y_m: float, z_m: float = 0, **more: object) -> Item:
    return thing(name, box(0.4, 0.4, 0.9), Pose(x_m, y_m, z_m), concept="Chair", **more)


def test_rooms_with_more_than_five_chairs(house: House) -> None:
    house.put(
        room("hall", area(0, 0, 10, 4)),
        room("cell", area(10, 0, 12, 4)),
        room("above", area(0, 0, 10, 4), (3, 5.5)),
        *(chair(f"h{n}", 0.5 + n, 1) for n in range(6)),
        *(chair(f"c{n}", 10.5, 0.5 + n) for n in range(3)),
        chair("upstairs", 1, 1, 3),
        thing("table", box(1, 1, 0.7), Pose(5, 3), concept="Table"),
    )
    House(house.connection, "other").put(room("there", area(0, 0, 10, 4)), chair("alien", 1, 1))
    rooms = house.of("hall", "cell", "above")
    chairs = "semap.instances('house', 'Chair')"

    def counted(limits: str) -> dict[str, int]:
        rows = house.rows(
            f"select container_id, targets from semap.counted_in(:rooms, {chairs}, {limits})", rooms=rooms
        )
        return {name: count for id_, count in rows for name in house.named([id_])}

    assert counted("6") == {"hall": 6}
    assert counted("0") == {"hall": 6, "cell": 3, "above": 1}
    assert counted("1, 3") == {"cell": 3, "above": 1}
    everything = house.rows("select targets from semap.counted_in(:rooms)", rooms=house.of("hall"))
    assert everything == [(7,)]


def test_what_is_in_the_building_is_found_over_all_levels_and_once(house: House) -> None:
    house.put(
        room("building", area(0, 0, 20, 20), None, concept="Space"),
        room("ground", area(0, 0, 10, 10), (0, 3), concept="Space"),
        room("kitchen", area(1, 1, 5, 5), (0, 2.5)),
        room("porch", area(20, 0, 22, 4), (0, 2.5), storey="floor"),
        chair("inside", 2, 2),
        chair("outside", 30, 30),
        chair("on the porch", 21, 1),
        storeys=(Storey(uuid4(), "floor", 0),),
    )
    floor, building, cup = house.of("floor", "building", "inside")
    house.connection.execute(
        text("update semap.instance set storey_id = null where instance_id = :id"), {"id": building}
    )
    rows = house.rows(CONTAINED.format(":ids"), ids=house.of("building", "floor"))
    found = {
        (*(house.named([c]) | house.named([t])), level, *house.named([v]), link)
        for c, t, level, v, link in rows
    }
    assert len(rows) == len({row[:2] for row in rows}) == len(found)
    by_container = {
        container: {(*house.named([t]), level, link) for c, t, level, _, link in rows if c == container}
        for container in (building, floor)
    }
    assert by_container[building] == {
        ("ground", 1, "footprint"),
        ("kitchen", 1, "footprint"),
        ("inside", 1, "footprint"),
    }
    # its frame stands on that of its storey too; the chair is found in the room on it
    assert by_container[floor] == {("porch", 1, "frame"), ("on the porch", 2, "footprint")}

    house.connection.execute(
        text(
            "select semap.change_frame((select frame_id from semap.instance where instance_id = :chair),"
            " (select frame_id from semap.instance where instance_id = :porch))"
        ),
        {"chair": house.ids["outside"], "porch": house.ids["porch"]},
    )
    carried = house.rows(CONTAINED.format(":ids, :targets"), ids=[floor], targets=house.of("outside"))
    assert carried == [(floor, house.ids["outside"], 1, floor, "frame")]
    only = house.rows(CONTAINED.format(":ids, p_links => array['storey']"), ids=[floor])
    assert {(*house.named([t]), level) for _, t, level, *_ in only} == {("porch", 1)}
    assert cup not in {t for _, t, *_ in only}


def test_storeys_that_name_each_other_end(house: House) -> None:
    house.put(Item(uuid4(), "a", "Space"), Item(uuid4(), "b", "Space"), Item(uuid4(), "c", "Space"))
    a, b, c = house.of("a", "b", "c")
    for inner, outer in ((a, b), (b, c), (c, a)):
        house.connection.execute(
            text("update semap.instance set storey_id = :outer where instance_id = :inner"),
            {"inner": inner, "outer": outer},
        )
    assert {row[:3] for row in house.rows(CONTAINED.format(":ids"), ids=[a])} == {(a, c, 1), (a, b, 2)}


def test_what_lies_under_a_desk_of_a_room_is_not_therefore_in_the_room(house: House) -> None:
    house.put(
        room("study", area(0, 0, 4, 4)),
        room("hall", area(4, 0, 8, 4)),
        thing("desk", box(3, 1, 0.8), Pose(3.9, 2), concept="Table"),
        chair("chair", 4.5, 2, 0.1),
    )
    rows = house.rows(CONTAINED.format(":ids"), ids=house.of("study", "hall", "desk"))
    assert {(*house.named([c]), *house.named([t])) for c, t, *_ in rows} == {
        ("study", "desk"),
        ("hall", "chair"),
        ("desk", "chair"),
    }


@QUICK
@given(
    rooms=st.lists(
        st.tuples(*[st.integers(0, 6)] * 2, *[st.integers(1, 6)] * 2, st.integers(0, 2), st.integers(1, 2)),
        min_size=1,
        max_size=5,
    ),
    chairs=st.lists(st.tuples(*[st.integers(0, 24)] * 2, st.integers(0, 5)), max_size=6),
)
def test_direct_contents_are_those_of_shapely(house: House, rooms: list, chairs: list) -> None:
    areas = {
        f"r{n}": (area(x, y, x + w, y + d), low, low + high)
        for n, (x, y, w, d, low, high) in enumerate(rooms)
    }
    places = {f"c{n}": (x / 2, y / 2, z / 2) for n, (x, y, z) in enumerate(chairs)}
    with house.undone():
        house.put(
            *(room(name, shape, (low, high)) for name, (shape, low, high) in areas.items()),
            *(chair(name, *place) for name, place in places.items()),
        )
        points = {name: (Point(x, y), z + 0.45, 0.16) for name, (x, y, z) in places.items()} | {
            name: (shape.centroid, (low + high) / 2, shape.area) for name, (shape, low, high) in areas.items()
        }
        expected = {
            (container, name)
            for container, (shape, low, high) in areas.items()
            for name, (point, z_m, size_m2) in points.items()
            if name != container and shape.covers(point) and low <= z_m < high and size_m2 < shape.area - 1e-9
        }
        rows = house.rows(
            "select container_id, target_id, link from semap.direct_contents(:ids)", ids=house.of(*areas)
        )
        assert len(rows) == len(expected)
        assert {(*house.named([c]), *house.named([t])) for c, t, _ in rows} == expected
