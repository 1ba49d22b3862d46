"""Doors that were drawn as lines, or have an outline of their own, are crossed where one passes through them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from uuid import uuid4

import psycopg
import pytest
import shapely
import shapely.affinity
import shapely.geometry

from semap.formats.geojson import parse_geojson
from semap.geometry.pose import pose_from_yaw
from semap.model.continuous_query import Declaration, Side
from semap.store.database.connection import connect, one_transaction
from semap.store.map.building import import_building
from semap.store.map.instance_edit import Changes, edit_instance
from semap.store.map.maps import create_map
from semap.store.operate.schema import migrate
from semap.store.relation.queries import add_query

DOOR = {"name": "door", "concept": "Door", "joins": ["Hall", "Office"]}


class Flat:
    """A hall in the west and an office in the east, whose door is at x = 4, y from 1 to 2."""

    def __init__(
        self, dsn: str, door: dict[str, object], abstraction: str, concept: str | None = "Door"
    ) -> None:
        rooms = [
            {"type": "Feature", "properties": {"name": name}, "geometry": box(x, 0, x + 4, 4)}
            for name, x in (("Hall", 0), ("Office", 4))
        ]
        document = {"type": "FeatureCollection", "features": [*rooms, door]}
        self.dsn = dsn
        with one_transaction(dsn) as connection:
            map_id = create_map(connection, "flat").map_id
            import_building(connection, "flat", parse_geojson(document))
            asked = Declaration(
                "through",
                "crosses",
                Side("track"),
                Side("instance", concept=concept),
                abstraction=abstraction,
            )
            add_query(connection, "flat", asked)
        self.connection: psycopg.Connection = connect(dsn)
        (source_id,) = self.connection.execute(
            "insert into semap.source (map_id, name) values (%s, 'tracker') returning source_id", [map_id]
        ).fetchone()
        (self.track_id,) = self.connection.execute(
            "insert into semap.track (uid, source_id, map_id, name) values (%s, %s, %s, 'Ann') returning track_id",
            [uuid4(), source_id, map_id],
        ).fetchone()

    def walk(self, *places: tuple[float, float, float]) -> None:
        """Ann is seen at these x, y at these seconds."""
        for second, x_m, y_m in places:
            self.connection.execute(
                "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, to_timestamp(%s), %s, %s)",
                [self.track_id, second, x_m, y_m],
            )

    def crossings(self) -> list[tuple[str, float, float, float]]:
        self.settle()
        return self.connection.execute(
            "select direction, extract(epoch from transition_at)::float8, x_m, y_m from semap.relation_change"
            " where query_name = 'through' order by change_id"
        ).fetchall()

    def settle(self) -> None:
        """All states of the newest stamp have come."""
        self.connection.execute("update semap.source set newest_is_whole = true")

    def edit(self, **changes: object) -> None:
        (door_id,) = self.connection.execute(
            "select instance_id from semap.instance where name = 'door'"
        ).fetchone()
        with one_transaction(self.dsn) as connection:
            edit_instance(connection, door_id, Changes(**changes))


def box(x_min: float, y_min: float, x_max: float, y_max: float) -> dict[str, object]:
    ring = [[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max], [x_min, y_min]]
    return {"type": "Polygon", "coordinates": [ring]}


def line(*ends: tuple[float, float]) -> dict[str, object]:
    return {
        "type": "Feature",
        "properties": DOOR,
        "geometry": {"type": "LineString", "coordinates": [list(end) for end in ends]},
    }


@pytest.fixture
def flat_of(database: str) -> Iterator:
    made: list[Flat] = []

    def make(door: dict[str, object], abstraction: str, **more: str | None) -> Flat:
        made.append(Flat(database, door, abstraction, **more))
        return made[-1]

    yield make
    for each in made:
        each.connection.close()


@pytest.mark.parametrize("abstraction", ["Footprint", "Line"])
def test_a_door_that_is_a_line_is_crossed_where_it_is_passed(flat_of, abstraction: str) -> None:
    """It leads north, so that the hall is on its left; beside it is wall."""
    flat = flat_of(line((4, 1), (4, 2)), abstraction)
    flat.walk((1, 3, 1), (3, 5, 2), (4, 5, 2.5), (5, 3, 2.5), (6, 3, 1.5), (8, 5, 1.5), (10, 3, 1.5))
    assert flat.crossings() == [
        ("left_to_right", pytest.approx(2), pytest.approx(4), pytest.approx(1.5)),
        ("left_to_right", pytest.approx(7), pytest.approx(4), pytest.approx(1.5)),
        ("right_to_left", pytest.approx(9), pytest.approx(4), pytest.approx(1.5)),
    ]


def test_a_door_that_is_moved_or_made_wider_is_crossed_where_it_is_then(flat_of) -> None:
    flat = flat_of(line((4, 1), (4, 2)), "Line")
    flat.walk((1, 3, 3.2), (2, 5, 3.2))
    assert flat.crossings() == []
    flat.edit(pose=pose_from_yaw(4, 3.2, 0, -1.5707963267948966))
    flat.walk((3, 3, 3.2), (4, 3, 1.5), (5, 5, 1.5), (6, 5, 2.3), (7, 3, 2.3))
    assert [direction for direction, *_ in flat.crossings()] == ["left_to_right"]
    flat.edit(attributes={"width_m": 2.0})
    flat.walk((8, 5, 2.3))
    assert [direction for direction, *_ in flat.crossings()] == ["left_to_right", "right_to_left"]
    flat.edit(attributes={"width_m": "wide"})
    flat.walk((9, 3, 2.3))
    assert len(flat.crossings()) == 2


@pytest.mark.parametrize(
    ("turned_deg", "direction"),
    [(0, "right_to_left"), (30, "right_to_left"), (90, "right_to_left"), (135, "left_to_right")],
)
def test_a_door_with_an_outline_has_a_line_through_its_middle(
    flat_of, turned_deg: float, direction: str
) -> None:
    """By its outline it would be crossed twice. Whoever walks across it goes north before it is turned."""

    def turned(geometry: shapely.Geometry) -> shapely.Geometry:
        return shapely.affinity.rotate(geometry, turned_deg, origin=(4, 2))

    outline = shapely.geometry.mapping(turned(shapely.box(3.5, 1.9, 4.5, 2.1)))
    door = {"type": "Feature", "properties": DOOR, "geometry": json.loads(json.dumps(outline))}
    flat = flat_of(door, "Line")
    way = shapely.get_coordinates(turned(shapely.LineString([(4, 1), (4, 3), (4.7, 1), (4.7, 3)])))
    flat.walk(*((2 * number + 1, x, y) for number, (x, y) in enumerate(way)))
    assert flat.crossings()[0] == (direction, pytest.approx(2), pytest.approx(4), pytest.approx(2))
    assert len(flat.crossings()) == 2


def test_an_outline_without_heights_is_a_door_at_every_height(flat_of) -> None:
    door = {
        "type": "Feature",
        "properties": {**DOOR, "elevation_m": 3},
        "geometry": box(3.5, 1.9, 4.5, 2.1),
    }
    flat = flat_of(door, "Line")
    flat.connection.execute(
        "insert into semap.track_state (track_id, stamp, x_m, y_m, z_m) values"
        " (%(id)s, to_timestamp(1), 4, 1, 4), (%(id)s, to_timestamp(2), 4, 3, 4)",
        {"id": flat.track_id},
    )
    assert len(flat.crossings()) == 1


@pytest.mark.parametrize("width", [-1, 0, 900, 1e18, 1e307, "NaN", None])
def test_a_width_that_no_door_has_is_none(flat_of, width: object) -> None:
    """In the data of a building, widths may be in millimetres; they must not stop those who report states."""
    flat = flat_of(line((4, 1), (4.3, 2)), "Line")
    flat.edit(attributes={"width_m": width})
    flat.walk(*((second, 3 + second % 3, 1.5) for second in range(1, 7)))
    assert flat.crossings() == []


def test_a_width_beyond_all_numbers_is_none(flat_of) -> None:
    flat = flat_of(line((4, 1), (4, 2)), "Line")
    flat.connection.execute(
        """update semap.instance set attributes = '{"width_m": 1e400, "height_m": 1e400}' where name = 'door'"""
    )
    flat.walk((1, 3, 1.5), (2, 5, 1.5))
    assert flat.crossings() == []


def test_what_becomes_an_opening_is_crossed_from_then_on(database: str, flat_of) -> None:
    """Its query names no concept, and so would not hear of it."""
    with connect(database) as owner:
        owner.execute("insert into semap.concept (name) values ('Hatch')")
    flat = flat_of({**line((4, 1), (4, 2)), "properties": {**DOOR, "concept": "Hatch"}}, "Line", concept=None)
    flat.walk((1, 3, 1.5), (2, 5, 1.5))
    assert flat.crossings() == []
    flat.connection.execute(
        "insert into semap.concept_parent (concept_id, parent_id)"
        " values (semap.concept_named('Hatch'), semap.concept_named('Opening'))"
    )
    flat.walk((3, 3, 1.5))
    assert [direction for direction, *_ in flat.crossings()] == ["right_to_left"]


def test_a_database_that_did_not_know_doorways_is_brought_in_line_with_its_behaviour(flat_of) -> None:
    flat = flat_of(line((4, 1), (4, 2)), "Line")
    flat.walk((1, 3, 1.5))
    flat.connection.execute("delete from semap.pair_instance")
    flat.connection.execute("update semap.behaviour set checksum = 'older'")
    assert migrate(flat.dsn).behaviour_changed
    flat.walk((2, 5, 1.5))
    assert [direction for direction, *_ in flat.crossings()] == ["left_to_right"]


def test_the_heights_of_a_door_count(flat_of) -> None:
    """It is 2 m high where nobody says otherwise: who is a storey above does not pass it."""
    flat = flat_of(line((4, 1), (4, 2)), "Line")
    flat.connection.execute(
        "insert into semap.track_state (track_id, stamp, x_m, y_m, z_m)"
        " select %s, to_timestamp(s), case s %% 2 when 1 then 3 else 5 end, 1.5, case when s < 3 then 4 else 1 end"
        " from generate_series(1, 4) s", [flat.track_id],
    )  # fmt: skip
    assert [at for _, at, *_ in flat.crossings()] == [pytest.approx(3.5)]
