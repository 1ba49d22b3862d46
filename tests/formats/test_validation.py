import json
from dataclasses import replace
from pathlib import Path
from uuid import uuid5

import numpy as np
import pytest
from shapely import box

from semap.errors import InvalidInput
from semap.formats import read_building
from semap.formats.geojson import NAMESPACE
from semap.formats.validation import doubts
from semap.geometry.prism import extrude
from semap.model.building import Building, HeightBand, Item, Mesh, Storey
from semap.model.pose import Pose


def room(name: str, x: float = 0.0, y: float = 0.0, z: float = 0.0, **changes: object) -> Item:
    """Four by three metres, 2.5 m high, its body in its own frame."""
    made = Item(
        uuid5(NAMESPACE, name),
        name,
        "Room",
        pose=Pose(x, y, z),
        body=extrude(box(0, 0, 4, 3), 0, 2.5),
        band=HeightBand(z, z + 2.5),
    )
    return replace(made, **changes)


def door(name: str, *joins: str, concept: str = "Door") -> Item:
    return Item(uuid5(NAMESPACE, name), name, concept, joins=joins)


def storey(name: str, elevation_m: float) -> Storey:
    return Storey(uuid5(NAMESPACE, name), name, elevation_m)


def told(*items: Item, storeys: tuple[Storey, ...] = ()) -> list[tuple[str, str]]:
    found = doubts(Building(storeys, items))
    assert {finding.action for finding in found} <= {"note"}
    return [(finding.subject, finding.reason) for finding in found]


def test_nothing_is_told_of_a_sound_building() -> None:
    ground, upper = storey("ground", 0.0), storey("upper", 2.5)
    assert told(
        room("a", storey="ground"),
        room("b", x=4.0, storey="ground"),
        room("c", z=2.5, storey="upper"),
        room("cellar", z=-2.5),
        door("d", "a", "b"),
        door("e", "a"),
        door("hatch", concept="Window"),
        storeys=(ground, upper),
    ) == []  # fmt: skip
    assert told() == []


def test_rooms_without_geometry() -> None:
    assert told(room("a", body=None)) == [("a", "a room without geometry: nothing is ever found in it")]
    assert told(room("a", body=None, footprint=box(0, 0, 4, 3))) == []


@pytest.mark.parametrize(
    ("x", "z", "storey_name", "area"),
    [
        (3.0, 0.0, None, "3.00"),
        (3.99, 0.0, None, "0.03"),
        (3.997, 0.0, None, None),
        (3.0, 2.5, None, None),
        (3.0, 2.495, None, None),
        (3.0, 2.4, None, "3.00"),
        (3.0, 0.0, "upper", None),
    ],
)
def test_rooms_of_one_storey_that_overlap(
    x: float, z: float, storey_name: str | None, area: str | None
) -> None:
    found = told(room("a"), room("b", x=x, z=z, storey=storey_name))
    expected = [] if area is None else [("a", f"it overlaps 'b' by {area} m2; a track there is in both")]
    assert found == expected


def test_an_outline_counts_before_the_body_and_without_heights_at_every_height() -> None:
    flat = room("a", body=None, band=None, footprint=box(0, 0, 2, 3))
    assert told(flat, room("b", x=1.0, z=90.0)) == [
        ("a", "it overlaps 'b' by 3.00 m2; a track there is in both")
    ]
    narrow = room("b", footprint=box(2, 0, 4, 3))
    assert told(flat, narrow) == []


def test_doors_that_join_nothing_or_too_much() -> None:
    found = told(door("d"), door("o", concept="Opening"), door("e", "a", "b", "c"))
    assert found == [
        ("d", "the door joins no room"),
        ("o", "the opening joins no room"),
        ("e", "it joins 3 rooms; all are kept"),
    ]


def test_names_given_twice() -> None:
    found = told(room("a"), room("a", x=9.0), room("s", x=18.0), storeys=(storey("s", 0.0),))
    reason = "its name is given 2 times; it must occur once on a map"
    assert sorted(found) == [("a", reason), ("s", reason)]


@pytest.mark.parametrize(
    ("scale", "word"), [(60.0, None), (1000.0, "mm"), (3000.0, "mm"), (0.2, "degrees"), (1.0, None)]
)
def test_a_size_that_no_building_has(scale: float, word: str | None) -> None:
    body = room("a").body
    assert body is not None
    scaled = room("a", body=Mesh(body.vertices_m * scale, body.faces))
    found = told(scaled)
    assert [subject for subject, _ in found] == ([] if word is None else ["units"])
    assert all(word in reason for _, reason in found if word)


