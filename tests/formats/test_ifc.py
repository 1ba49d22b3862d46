import importlib
import itertools
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any
from uuid import UUID

import networkx as nx
import numpy as np
import pytest
import shapely
from data_sets import data_set

from semap.errors import InvalidInput, NotFound
from semap.formats import ifc
from semap.formats.ifc import read_ifc
from semap.formats.validation import doubts
from semap.geometry.outline import outline
from semap.geometry.pose import transform_mesh, transform_points
from semap.model.building import Building, HeightBand, Item

ifcopenshell = importlib.import_module("ifcopenshell")
geom = importlib.import_module("ifcopenshell.geom")
element = importlib.import_module("ifcopenshell.util.element")

DUPLEX = "duplex/Ifc2x3_Duplex_Architecture.ifc"
FLAT = "open_smart_home/04_Flat.ifc"
WAYS = ("Stair", "Ramp", "Lift", "Opening")


def of(building: Building, concept: str) -> dict[str, Item]:
    return {item.name: item for item in building.items if item.concept == concept}


def footprint(item: Item) -> shapely.Geometry:
    assert item.body is not None
    return outline(transform_mesh(item.pose.matrix(), item.body))


@cache
def read_with_steps(name: str) -> tuple[Building, list[tuple[int, int]]]:
    """What is read, once, as a large model takes seconds; and what it told of its progress."""
    steps: list[tuple[int, int]] = []
    return read_ifc(data_set(name), lambda done, total: steps.append((done, total))), steps


@pytest.mark.parametrize(
    ("name", "counts", "storeys"),
    [
        (DUPLEX, {"Room": 21, "Door": 14, "Window": 24, "Furniture": 61}, 4),
        (FLAT, {"Room": 9, "Door": 7, "Window": 7, "Furniture": 1}, 2),
    ],
)
def test_every_room_door_window_storey_and_piece_of_furniture_is_read(
    name: str, counts: dict[str, int], storeys: int
) -> None:
    building, steps = read_with_steps(name)
    total = sum(counts.values())
    things = [item for item in building.items if item.concept not in WAYS]
    assert Counter(item.concept for item in things) == counts
    assert len(building.storeys) == storeys
    assert all(item.body is not None for item in things)
    assert steps == [(done, total) for done in range(1, total + 1)]
    parts = (*building.items, *building.storeys)
    assert len({each.name for each in parts}) == len({each.uid for each in parts}) == len(parts)


def building_of(name: str) -> Building:
    return read_with_steps(name)[0]


def test_furniture_keeps_its_class_and_type_and_stands_on_its_storey() -> None:
    duplex, flat = of(building_of(DUPLEX), "Furniture"), of(building_of(FLAT), "Furniture")
    assert {item.attributes["ifc_class"] for item in duplex.values()} == {"IfcFurnishingElement"}
    (piece,) = flat.values()
    assert {key: piece.attributes[key] for key in ("ifc_class", "ifc_type")} == {
        "ifc_class": "IfcFurniture",
        "ifc_type": "Furniture 1",
    }
    assert piece.storey == "Level 1"
    # Contained in the spaces of bedrooms upstairs, and so on their storey.
    cabinets = [item for name, item in duplex.items() if name.startswith("M_Tall Cabinet-Single Door")]
    assert {item.storey for item in cabinets} == {"Level 2"}
    for item in duplex.values():
        assert item.band is None
        assert item.joins == ()


def test_furniture_stands_in_the_room_that_the_file_says() -> None:
    file = ifcopenshell.open(str(data_set(DUPLEX)))
    rooms = of(building_of(DUPLEX), "Room")
    outlines = {name: footprint(room).buffer(0.1) for name, room in rooms.items()}
    checked = 0
    for item in of(building_of(DUPLEX), "Furniture").values():
        container = element.get_container(file.by_guid(item.attributes["ifc_global_id"]))
        if container.is_a("IfcSpace"):
            assert item.body is not None
            corners = transform_points(item.pose.matrix(), item.body.vertices_m)
            middle = shapely.Point((corners.min(axis=0) + corners.max(axis=0))[:2] / 2)
            assert outlines[container.Name].contains(middle), item.name
            checked += 1
    assert checked == 61


