import json
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from data_sets import data_set
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon

from semap.errors import InvalidInput, NotFound
from semap.formats import read_building
from semap.formats.geojson import parse_geojson, read_geojson
from semap.geometry.outline import outline
from semap.geometry.pose import transform_points
from semap.model.building import Finding, HeightBand

SQUARE = [[[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0], [0.0, 0.0]]]
NEXT_SQUARE = [[[4.1, 0.0], [8.0, 0.0], [8.0, 3.0], [4.1, 3.0], [4.1, 0.0]]]
BOW_TIE = [[[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0], [0.0, 0.0]]]


def feature(kind: str, coordinates: object, **properties: object) -> dict[str, object]:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def collection(*features: object, **members: object) -> dict[str, object]:
    return {"type": "FeatureCollection", "features": list(features), **members}


def test_the_flat_is_read_as_it_was_drawn() -> None:
    path = data_set("flat/rooms.geojson")
    building = read_building(path)
    drawn = {each["properties"]["name"]: each for each in json.loads(path.read_text())["features"]}
    assert building.findings == ()
    assert building.storeys == ()
    assert {item.name for item in building.items} == set(drawn)
    for item in building.items:
        properties, geometry = drawn[item.name]["properties"], drawn[item.name]["geometry"]
        assert item.concept == properties["concept"]
        assert set(item.joins) == set(properties.get("joins", ()))
        if item.concept == "Room":
            assert item.footprint is not None
            assert item.body is not None
            assert shapely.to_geojson(item.footprint) == json.dumps(geometry, separators=(",", ":"))
            assert item.band == HeightBand(0.0, 2.5)
            assert outline(item.body).equals(item.footprint)
        else:
            start, end = np.array(geometry["coordinates"])
            assert item.footprint is item.body is item.band is None
            assert item.attributes == {"width_m": pytest.approx(np.linalg.norm(end - start))}
            half_m = np.linalg.norm(end - start) / 2
            ends = transform_points(item.pose.matrix(), [[-half_m, 0, 0], [half_m, 0, 0]])
            assert np.allclose(ends[:, :2], [start, end])


def test_the_flats_openings_are_found_without_joins() -> None:
    document = json.loads(data_set("flat/rooms.geojson").read_text())
    said = {each["properties"]["name"]: each["properties"].pop("joins", []) for each in document["features"]}
    assert {item.name: list(item.joins) for item in parse_geojson(document).items} == said


def test_every_property_goes_where_it_belongs() -> None:
    document = collection(
        feature(
            "Polygon",
            SQUARE,
            name="lab",
            concept="Laboratory",
            alias="The lab",
            height_m=2.5,
            elevation_m=3,
            storey="first",
            capacity=12,
            tags=["wet"],
        ),
        feature("Polygon", NEXT_SQUARE, name="store", storey="first", elevation_m=2.9),
        feature("Point", [4.05, 1.0], name="hatch", storey="first", elevation_m=4.0),
    )
    building = parse_geojson(document)
    lab, store, hatch = building.items
    assert (lab.concept, lab.alias, lab.storey, lab.band) == (
        "Laboratory",
        "The lab",
        "first",
        HeightBand(3.0, 5.5),
    )
    assert lab.attributes == {"capacity": 12, "tags": ["wet"]}
    assert lab.body is not None
    assert np.ptp(lab.body.vertices_m, axis=0).tolist() == [4.0, 3.0, 2.5]
    assert (store.concept, store.body, store.band) == ("Room", None, None)
    assert (hatch.concept, hatch.joins) == ("Opening", ("lab", "store"))
    assert transform_points(hatch.pose.matrix(), [[0, 0, 0]]).tolist() == [[4.05, 1.0, 4.0]]
    assert [(storey.name, storey.elevation_m) for storey in building.storeys] == [("first", 2.9)]


def test_reading_twice_gives_the_same_uids_and_names_differ() -> None:
    document = collection(
        feature("Polygon", SQUARE, name="a", storey="s"), {**feature("Polygon", NEXT_SQUARE), "id": 7}
    )
    first, second = parse_geojson(document), parse_geojson(document)
    uids = [each.uid for each in (*first.items, *first.storeys)]
    assert uids == [each.uid for each in (*second.items, *second.storeys)]
    assert len(set(uids)) == 3
    assert [item.name for item in first.items] == ["a", "7"]