@pytest.mark.parametrize(("x", "is_far"), [(9_000.0, False), (445_534.0, True), (-445_534.0, True)])
def test_a_place_far_from_the_origin(x: float, is_far: bool) -> None:
    found = told(room("a", x=x), room("b", x=x + 4))
    assert [subject for subject, _ in found] == (["origin"] if is_far else [])
    assert all(f"({x:.0f}, 0, 0)" in reason for _, reason in found)


def test_storeys_that_are_not_in_order() -> None:
    ground, upper = storey("ground", 0.0), storey("upper", 3.0)
    swapped = told(
        room("a", z=3.0, storey="ground"), room("b", z=0.0, storey="upper"), storeys=(ground, upper)
    )
    assert swapped == [
        ("ground", "its elevation is 0 m, but its rooms begin at 3.00 m"),
        ("upper", "its elevation is 3 m, but its rooms begin at 0.00 m"),
    ]
    assert told(storeys=(ground, replace(upper, elevation_m=0.0))) == [
        ("upper", "it has the same elevation as 'ground': 0 m")
    ]


@pytest.mark.parametrize("reach_m", [1.1e8, 1e9, 1e300])
def test_what_lies_beyond_any_place_on_earth_is_refused(tmp_path: Path, reach_m: float) -> None:
    shapes = [
        [[0, 0], [4, 0], [4, 3]],
        [[reach_m, 0], [reach_m + 4e3, 0], [reach_m, 4e3]],
        [[0, 0], [0, -reach_m], [5, 5]],
    ]
    features = [
        {
            "type": "Feature",
            "properties": {"name": f"r{n}"},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        for n, ring in enumerate(shapes)
    ]
    features[1]["geometry"] = {"type": "Point", "coordinates": [reach_m, 0]}
    plan = tmp_path / "plan.geojson"
    plan.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(InvalidInput, match="2 things are wrong") as refusal:
        read_building(plan)
    assert [line.split(":")[0] for line in str(refusal.value).splitlines()[1:]] == ["  'r1'", "  'r2'"]
    assert "unit" in refusal.value.remedy


@pytest.mark.parametrize(("room_m", "is_told"), [(4000.0, True), (500.0, True), (250.0, False), (4.0, False)])
def test_a_small_flat_in_millimetres_is_told_as_well(room_m: float, is_told: bool) -> None:
    body = extrude(box(0, 0, room_m, room_m / 2), 0, 2.5)
    found = doubts(Building((), tuple(room(f"r{n}", x=n * room_m, body=body) for n in range(2))))
    assert [finding.subject for finding in found if "mm" in finding.reason] == ["units"] * is_told


def test_a_body_without_area_is_no_obstacle() -> None:
    wall = Mesh(np.array([[0.0, 0, 0], [4, 0, 0], [4, 0, 2]]), np.array([[0, 1, 2]]))
    assert told(room("a", body=wall, band=None), room("b", x=9.0)) == []


def test_every_import_reports_them(tmp_path: Path) -> None:
    square = '{"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}'
    features = ",".join(
        f'{{"type": "Feature", "properties": {{"name": "{name}"}}, "geometry": {square}}}' for name in "ab"
    )
    path = tmp_path / "plan.geojson"
    path.write_text(f'{{"type": "FeatureCollection", "features": [{features}]}}')
    assert [finding.subject for finding in read_building(path).findings] == ["a"]


@pytest.mark.parametrize(
    ("member", "kind"), [("name", "thing"), ("concept", "concept"), ("storey", "storey")]
)
def test_names_that_no_index_takes_are_refused(tmp_path: Path, member: str, kind: str) -> None:
    ring = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]

    def plan(length: int) -> Path:
        feature = {
            "type": "Feature",
            "properties": {"name": "den", member: length * "x"},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        path = tmp_path / f"{length}.geojson"
        path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
        return path

    assert read_building(plan(200)).items
    with pytest.raises(InvalidInput, match=f"the {kind} 'x+'... has a name of 201 characters") as refusal:
        read_building(plan(201))
    assert refusal.value.remedy == "Choose one of at most 200."