@pytest.mark.parametrize("name", [DUPLEX, FLAT])
def test_bodies_stand_in_metres_where_ifcopenshell_sees_them_in_the_world(name: str) -> None:
    path = data_set(name)
    file = ifcopenshell.open(str(path))
    settings = geom.settings()
    settings.set("use-world-coords", True)
    for item in [each for each in building_of(name).items if each.concept not in WAYS][::3]:
        entity = file.by_guid(item.attributes["ifc_global_id"])
        world_m = np.array(geom.create_shape(settings, entity).geometry.verts).reshape(-1, 3)
        assert item.body is not None
        assert np.allclose(transform_points(item.pose.matrix(), item.body.vertices_m), world_m, atol=1e-6)
        assert item.uid == UUID(ifcopenshell.guid.expand(entity.GlobalId))
        assert item.attributes["ifc_class"] == entity.is_a()


def test_footprints_of_the_flat_have_the_areas_that_its_author_measured() -> None:
    path = data_set(FLAT)
    file = ifcopenshell.open(str(path))
    for item in of(read_ifc(path), "Room").values():
        quantities = element.get_psets(file.by_guid(item.attributes["ifc_global_id"]), qtos_only=True)
        assert footprint(item).area == pytest.approx(
            quantities["GSA Space Areas"]["GSA Space Areas"], rel=1e-6
        )


def test_rooms_of_one_storey_do_not_overlap() -> None:
    rooms = list(of(building_of(DUPLEX), "Room").values())
    shapes = [footprint(room) for room in rooms]
    for i, room in enumerate(rooms):
        for j in range(i):
            other = rooms[j]
            assert room.band is not None
            assert other.band is not None
            if room.storey == other.storey:
                assert shapes[i].intersection(shapes[j]).area < 1e-3, (room.name, other.name)


def test_bands_follow_storeys_and_stairs_keep_their_own_top() -> None:
    rooms = of(building_of(DUPLEX), "Room")
    second_m, roof_m = pytest.approx(3.1), pytest.approx(6.0)
    assert rooms["A101"].band == HeightBand(0.0, second_m)
    assert rooms["A201"].band == HeightBand(second_m, roof_m)
    assert rooms["A105"].band == HeightBand(0.0, pytest.approx(5.7))
    assert rooms["R301"].band == HeightBand(roof_m, pytest.approx(9.0))
    flat = of(building_of(FLAT), "Room")
    assert flat["1"].band == HeightBand(0.0, pytest.approx(2.52))
    assert flat["9"].band == HeightBand(0.0, pytest.approx(4.0))
    assert (flat["5"].alias, flat["5"].storey) == ("Küche", "Level 1")


def number_of(door: Item) -> str:
    """The last part of the door's name, its number in the drawing."""
    return door.name.rsplit(":", 1)[1]


def test_doors_of_the_duplex_join_what_its_space_boundaries_say() -> None:
    building = building_of(DUPLEX)
    joins = {number_of(door): door.joins for door in of(building, "Door").values()}
    assert joins == {
        "146596": ("A101",),
        "146678": ("B101",),
        "150173": ("A101", "A104"),
        "150257": ("B101", "B104"),
        "150378": ("B201", "B203"),
        "150478": ("A201", "A203"),
        "159734": ("B201", "B202"),
        "159834": ("A201", "A202"),
        "160065": ("B201", "B204"),
        "160208": ("A201", "A204"),
        "171853": ("B102",),
        "171975": ("A102",),
        "203720": ("B204", "B205"),
        # The file bounds it with three; from its place it leads from the bath to the utility room.
        "204034": ("A201", "A204", "A205"),
    }
    assert sum(len(names) == 2 for names in joins.values()) == 9
    assert building.findings == ()
    doubtful = doubts(building)
    assert [finding.reason for finding in doubtful] == ["it joins 3 rooms; all are kept"]
    assert "204034" in doubtful[0].subject


