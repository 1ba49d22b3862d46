"""Ways through doors, held against networkx on random buildings."""

from collections.abc import Iterator
from itertools import pairwise
from uuid import uuid4

import networkx as nx
import numpy as np
import pytest
from furnishing import House, box, room, thing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import box as area

from semap.model.building import Item, Storey
from semap.model.pose import Pose
from semap.store.database.connection import one_transaction

QUICK = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
ROUTE = "select step, room, door, length_m, total_m from semap.route(:a, :b, cast(:closed as jsonb))"


@pytest.fixture
def house(database: str) -> Iterator[House]:
    with one_transaction(database, "semap_api") as connection:
        yield House(connection)


def door(
    name: str, x_m: float, y_m: float, joins: tuple[str, ...], z_m: float = 0, **attributes: object
) -> Item:
    return thing(
        name, box(0.2, 0.2, 2), Pose(x_m, y_m, z_m), concept="Door", attributes=attributes, joins=joins
    )


def test_the_shorter_way_is_taken_and_its_doors_are_named(house: House) -> None:
    house.put(
        room("a", area(0, 0, 4, 4)),
        room("b", area(4, 0, 8, 4)),
        room("c", area(8, 0, 12, 4)),
        room("attic", area(0, 0, 1, 1)),
        door("a-b", 4, 2, ("a", "b")),
        door("b-c", 8, 2, ("b", "c")),
        door("b-c far", 8, 0, ("b", "c")),
        door("a-c round", 4, 40, ("a", "c")),
        door("outside", 0, 2, ("a",)),
        door("a-b locked", 4, 2.5, ("a", "b"), locked=True),
    )
    a, c, attic = house.of("a", "c", "attic")
    assert house.rows(ROUTE, a=a, b=c, closed=None) == [
        (0, "a", None, 0, 8),
        (1, "b", "a-b", 2, 8),
        (2, "c", "b-c", 6, 8),
    ]
    assert house.rows(ROUTE, a=a, b=attic, closed=None) == []
    assert house.rows(ROUTE, a=a, b=a, closed=None) == [(0, "a", None, 0, 0)]
    assert [row[2] for row in house.rows(ROUTE, a=a, b=c, closed='{"locked": true}')] == [None, "a-b", "b-c"]
    rows = house.rows("select room, doors, total_m from semap.reachable(:a)", a=a)
    assert sorted(rows) == [("b", 1, 4), ("c", 2, 8)]
    pairs = house.rows(
        "select target_id, door_id from semap.joined(:a, p_closed => '{\"locked\": true}')", a=[a]
    )
    assert {(*house.named([b]), *house.named([d])) for b, d in pairs} == {("b", "a-b"), ("c", "a-c round")}


def test_a_closed_door_is_walked_round(house: House) -> None:
    house.put(
        room("a", area(0, 0, 4, 4)),
        room("b", area(4, 0, 8, 4)),
        door("near", 4, 2, ("a", "b"), state="closed"),
        door("far", 4, 12, ("a", "b")),
    )
    a, b = house.of("a", "b")
    assert [row[2] for row in house.rows(ROUTE, a=a, b=b, closed=None)] == [None, "near"]
    assert [row[2] for row in house.rows(ROUTE, a=a, b=b, closed='{"state": "closed"}')] == [None, "far"]
    assert house.rows(ROUTE, a=b, b=a, closed="{}") == []


def test_stairs_cost_their_height_and_rooms_without_a_shape_are_where_their_frame_is(house: House) -> None:
    house.put(
        room("low", area(0, 0, 4, 4), (0, 2.5), storey="ground"),
        room("high", area(0, 0, 4, 4), (3, 5.5), storey="first"),
        Item(uuid4(), "stairs", "Space", pose=Pose(4, 4, 0)),
        door("below", 2, 2, ("low", "stairs")),
        door("up", 2, 2, ("stairs", "high"), z_m=3),
        storeys=(Storey(uuid4(), "ground", 0), Storey(uuid4(), "first", 3)),
    )
    low, high, stairs = house.of("low", "high", "stairs")
    assert house.rows(ROUTE, a=low, b=high, closed=None) == [
        (0, "low", None, 0, 3),
        (1, "stairs", "below", 0, 3),
        (2, "high", "up", 3, 3),
    ]
    assert house.rows(ROUTE, a=low, b=stairs, closed=None)[-1][-1] == pytest.approx(np.sqrt(8))


