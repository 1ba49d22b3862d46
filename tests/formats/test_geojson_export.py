import json
from dataclasses import replace
from uuid import UUID

import numpy as np
import pytest
import shapely
from data_sets import data_set
from hypothesis import given, settings
from hypothesis import strategies as st
from map_documents import ATTRIBUTES
from placed import place, place_item
from shapely import Polygon

from semap.formats import read_building
from semap.formats.geojson import parse_geojson, read_geojson
from semap.formats.geojson_export import write_geojson
from semap.formats.ifc import read_ifc
from semap.geometry.pose import pose_from_yaw, transform_points
from semap.model.building import Building, HeightBand, Item, Storey


def assert_equal(found: Building, expected: Building) -> None:
    """Equal rooms and openings; bodies follow from outlines, and poses of doors to a nanometre."""
    assert [(s.name, s.elevation_m) for s in found.storeys] == [
        (s.name, s.elevation_m) for s in expected.storeys
    ]
    assert [item.name for item in found.items] == [item.name for item in expected.items]
    for one, other in zip(found.items, expected.items, strict=True):
        assert (one.uid, one.concept, one.alias, one.storey) == (
            other.uid,
            other.concept,
            other.alias,
            other.storey,
        )
        assert one.joins == other.joins
        assert one.attributes == other.attributes
        if other.footprint is not None:
            assert one.footprint is not None
            assert shapely.to_wkb(one.footprint) == shapely.to_wkb(other.footprint)
        if other.band is None:
            assert one.band is None
        else:
            assert one.band is not None
            assert (one.band.z_min_m, one.band.z_max_m) == pytest.approx(
                (other.band.z_min_m, other.band.z_max_m)
            )
        points = (
            [[0, 0, 0], [1, 0, 0]]
            if other.footprint is None and "width_m" in other.attributes
            else [[0, 0, 0]]
        )
        if other.body is None:
            assert transform_points(one.pose.matrix(), points) == pytest.approx(
                transform_points(other.pose.matrix(), points), abs=1e-9
            )


def test_the_flat_comes_back() -> None:
    building = read_geojson(data_set("flat/rooms.geojson"))
    document = write_geojson(place(building))
    again = parse_geojson(json.loads(json.dumps(document)))
    assert_equal(again, building)
    assert again.findings == ()


def test_rooms_and_doors_of_an_ifc_model_come_back() -> None:
    building = read_ifc(data_set("open_smart_home/04_Flat.ifc"))
    placed = [each for each in place(building) if each.entry.concept in ("Room", "Door", "Storey")]
    again = parse_geojson(write_geojson(placed))
    outlines = {each.entry.name: each.footprint for each in placed}
    items = [replace(item, footprint=outlines[item.name]) for item in building.items if item.name in outlines]
    assert_equal(again, Building(building.storeys, tuple(items)))


ROOMS = [Polygon([(x, 0), (x + 3.9, 0), (x + 3.9, 3), (x, 3)]) for x in (0.0, 4.0)]


@st.composite
def buildings(draw):
    storeys = (Storey(draw(st.uuids()), "ground", draw(st.floats(-100, 100))),)
    items = []
    for name, footprint in zip(("Küche", "Hall"), ROOMS, strict=True):
        low = draw(st.floats(-100, 100))
        band = draw(st.sampled_from([None, HeightBand(low, low + 2.5)]))
        alias = draw(st.none() | st.just("no"))
        items.append(
            Item(draw(st.uuids()), name, "Room", alias, "ground", footprint=footprint, band=band, attributes=draw(ATTRIBUTES))
        )  # fmt: skip
    pose = pose_from_yaw(3.95, draw(st.floats(0, 3)), draw(st.floats(-9, 9)), draw(st.floats(-3, 3)))
    attributes = draw(ATTRIBUTES) | draw(
        st.sampled_from([{}, {"width_m": 0.9}, {"height_m": 2.0, "attributes": 1}])
    )
    joins = draw(st.sampled_from([(), ("Küche",), ("Küche", "Hall")]))
    items.append(Item(draw(st.uuids()), "D", "Door", pose=pose, joins=joins, attributes=attributes))
    return Building(storeys, tuple(items))


@given(buildings())
@settings(max_examples=80, deadline=None)
def test_any_building_comes_back(building: Building) -> None:
    document = json.loads(json.dumps(write_geojson(place(building))))
    assert_equal(parse_geojson(document), building)


def test_degrees_are_what_the_function_gives() -> None:
    building = read_building(data_set("flat/rooms.geojson"))
    document = write_geojson(place(building), lambda points: points * 1e-5 + [8.0, 52.0])
    for feature, item in zip(document["features"], building.items, strict=True):
        shape = shapely.from_geojson(json.dumps(feature["geometry"]))
        assert np.all(np.abs(shapely.get_coordinates(shape) - [8.0, 52.0]) < 1e-3)
        assert feature["id"] == str(item.uid)


def test_what_has_no_outline_is_a_point() -> None:
    item = Item(
        UUID(int=7), "lamp", "Lamp", pose=pose_from_yaw(1.0, 2.0, 3.0, 0.5), attributes={"width_m": "wide"}
    )
    (feature,) = write_geojson([place_item(item)])["features"]
    assert feature["geometry"] == {"type": "Point", "coordinates": [1.0, 2.0]}
    assert feature["properties"]["elevation_m"] == 3.0