def test_stairs_of_the_duplex_join_its_storeys_and_open_rooms_are_joined() -> None:
    duplex = building_of(DUPLEX)
    assert sorted(stair.joins for stair in of(duplex, "Stair").values()) == [
        ("A101", "A201"),
        ("B101", "B201"),
    ]
    for stair in of(duplex, "Stair").values():
        heights_m = transform_points(stair.pose.matrix(), stair.body.vertices_m)[:, 2]
        assert (heights_m.min(), heights_m.max()) == (pytest.approx(0, abs=0.1), pytest.approx(3.1, abs=0.1))
    open_plan = {("1", "2"), ("1", "3"), ("2", "3"), ("1", "5")}
    expected = {(f"{side}10{one}", f"{side}10{two}") for side in "AB" for one, two in open_plan}
    assert {way.joins for way in of(duplex, "Opening").values()} == expected


def test_openings_without_doors_join_rooms_of_the_flat() -> None:
    openings = of(building_of(FLAT), "Opening")
    assert {way.joins for way in openings.values()} == {("1", "9"), ("2", "8")}
    outlines = {name: footprint(room) for name, room in of(building_of(FLAT), "Room").items()}
    for way in openings.values():
        hole = footprint(way)
        assert all(hole.distance(outlines[name]) < 0.1 for name in way.joins)


def test_one_can_go_from_every_room_of_an_apartment_to_every_other() -> None:
    building = building_of(DUPLEX)
    ways = nx.Graph()
    ways.add_nodes_from(of(building, "Room"))
    for item in building.items:
        ways.add_edges_from(itertools.combinations(item.joins, 2))
    parts = sorted(sorted(part) for part in nx.connected_components(ways))
    assert [len(part) for part in parts] == [10, 10, 1]
    assert [{name[0] for name in part} for part in parts] == [{"A"}, {"B"}, {"R"}]


def test_without_space_boundaries_shapes_tell_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ifc, "CONCEPTS", {"IfcSpace": "Room", "IfcDoor": "Door"})
    path = data_set(DUPLEX)
    lines = path.read_text(encoding="latin-1").splitlines(keepends=True)
    bare = tmp_path / "bare.ifc"
    bare.write_text("".join(line for line in lines if "IFCRELSPACEBOUNDARY(" not in line), encoding="latin-1")
    said = {number_of(door): door.joins for door in of(building_of(DUPLEX), "Door").values()}
    found = {number_of(door): door.joins for door in of(read_ifc(bare), "Door").values()}
    assert found == said | {"204034": ("A204", "A205")}


def test_doors_of_the_flat_are_joined_by_shape() -> None:
    building = building_of(FLAT)
    aliases = {name: room.alias for name, room in of(building, "Room").items()}
    joins = {
        number_of(door): [aliases[name] for name in door.joins] for door in of(building, "Door").values()
    }
    assert joins == {
        "319956": ["Treppenhaus", "Diele"],
        "320113": ["Raum 1", "Diele"],
        "320325": ["Bad", "Diele"],
        "321460": ["Küche", "Diele"],
        "321571": ["Küche", "Raum 3"],
        "321613": ["Room", "Room"],
        "321687": ["Room", "Diele"],
    }
    assert [finding.subject for finding in building.findings] == ["7 doors"]


def changed(path: Path, target: Path, change: Any) -> Building:
    """The building of a file after a change to its entities."""
    file = ifcopenshell.open(str(path))
    change(file)
    file.write(str(target))
    return read_ifc(target)


def test_repeated_names_and_identities_are_told_apart(tmp_path: Path) -> None:
    def change(file: Any) -> None:
        for space in file.by_type("IfcSpace"):
            space.Name = "Room"
        first, second, third = file.by_type("IfcDoor")[:3]
        second.GlobalId = first.GlobalId
        third.GlobalId = "no id"

    building = changed(data_set(FLAT), tmp_path / "changed.ifc", change)
    assert list(of(building, "Room")) == ["Room", *(f"Room {number}" for number in range(2, 10))]
    assert len({item.uid for item in building.items}) == len(building.items)
    assert sum(finding.action == "repaired" for finding in building.findings) == 2
    assert sum("not the only one" in finding.reason for finding in building.findings) == 8