@QUICK
@given(
    places=st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=2, max_size=7),
    doors=st.lists(
        st.tuples(*[st.integers(0, 20)] * 2, st.sets(st.integers(0, 6), max_size=3), st.booleans()),
        max_size=10,
    ),
    closed=st.booleans(),
)
def test_routes_are_those_of_networkx(house: House, places: list, doors: list, closed: bool) -> None:
    rooms = {f"r{n}": place for n, place in enumerate(places)}
    known = {
        f"d{n}": ((x, y), tuple(f"r{r}" for r in sorted(joins) if f"r{r}" in rooms), shut)
        for n, (x, y, joins, shut) in enumerate(doors)
    }
    with house.undone():
        house.put(
            *(room(name, area(x - 1, y - 1, x + 1, y + 1)) for name, (x, y) in rooms.items()),
            *(door(name, x, y, joins, shut=shut) for name, ((x, y), joins, shut) in known.items()),
        )
        passable = {name: each for name, each in known.items() if not (closed and each[2])}
        graph = nx.Graph()
        graph.add_nodes_from(("room", name) for name in rooms)
        for name, (place, joins, _) in passable.items():
            for joined in joins:
                graph.add_edge(("room", joined), ("side", name, joined), weight=_apart(rooms[joined], place))
        for name, (place, joins, _) in passable.items():
            sides = [("side", name, joined) for joined in joins]
            graph.add_edges_from(((a, b) for a in sides for b in sides if a != b), weight=0)
            for other, (there, others, _) in passable.items():
                for joined in set(joins) & set(others) if other != name else ():
                    graph.add_edge(
                        ("side", name, joined), ("side", other, joined), weight=_apart(place, there)
                    )
        start = ("room", "r0")
        # one does not walk through the middle of a room that one only passes
        for name in rooms:
            inner = graph.subgraph([n for n in graph if n[0] == "side" or n in (start, ("room", name))])
            rows = house.rows(
                ROUTE, a=house.ids["r0"], b=house.ids[name], closed='{"shut": true}' if closed else None
            )
            if not nx.has_path(inner, start, ("room", name)):
                assert rows == []
                continue
            length_m = nx.shortest_path_length(inner, start, ("room", name), weight="weight")
            assert rows[-1][4] == pytest.approx(length_m, abs=1e-9)
            _assert_leads(rows, rooms, passable, name)
        reached = dict(
            house.rows(
                "select room, total_m from semap.reachable(:a, cast(:closed as jsonb))",
                a=house.ids["r0"],
                closed='{"shut": true}' if closed else None,
            )
        )
        assert set(reached) == {n[1] for n in nx.node_connected_component(graph, start) if n[0] == "room"} - {
            "r0"
        }


def _apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))


def _assert_leads(rows: list, rooms: dict, doors: dict, goal: str) -> None:
    """The rows are a way: each door joins the rooms before and after it, and the lengths add up."""
    assert [row[0] for row in rows] == list(range(len(rows)))
    assert (rows[0][1], rows[-1][1]) == ("r0", goal)
    place, length_m = rooms["r0"], 0.0
    for (_, before, *_), (_, after, name, so_far_m, _) in pairwise(rows):
        assert {before, after} <= set(doors[name][1])
        length_m += _apart(place, doors[name][0])
        place = doors[name][0]
        assert so_far_m == pytest.approx(length_m, abs=1e-9)
    assert rows[-1][4] == pytest.approx(
        length_m + (_apart(place, rooms[goal]) if len(rows) > 1 else 0), abs=1e-9
    )