@pytest.mark.parametrize(
    ("kind", "coordinates", "reason", "area_m2"),
    [
        ("Polygon", BOW_TIE, "Self-intersection", 2.0),
        ("Polygon", [SQUARE[0][:-1]], "not closed", 12.0),
        ("Polygon", [[*SQUARE[0][:2], SQUARE[0][1], *SQUARE[0][2:]]], "repeats a point", 12.0),
        ("Polygon", [[*SQUARE[0][:2], [4.0, -1.0], *SQUARE[0][1:]]], "Self-intersection", 12.0),
        ("MultiPolygon", [SQUARE, [[[2, 0], [6, 0], [6, 3], [2, 3], [2, 0]]]], "Self-intersection", 18.0),
        ("Polygon", [*SQUARE, [[3, 1], [5, 1], [5, 2], [3, 2], [3, 1]]], "Self-intersection", 12.0),
    ],
    ids=["bow tie", "unclosed", "repeated", "spike", "overlap", "hole outside"],
)
def test_a_bad_ring_is_repaired_and_reported(
    kind: str, coordinates: object, reason: str, area_m2: float
) -> None:
    building = parse_geojson(collection(feature(kind, coordinates, name="a", height_m=2)))
    (item,) = building.items
    assert item.footprint is not None
    assert item.footprint.is_valid
    assert item.footprint.area == pytest.approx(area_m2)
    (finding,) = building.findings
    assert (finding.action, finding.subject) == ("repaired", "a")
    assert reason in finding.reason


@pytest.mark.parametrize(("kind", "coordinates"), [("LineString", [[0, 0], [1, 0]]), ("Point", [0, 0])])
def test_what_has_no_outline_keeps_its_height_as_an_attribute(kind: str, coordinates: object) -> None:
    building = parse_geojson(collection(feature(kind, coordinates, name="a", height_m=2.1)))
    (item,) = building.items
    assert item.band is None
    assert item.attributes["height_m"] == 2.1


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (feature("Polygon", [], name="b"), "no coordinates"),
        ({"type": "Feature", "properties": {"name": "b"}, "geometry": None}, "no geometry"),
        ({"type": "Feature", "properties": {"name": "b"}}, "no geometry"),
        (feature("Polygon", [[[0, 0], [1, 1], [0, 0]]], name="b"), "three different points"),
        (feature("Polygon", [[[0, 0], [1, 1], [2, 2], [0, 0]]], name="b"), "no area"),
        (feature("LineString", [[0, 0], [0, 0]], name="b"), "no length"),
        (feature("LineString", [[0, 0]], name="b"), "too few"),
        (feature("MultiPoint", [[1, 2]], name="b"), "MultiPoint"),
        (feature("Polygon", NEXT_SQUARE), "neither a `name` nor an id"),
        ({"type": "Point"}, "not a GeoJSON feature"),
        (None, "not a GeoJSON feature"),
    ],
)
def test_a_feature_beyond_repair_is_skipped_and_reported(bad: object, reason: str) -> None:
    building = parse_geojson(collection(feature("Polygon", SQUARE, name="a"), bad))
    assert [item.name for item in building.items] == ["a"]
    (finding,) = building.findings
    assert finding.action == "skipped"
    assert reason in finding.reason


def test_unknown_joins_and_unused_heights_are_noted() -> None:
    building = parse_geojson(
        collection(
            feature("Polygon", SQUARE, name="a"),
            feature("LineString", [[4, 1, 0.5], [4, 2, 0.5]], name="door", joins=["a", "cellar"]),
        )
    )
    assert building.items[1].joins == ("a",)
    assert building.findings == (
        Finding("note", "door", "heights in coordinates are not used; give `elevation_m`"),
        Finding("note", "door", "it joins 'cellar', which is no room of this file"),
    )


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ([], "FeatureCollection"),
        ({"type": "Feature"}, "FeatureCollection"),
        ({"type": "FeatureCollection", "features": {}}, "`features`"),
        (collection(), "there are no features$"),
        (collection(feature("Polygon", [], name="a")), "no feature.*no coordinates"),
        (collection(feature("Polygon", [[0, 0], [1, 1]], name="a")), "nested"),
        (collection(feature("Polygon", [[["0", 0], [1, 1], [2, 0]]], name="a")), "not a number"),
        (collection(feature("Point", [1], name="a")), "fewer than two"),
        (
            collection(feature("Polygon", SQUARE, name="a"), feature("Polygon", NEXT_SQUARE, name="a")),
            "more than once: 'a'",
        ),
        (collection(feature("Polygon", SQUARE, name="a", storey="a")), "more than once: 'a'"),
        (collection(feature("Polygon", [[[np.nan, 0], [1, 0], [1, 1]]], name="a")), "finite"),
        (collection(feature("Polygon", [[[10**400, 0], [1, 0], [1, 1]]], name="a")), "finite"),
        (collection(feature("Polygon", SQUARE, name="a", height_m=0)), "`height_m`"),
        (collection(feature("Polygon", SQUARE, name="a", height_m="2.5")), "`height_m`"),
        (collection(feature("Polygon", SQUARE, name="a", elevation_m=1e9)), "`elevation_m`"),
        (collection(feature("Polygon", SQUARE, name="a", concept=3)), "`concept`"),
        (collection(feature("Polygon", SQUARE, name="a", joins="b")), "`joins`"),
        (collection(feature("Polygon", SQUARE, name="a", joins=[1])), "`joins`"),
        (collection(feature("Polygon", SQUARE, name="a", height_m=np.nan)), "`height_m` is nan"),
        (collection(feature("Polygon", SQUARE, name="a", height_m=np.inf)), "`height_m` is inf"),
        (collection(feature("Polygon", SQUARE, name="a", note={"b": [1, -np.inf]})), "`note` holds -inf"),
        ({**collection(feature("Polygon", SQUARE, name="a")), "storeys": {"b": np.nan}}, "`b` is nan"),
        (collection(feature("Polygon", SQUARE, name="a", note="\ud800")), r"half of a character \(U\+D800\)"),
        (collection(feature("Polygon", SQUARE, name="a\0b")), "NUL"),
        (collection({**feature("Polygon", SQUARE), "properties": [1]}), "`properties`"),
    ],
)
def test_a_document_that_cannot_be_a_floor_plan_is_refused(document: object, message: str) -> None:
    with pytest.raises(InvalidInput, match=re.compile(message, re.DOTALL)) as refusal:
        parse_geojson(document, where="plan.geojson")
    assert refusal.value.where.startswith("plan.geojson")
    assert refusal.value.remedy