def test_a_room_without_geometry_is_kept_and_reported(tmp_path: Path) -> None:
    def change(file: Any) -> None:
        file.by_type("IfcSpace")[0].Representation = None

    building = changed(data_set(FLAT), tmp_path / "changed.ifc", change)
    room = of(building, "Room")["1"]
    assert room.body is room.band is None
    assert ("note", "1") in {(finding.action, finding.subject) for finding in building.findings}


def test_quantities_and_elevations_are_converted_from_the_files_units(tmp_path: Path) -> None:
    def change(file: Any) -> None:
        space = file.by_type("IfcSpace")[0]
        area = file.create_entity("IfcQuantityArea", Name="NetFloorArea", AreaValue=18.603)
        height = file.create_entity("IfcQuantityLength", Name="Height", LengthValue=2520.0)
        measures = file.create_entity(
            "IfcElementQuantity",
            GlobalId=ifcopenshell.guid.new(),
            Name="Qto_SpaceBaseQuantities",
            Quantities=[area, height],
        )
        file.create_entity(
            "IfcRelDefinesByProperties",
            GlobalId=ifcopenshell.guid.new(),
            RelatedObjects=[space],
            RelatingPropertyDefinition=measures,
        )
        file.by_type("IfcBuildingStorey")[1].Elevation = None

    building = changed(data_set(FLAT), tmp_path / "changed.ifc", change)
    room = of(building, "Room")["1"]
    assert room.attributes["net_floor_area_m2"] == pytest.approx(18.603)
    assert room.attributes["height_m"] == pytest.approx(2.52)
    assert [storey.elevation_m for storey in building.storeys] == pytest.approx([0.0, 2.52])
    door = next(iter(of(building, "Door").values()))
    assert (door.attributes["width_m"], door.attributes["height_m"]) == pytest.approx((0.915, 2.134))


def test_a_model_without_spaces_is_refused(tmp_path: Path) -> None:
    def change(file: Any) -> None:
        for space in file.by_type("IfcSpace"):
            file.remove(space)

    with pytest.raises(InvalidInput, match="no spaces") as refusal:
        changed(data_set(FLAT), tmp_path / "changed.ifc", change)
    assert "IfcSpace" in refusal.value.remedy


EMPTY_MODEL = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('{schema}'));
ENDSEC;
DATA;
{data}
ENDSEC;
END-ISO-10303-21;
"""


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "empty"),
        ("{}", "not an IFC file"),
        ("\0" * 5000, "not an IFC file"),
        ("ISO-10303-21;\nHEADER;\n", "cut off"),
        ("ISO-10303-21;\nEND-ISO-10303-21;\n", "cannot be parsed"),
        (EMPTY_MODEL.format(schema="AUTOMOTIVE_DESIGN", data=""), "cannot be parsed"),
        (EMPTY_MODEL.format(schema="IFC4", data=""), "no spaces"),
    ],
)
def test_a_file_that_is_no_building_model_is_refused(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "model.ifc"
    path.write_text(content)
    with pytest.raises(InvalidInput, match=message) as refusal:
        read_ifc(path)
    assert refusal.value.where == str(path)
    assert refusal.value.remedy


def test_a_truncated_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.ifc"
    path.write_bytes(data_set(FLAT).read_bytes()[:200_000])
    with pytest.raises(InvalidInput, match="cut off"):
        read_ifc(path)


def test_a_missing_file_is_not_found(tmp_path: Path) -> None:
    with pytest.raises(NotFound):
        read_ifc(tmp_path / "model.ifc")


def test_without_ifcopenshell_the_reader_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(name: str, package: str | None = None) -> object:
        raise ModuleNotFoundError(name)

    path = tmp_path / "model.ifc"
    path.write_text(EMPTY_MODEL.format(schema="IFC4", data=""))
    monkeypatch.setattr(importlib, "import_module", refuse)
    with pytest.raises(InvalidInput) as refusal:
        read_ifc(path)
    assert "pip install semap[ifc]" in refusal.value.remedy
