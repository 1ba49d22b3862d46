"""How probable a relation is that holds: against random positions around where the track is."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy import special
from stateful_oracle import Sample
from world import SECOND_US, World

from semap.store.database.connection import connect, open_engine
from semap.store.relation.probability import probabilities
from semap.store.relation.relations import list_relations

ELL = shapely.Polygon([(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)])
HOLED = shapely.Polygon(shapely.box(10, 0, 14, 4).exterior, [shapely.box(11, 1, 13, 3).exterior])
SAMPLES = 200_000
WITHIN = 5 * np.sqrt(0.25 / SAMPLES)
CERTAIN = {"enter_probability": 0.9, "leave_probability": 0.1, "widest_std_m": 10.0}


def be_certain(world: World, **more: object) -> None:
    for_all = {**more, **CERTAIN}
    columns = ", ".join(f"{name} = %s" for name in for_all)
    world.run(
        f"update semap.continuous_query set {columns} where query_id = %s", *for_all.values(), world.query_id
    )


def at(
    world: World,
    name: str,
    second: int,
    x_m: float,
    y_m: float,
    std_m: float | None,
    z_m: float | None = None,
) -> int:
    track = (
        world.one("select track_id from semap.track where name = %s", name)
        if second > 1
        else world.add_track(name)
    )
    world.add_samples(track, [Sample(second * SECOND_US, x_m, y_m, z_m, std_m)])
    return track


def told(world: World, track: int, room: str) -> float | None:
    return world.one(
        "select semap.relation_probability(%s, (select region_id from semap.region where instance_name = %s))", track, room
    )  # fmt: skip


@pytest.fixture
def rooms(world: World) -> World:
    world.add_room("ell", ELL)
    world.add_room("holed", HOLED, (0.0, 2.5))
    return world


def test_it_is_the_share_of_random_positions_that_lie_inside(rooms: World) -> None:
    be_certain(rooms)
    dice = np.random.default_rng(20260131)
    shapes = {"ell": ELL, "holed": HOLED}
    for n in range(60):
        x_m, y_m, std_m = (
            dice.uniform(-1, 15),
            dice.uniform(-1, 7),
            float(np.float32(dice.choice([0.1, 0.5, 1.5]))),
        )
        track = at(rooms, f"t{n}", 1, x_m, y_m, std_m)
        points = dice.normal((x_m, y_m), std_m, (SAMPLES, 2))
        for room, shape in shapes.items():
            share = shapely.contains_xy(shape, points).mean()
            assert told(rooms, track, room) == pytest.approx(share, abs=WITHIN), (room, x_m, y_m, std_m)


def test_it_is_of_where_the_track_is_now(rooms: World) -> None:
    be_certain(rooms)
    shown = "select query, track, instance, probability from semap.relation_certainty"
    track = at(rooms, "a", 1, 1.5, 5.5, 0.5)
    edges = special.ndtr((3 - 1.5) / 0.5) - special.ndtr((0 - 1.5) / 0.5), special.ndtr((6 - 5.5) / 0.5)
    assert rooms.rows(shown) == [("track_in_room", "a", "ell", pytest.approx(edges[0] * edges[1], abs=1e-6))]
    at(rooms, "a", 2, 1.5, 6.0, 0.5)  # on the wall, and still believed to be inside
    assert rooms.rows(shown) == [("track_in_room", "a", "ell", pytest.approx(edges[0] * 0.5, abs=1e-6))]
    at(rooms, "a", 3, 1.5, 8.0, 0.5)
    assert rooms.rows(shown) == []
    assert told(rooms, track, "ell") == pytest.approx(edges[0] * special.ndtr(-4), abs=1e-6)
    rooms.end_track(track, 4 * SECOND_US)
    assert told(rooms, track, "ell") is None


def test_without_a_deviation_and_by_its_height_it_is_one_or_nothing(rooms: World) -> None:
    be_certain(rooms)
    assert told(rooms, at(rooms, "known", 1, 1.0, 1.0, None), "ell") == 1
    assert told(rooms, at(rooms, "on the wall", 1, 0.0, 1.0, None), "ell") == 0
    assert told(rooms, at(rooms, "above", 1, 10.5, 0.5, 0.1, 3.0), "holed") == 0
    assert told(rooms, at(rooms, "beside", 1, 10.5, 0.5, 0.1, 1.0), "holed") == pytest.approx(1, abs=1e-5)


def test_a_query_that_asks_for_no_certainty_has_none(rooms: World) -> None:
    track = at(rooms, "a", 1, 1.0, 1.0, 0.5)
    assert told(rooms, track, "ell") is None
    assert rooms.rows("select * from semap.relation_certainty") == []


def test_of_many_at_once_it_is_the_same(rooms: World) -> None:
    be_certain(rooms)
    tracks = [at(rooms, f"t{n}", 1, 0.5 + n / 4, 1.0, 0.5) for n in range(4)]
    engine = open_engine(rooms.dsn, "semap_read", size=1)
    with engine.begin() as connection:
        asked = list_relations(connection)
        found = probabilities(connection, asked)
        assert probabilities(connection, []) == {}
    engine.dispose()
    assert {each.track_id for each in asked} == set(tracks)
    assert found == {
        each.place: rooms.one(
            "select semap.relation_probability(%s, region_id) from semap.region where query_id = %s and instance_id = %s",
            each.track_id, each.place[1], each.instance_id)
        for each in asked
    }  # fmt: skip


def test_a_reader_of_another_map_sees_none(rooms: World) -> None:
    be_certain(rooms)
    track = at(rooms, "a", 1, 1.0, 1.0, 0.5)
    region = rooms.one("select region_id from semap.region join semap.relation using (query_id, instance_id)")
    for maps, count in ((rooms.map_id, 1), (rooms.map_id + 1, 0)):
        with connect(rooms.dsn, "semap_read_map") as reader:
            reader.execute("select set_config('semap.maps', %s, false)", [f"{{{maps}}}"])
            assert len(reader.execute("select * from semap.relation_certainty").fetchall()) == count
            (found,) = reader.execute(
                "select semap.relation_probability(%s, %s)", [track, region]
            ).fetchone() or (0,)
            assert (found is not None) == bool(count)
