"""Floor plans in degrees, as RFC 7946 has them: recognised, projected, anchored, and given back."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
import psycopg
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from semap_service.exchange.placed_geojson import placed_geojson

from semap.cluster import Cluster
from semap.errors import Conflict, InvalidInput
from semap.formats.geojson import parse_geojson
from semap.geometry.utm import LATITUDES_DEG, project, zone_of
from semap.store.anchor import read_anchor
from semap.store.building import import_building
from semap.store.database import connect, one_transaction
from semap.store.map_export import placed_instances
from semap.store.maps import create_map

METRES = {"lab": [(0, 0), (4, 0), (4, 3), (0, 3)], "store": [(4, 0), (9, 0), (9, 3), (4, 3)]}
OSNABRUECK, QUITO, SYDNEY = (8.05, 52.27), (-78.5, -0.2), (151.2, -33.9)


def plan(
    place: tuple[float, float] | None = None, stretch: float = 1.0, **members: object
) -> dict[str, object]:
    """Two rooms with a door between them, in metres, or in degrees at a place on the earth."""
    longitude, latitude = place or (0.0, 0.0)
    deg = (1 / 111_320 / np.cos(np.radians(latitude)), 1 / 111_320) if place else (1.0, 1.0)

    def at(x_m: float, y_m: float) -> list[float]:
        return [longitude + stretch * x_m * deg[0], latitude + stretch * y_m * deg[1]]

    features: list[dict[str, object]] = [
        {
            "type": "Feature",
            "properties": {"name": name, "height_m": 2.5},
            "geometry": {"type": "Polygon", "coordinates": [[at(*each) for each in (*ring, ring[0])]]},
        }
        for name, ring in METRES.items()
    ]
    door = {"type": "LineString", "coordinates": [at(4, 1), at(4, 2)]}
    features.append({"type": "Feature", "properties": {"name": "door", "concept": "Door"}, "geometry": door})
    return {"type": "FeatureCollection", "features": features, **members}


@pytest.mark.parametrize("place", [OSNABRUECK, QUITO, SYDNEY])
def test_degrees_become_metres_and_the_map_is_anchored(place: tuple[float, float]) -> None:
    building = parse_geojson(plan(place))
    rooms = {item.name: item for item in building.items}
    assert rooms["lab"].footprint.area == pytest.approx(12, rel=0.01)
    assert rooms["door"].joins == ("lab", "store")
    assert rooms["door"].attributes["width_m"] == pytest.approx(1, rel=0.01)
    assert np.abs(shapely.total_bounds([rooms[name].footprint for name in METRES])).max() < 12
    assert building.anchor is not None
    assert building.anchor.epsg == zone_of(*place)
    (finding,) = building.findings
    assert (finding.action, finding.subject) == ("note", "coordinates")
    assert f"EPSG:{building.anchor.epsg}" in finding.reason
    assert "--crs metres" in finding.reason


GLOBE = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
GRID = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}


@pytest.mark.parametrize(
    ("document", "crs", "is_degrees"),
    [
        (plan(), None, False),
        (plan(stretch=0.2), None, False),
        (plan(OSNABRUECK), None, True),
        (plan(OSNABRUECK, stretch=100), None, True),
        (plan(OSNABRUECK, crs=GLOBE), None, True),
        (plan(OSNABRUECK, crs=GRID), None, False),
        (plan(crs=GLOBE, stretch=0.01), None, True),
        (plan(OSNABRUECK), "metres", False),
        (plan(stretch=0.01), "degrees", True),
    ],
)
def test_what_coordinates_are_is_said_asked_for_or_seen_by_the_size_of_rooms(
    document: dict[str, object], crs: str | None, is_degrees: bool
) -> None:
    assert (parse_geojson(document, crs=crs).anchor is not None) is is_degrees


def test_degrees_that_are_nowhere_or_of_a_whole_country_are_refused() -> None:
    with pytest.raises(InvalidInput, match="no place from") as refusal:
        parse_geojson(plan(crs=GLOBE, stretch=50))
    assert "--crs metres" in refusal.value.remedy
    with pytest.raises(InvalidInput, match="degrees apart"):
        parse_geojson(plan(OSNABRUECK, crs=GLOBE, stretch=50_000))


def test_an_export_gives_the_degrees_back_and_a_second_file_finds_its_place(database: str) -> None:
    first = plan(OSNABRUECK)
    second = {**first, "features": []}
    for each in first["features"]:
        moved = json.loads(
            json.dumps(each).replace("lab", "hall").replace("store", "attic").replace("door", "gate")
        )
        ring = np.array(moved["geometry"]["coordinates"])
        moved["geometry"]["coordinates"] = np.add(ring, [0.0005, 0.0002]).tolist()
        second["features"].append(moved)
    with one_transaction(database) as connection:
        create_map(connection, "site")
        import_building(connection, "site", parse_geojson(first))
        anchor = read_anchor(connection, "site")
        import_building(connection, "site", parse_geojson(second))
        assert read_anchor(connection, "site") == anchor == parse_geojson(first).anchor
        placed = placed_instances(connection, "site")
        exported = placed_geojson(connection, "site", placed, "EPSG:4326")
    given = {
        each["properties"]["name"]: shapely.from_geojson(json.dumps(each["geometry"]))
        for each in (*first["features"], *second["features"])
    }
    assert len(given) == 6
    for each in exported["features"]:
        found = shapely.from_geojson(json.dumps(each["geometry"]))
        # 1e-9 degrees are a tenth of a millimetre
        assert shapely.hausdorff_distance(found, given[each["properties"]["name"]]) < 1e-9


def test_degrees_do_not_go_into_a_map_that_lies_nowhere_or_elsewhere(database: str) -> None:
    with one_transaction(database) as connection:
        create_map(connection, "site")
        import_building(connection, "site", parse_geojson(plan()))
        with pytest.raises(Conflict, match="no anchor"):
            import_building(connection, "site", parse_geojson(plan(OSNABRUECK)))
        create_map(connection, "town")
        import_building(connection, "town", parse_geojson(plan(OSNABRUECK)))
        with pytest.raises(Conflict, match=r"EPSG:32632.*EPSG:32756"):
            import_building(connection, "town", parse_geojson(plan(SYDNEY)))


@pytest.fixture(scope="module")
def postgis(cluster: Cluster, template: str) -> Iterator[psycopg.Connection]:
    with connect(cluster.dsn(template)) as connection:
        yield connection


@given(
    places=st.lists(
        st.tuples(st.floats(-180, 179.999), st.floats(LATITUDES_DEG[0], LATITUDES_DEG[1])),
        min_size=1,
        max_size=5,
    )
)
def test_the_projection_is_that_of_postgis(
    postgis: psycopg.Connection, places: list[tuple[float, float]]
) -> None:
    for place in places:
        epsg = zone_of(*place)
        (expected,) = postgis.execute(
            "select array[st_x(p), st_y(p)] from st_transform(st_setsrid(st_point(%s, %s), 4326), %s::int) p",
            [*place, epsg],
        ).fetchone()
        assert project(np.array([place]), epsg)[0] == pytest.approx(expected, abs=1e-5)