def test_every_feature_that_is_wrong_is_told_of_many_the_first_twenty() -> None:
    wrong = [feature("Point", [np.nan, 0], name=f"p{n}") for n in range(24)]
    wrong[3] = feature("Polygon", SQUARE, name="tall", height_m="2")
    with pytest.raises(InvalidInput) as refusal:
        parse_geojson(collection(*wrong, feature("Polygon", SQUARE, name="a")), where="plan.geojson")
    head, *lines = str(refusal.value).splitlines()
    assert head == "plan.geojson: 24 features are wrong:"
    told = [f"  features[{n}] 'p{n}': a coordinate is not finite" for n in range(20)]
    told[3] = "  features[3] 'tall': `height_m` is '2'"
    assert lines == [*told, "  and 4 more"]
    assert refusal.value.remedy == "Give finite numbers. Give a number of metres."


def test_points_that_are_called_something_else_are_no_doors() -> None:
    sensors = [feature("Point", [x / 4, 1], name=f"s{x}", concept="Sensor") for x in range(12)]
    building = parse_geojson(
        collection(feature("Polygon", SQUARE, name="a"), feature("Point", [4, 1], name="hatch"), *sensors)
    )
    assert {item.name: item.joins for item in building.items if item.joins} == {"hatch": ("a",)}


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"\xff\xfe\x00", b'{"type": "FeatureCollection"', b"[" * 100_000, b"ISO-10303-21;"],
    ids=["empty", "truncated", "binary", "cut", "deep", "ifc"],
)
def test_a_file_that_is_not_json_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "plan.geojson"
    path.write_bytes(content)
    with pytest.raises(InvalidInput) as refusal:
        read_geojson(path)
    assert refusal.value.where == str(path)
    assert refusal.value.remedy


def test_files_that_are_not_there_or_of_another_kind_are_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match="no file"):
        read_building(tmp_path / "plan.geojson")
    with pytest.raises(InvalidInput, match="cannot be read"):
        read_geojson(tmp_path)
    with pytest.raises(InvalidInput, match=r"\.dwg is no building format"):
        read_building(tmp_path / "plan.dwg")


def test_a_byte_order_mark_is_no_obstacle(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(b"\xef\xbb\xbf" + json.dumps(collection(feature("Polygon", SQUARE, name="a"))).encode())
    assert read_building(path).items[0].footprint == Polygon(SQUARE[0])


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=12,
)


@given(st.sampled_from(["Polygon", "MultiPolygon", "LineString", "Point"]), json_values, json_values)
def test_whatever_a_feature_holds_the_answer_is_a_building_or_a_refusal(
    kind: str, coordinates: object, height_m: object
) -> None:
    document = collection(
        feature("Polygon", SQUARE, name="a"), feature(kind, coordinates, name="b", height_m=height_m)
    )
    try:
        building = parse_geojson(document)
    except InvalidInput:
        return
    assert building.items[0].footprint == Polygon(SQUARE[0])


numbers = st.integers(-5, 5) | st.floats(-1e7, 1e7)
points = st.lists(numbers, min_size=2, max_size=2)


@given(st.lists(st.lists(points, min_size=3, max_size=8), min_size=1, max_size=3))
def test_any_rings_give_a_valid_footprint_or_are_skipped(rings: list[list[list[float]]]) -> None:
    building = parse_geojson(
        collection(feature("Polygon", SQUARE, name="a"), feature("Polygon", rings, name="b", height_m=2.0))
    )
    for item in building.items:
        assert item.footprint is not None
        assert item.footprint.is_valid
        assert not item.footprint.is_empty
    if len(building.items) == 1:
        assert "skipped" in {finding.action for finding in building.findings}
