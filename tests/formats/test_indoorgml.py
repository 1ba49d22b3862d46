import itertools
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from data_sets import data_set
from hypothesis import given, settings
from hypothesis import strategies as st

from semap.errors import InvalidInput, SemapError
from semap.formats import read_building
from semap.formats.indoorgml import parse_indoorgml
from semap.geometry.outline import outline
from semap.geometry.pose import transform_mesh, transform_points
from semap.model.building import Building, HeightBand, Item

HOUSE = "indoorgml/FJK-Haus_IndoorGML_withEXR-corrected_1_0_3.gml"
CELL = re.compile(r'<CellSpace gml:id="(\w+)">\s*<gml:name>(.*?)</gml:name>(.*?)</CellSpace>', re.DOTALL)
POLYGON = re.compile(r'<gml:Polygon gml:id="(\w+)">(.*?)</gml:Polygon>', re.DOTALL)
CROSSING = {"poly202_2116", "poly201_2325", "poly201_2349", "poly204_257"}
"""Polygons of the house that cross or touch themselves."""

CROSSING_CORNERS = {"201": 3, "202": 1, "204": 1}

POS = re.compile(r"<gml:pos>(.*?)</gml:pos>")
HEAD = (
    '<?xml version="1.0"?><IndoorFeatures xmlns="http://www.opengis.net/indoorgml/1.0/core"'
    ' xmlns:navi="http://www.opengis.net/indoorgml/1.0/navigation"'
    ' xmlns:gml="http://www.opengis.net/gml/3.2" xmlns:xlink="http://www.w3.org/1999/xlink">'
)


def numbers(text: str) -> np.ndarray:
    return np.array([pos.split() for pos in POS.findall(text)], dtype=float)


def test_the_house_has_all_its_rooms_where_the_file_puts_them() -> None:
    path = data_set(HOUSE)
    building = read_building(path)
    rooms = {item.name: item for item in building.items if item.concept == "Room"}
    cells = {name: (key, body) for key, name, body in CELL.findall(path.read_text())}
    assert len(cells) == 14
    assert rooms.keys() == cells.keys()
    for name, (key, text) in cells.items():
        room, drawn = rooms[name], numbers(text)
        assert room.attributes["indoorgml_id"] == key
        assert room.body is not None
        placed = transform_points(room.pose.matrix(), room.body.vertices_m)
        # Every corner of the file and no other; a nanometre is what doubles resolve that far from zero.
        corners = {tuple(corner) for corner in drawn.round(8)}
        assert corners <= {tuple(corner) for corner in placed.round(8)}
        # Faces that cross themselves get corners where they do.
        assert len({tuple(corner) for corner in placed.round(8)} - corners) <= CROSSING_CORNERS.get(name, 0)
        assert room.band == HeightBand(drawn[:, 2].min(), drawn[:, 2].max())


def test_the_houses_faces_have_the_area_of_their_polygons() -> None:
    path = data_set(HOUSE)
    rooms = {item.name: item for item in read_building(path).items}
    for _, name, text in CELL.findall(path.read_text()):
        drawn = 0.0
        for key, ring in POLYGON.findall(text):
            points = numbers(ring) - numbers(ring)[0]
            normal = np.cross(points[:-1], points[1:]).sum(axis=0) / 2
            area = np.linalg.norm(normal)
            if key in CROSSING:
                axis = np.argmax(np.abs(normal))
                shadow = shapely.make_valid(shapely.Polygon(np.delete(points, axis, axis=1))).area
                assert shadow >= abs(normal[axis]) * (1 - 1e-9)
                area = shadow * area / abs(normal[axis])
            drawn += area
        body = rooms[name].body
        a, b, c = (body.vertices_m[body.faces[:, corner]] for corner in range(3))
        assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(drawn, rel=1e-6)


def test_the_houses_transitions_are_openings_that_join_its_rooms() -> None:
    path = data_set(HOUSE)
    text = path.read_text()
    building = read_building(path)
    names = {key: name for key, name, _ in CELL.findall(text)}
    ways = set()
    for transition in re.findall(r"<Transition .*?</Transition>", text, re.DOTALL):
        ends = re.findall(r'<connects xlink:href="#R(\d+)"', transition)
        line = numbers(transition)
        place = line[1] if len(line) == 3 else line.mean(axis=0)
        ways.add((tuple(sorted(names[f"C{end}"] for end in ends)), tuple(place.round(8))))
    openings = [item for item in building.items if item.concept == "Opening"]
    found = [(item.joins, tuple(item.pose.matrix()[:3, 3].round(8))) for item in openings]
    assert len(found) == 15
    assert set(found) == ways
    assert len({item.name for item in building.items}) == len({item.uid for item in building.items}) == 29
    assert {finding.subject for finding in building.findings} == {
        "units",
        "15 transitions",
        "origin",
        "201",
        "202",
        "204",
    }


def test_the_houses_rooms_do_not_overlap() -> None:
    rooms = [item for item in read_building(data_set(HOUSE)).items if item.body is not None]
    shapes = [outline(transform_mesh(room.pose.matrix(), room.body)) for room in rooms]
    assert all(shape.is_valid for shape in shapes)
    for (one, a), (other, b) in itertools.combinations(zip(rooms, shapes, strict=True), 2):
        if min(one.band.z_max_m, other.band.z_max_m) - max(one.band.z_min_m, other.band.z_min_m) > 0.01:
            assert a.intersection(b).area < 0.01, (one.name, other.name)


def box(x: float, y: float, z: float, width: float, depth: float, height: float) -> str:
    """A solid with six faces, seen from outside."""
    a, b, c, d = ((x, y), (x + width, y), (x + width, y + depth), (x, y + depth))
    low, high = (z,), (z + height,)
    faces = [[d + low, c + low, b + low, a + low], [a + high, b + high, c + high, d + high]]
    faces += [[p + low, q + low, q + high, p + high] for p, q in ((a, b), (b, c), (c, d), (d, a))]
    members = "".join(f"<gml:surfaceMember>{polygon(face)}</gml:surfaceMember>" for face in faces)
    return f"<gml:Solid><gml:exterior><gml:Shell>{members}</gml:Shell></gml:exterior></gml:Solid>"


def polygon(points: list[tuple[float, ...]], holes: str = "", attributes: str = "") -> str:
    return (
        f"<gml:Polygon {attributes}><gml:exterior><gml:LinearRing><gml:posList>{pos_list(points)}</gml:posList>"
        f"</gml:LinearRing></gml:exterior>{holes}</gml:Polygon>"
    )


def pos_list(points: list[tuple[float, ...]]) -> str:
    return " ".join(str(part) for point in [*points, points[0]] for part in point)


def cell(key: str, name: str, geometry: str, kind: str = "CellSpace", more: str = "") -> str:
    return (
        f'<cellSpaceMember><{kind} gml:id="{key}"><gml:name>{name}</gml:name>{more}'
        f"<cellSpaceGeometry><Geometry3D>{geometry}</Geometry3D></cellSpaceGeometry>"
        f'<duality xlink:href="#s{key}"/></{kind}></cellSpaceMember>'
    )


def state(key: str) -> str:
    return f'<State gml:id="s{key}"><duality xlink:href="#{key}"/></State>'


def way(key: str, one: str, other: str, points: str, more: str = "") -> str:
    return (
        f'<Transition gml:id="{key}"><connects xlink:href="#s{one}"/><connects xlink:href="#s{other}"/>{more}'
        f"<geometry><gml:LineString><gml:posList>{points}</gml:posList></gml:LineString></geometry></Transition>"
    )


def building_of(*parts: str, head: str = HEAD) -> Building:
    return parse_indoorgml((head + "".join(parts) + "</IndoorFeatures>").encode(), "f.gml")


def items(building: Building) -> dict[str, Item]:
    return {item.name: item for item in building.items}


def test_doors_and_storeys_of_the_navigation_module() -> None:
    level = "<storey>ground</storey>"
    boundary = (
        '<cellSpaceBoundaryMember><navi:ConnectionBoundary gml:id="b"><cellSpaceBoundaryGeometry><geometry3D>'
        + polygon([(4, 1, 0), (4, 1.9, 0), (4, 1.9, 2.1), (4, 1, 2.1)])
        + "</geometry3D></cellSpaceBoundaryGeometry></navi:ConnectionBoundary></cellSpaceBoundaryMember>"
    )
    found = building_of(
        cell("a", "Lab", box(0, 0, 0.05, 4, 3, 2.5), "navi:GeneralSpace", level),
        cell("b1", "Hall", box(4, 0, 0, 4, 3, 2.5), "navi:TransitionSpace", level),
        cell(
            "d",
            "Exit",
            box(8, 1, 0, 0.2, 1, 2),
            "navi:AnchorSpace",
            "<gml:description>storey='ground'</gml:description>",
        ),
        cell("e", "Door 12", box(5, 3, 0, 1, 0.2, 2)),
        cell("f", "Doorman", box(4, 3.2, 0, 4, 3, 2)),
        boundary,
        *map(state, ("a", "b1", "d", "e", "f")),
        way("t1", "a", "b1", "2 1 1 6 1 1", '<duality xlink:href="#b"/>'),
        way("t2", "b1", "d", "6 1 1 8 1 1"),
        way("t3", "b1", "e", "6 1 1 5 3 1"),
        way("t4", "f", "e", "5 5 1 5 3 1"),
        way("t5", "e", "d", "5 5 1 5 3 1"),
        way("t6", "a", "nowhere", "5 5 1 5 3 1"),
    )
    parts = items(found)
    assert {name: (part.concept, part.joins) for name, part in parts.items()} == {
        "Lab": ("Room", ()),
        "Hall": ("Room", ()),
        "Exit": ("Door", ("Hall",)),
        "Door 12": ("Door", ("Doorman", "Hall")),
        "Doorman": ("Room", ()),
        "Opening Hall - Lab": ("Door", ("Hall", "Lab")),
    }
    assert [(storey.name, storey.elevation_m) for storey in found.storeys] == [("ground", 0.0)]
    assert [parts[name].storey for name in ("Lab", "Exit", "Doorman", "Opening Hall - Lab")] == ["ground", "ground", None, "ground"]  # fmt: skip
    door = parts["Opening Hall - Lab"]
    assert {key: door.attributes[key] for key in ("width_m", "height_m")} == pytest.approx(
        {"width_m": 0.9, "height_m": 2.1}
    )
    ends = transform_points(door.pose.matrix(), [[-0.45, 0, 0], [0.45, 0, 0]])
    assert ends == pytest.approx(np.array([[4, 1, 0], [4, 1.9, 0]]))
    told = [finding.reason.split(":")[1] for finding in found.findings if finding.subject == "1 transition"]
    assert sorted(told) == [
        " they do not connect two cells of this file",
        " they lead from one door into another",
    ]


def test_cells_of_any_class_are_taken_and_what_is_left_out_is_said() -> None:
    extension = 'xmlns:ext="http://example.org/ours/1.0"'
    head = HEAD.replace("<IndoorFeatures", f"<IndoorFeatures {extension}")
    wall = cell("w", "W1", box(4, 0, 0, 0.2, 3, 2.5), "navi:NonNavigableSpace")
    found = building_of(
        cell("a", "Lab", box(0, 0, 0, 4, 3, 2.5)),
        cell("b", "Pod", box(4.2, 0, 0, 4, 3, 2.5), "ext:SensorPod"),
        cell("d", "D-7", box(4, 1, 0, 0.2, 1, 2), "ext:FireDoorSpace"),
        cell("e", "Doorman", box(9, 1, 0, 0.2, 1, 2), "ext:DoormanLodge").replace(' gml:id="e"', ""),
        cell("o", "Glass", box(0, -0.2, 1, 1, 0.2, 1), "ext:IfcWindow"),
        wall,
        '<cellSpaceMember xlink:href="other.gml#x"/>',
        "<interLayerConnectionMember><InterLayerConnection/></interLayerConnectionMember>" * 2,
        *map(state, ("a", "b", "d", "w", "o")),
        way("t1", "a", "d", "2 1 1 4 1 1"),
        way("t2", "d", "b", "4 1 1 6 1 1"),
        way("t3", "a", "w", "2 1 1 4 1 1"),
        head=head,
    )
    assert {name: (part.concept, part.joins) for name, part in items(found).items()} == {
        "Lab": ("Room", ()),
        "Pod": ("Room", ()),
        "D-7": ("Door", ("Lab", "Pod")),
        "Doorman": ("Room", ()),
        "Glass": ("Window", ()),
        "W1": ("Obstacle", ()),
    }
    assert items(found)["Pod"].attributes["indoorgml_class"] == "SensorPod"
    told = {f"{finding.subject}: {finding.reason}" for finding in found.findings}
    assert told >= {
        "1 cell: of the class SensorPod, which is not IndoorGML's own; taken as Room",
        "1 cell: of the class FireDoorSpace, which is not IndoorGML's own; taken as Door",
        "1 cell: they lie in another file",
        "2 InterLayerConnection: semap reads cells, states and transitions",
        "1 transition: left out: they lead into a cell that is not navigable",
    }


NAMES = st.from_regex(r"[A-Z][A-Za-z]{0,12}", fullmatch=True)


@given(st.lists(NAMES, min_size=1, max_size=6, unique=True))
def test_no_cell_is_lost_whatever_its_class(classes: list[str]) -> None:
    drawn = [cell(f"c{n}", f"n{n}", box(5 * n, 0, 0, 4, 3, 2), name) for n, name in enumerate(classes)]
    ways = [way(f"t{n}", f"c{n}", f"c{n + 1}", "0 0 0 1 1 1") for n in range(len(classes) - 1)]
    found = building_of(*drawn, *(state(f"c{n}") for n in range(len(classes))), *ways)
    cells = {item.attributes["indoorgml_class"] for item in found.items if item.name.startswith("n")}
    assert cells == set(classes)


def test_outlines_in_2d_holes_references_and_units() -> None:
    hole = f"<gml:interior><gml:LinearRing><gml:posList>{pos_list([(1e3, 1e3, 0), (1e3, 2e3, 0), (2e3, 2e3, 0)])}</gml:posList></gml:LinearRing></gml:interior>"
    ring = [(0, 0, 0), (4e3, 0, 0), (4e3, 3e3, 0), (0, 3e3, 0)]
    flat = polygon(ring, hole, 'gml:id="p" srsName="urn:ogc:def:crs:EPSG::25832" uomLabels="mm mm mm"')
    found = building_of(
        cell("a", "A", flat),
        cell(
            "b",
            "B",
            '<gml:Surface><gml:patches><gml:surfaceMember xlink:href="#p"/></gml:patches></gml:Surface>',
        ),
    )
    for item in found.items:
        assert item.footprint is not None
        assert item.footprint.equals(
            shapely.Polygon([(0, 0), (4, 0), (4, 3), (0, 3)], [[(1, 1), (1, 2), (2, 2)]])
        )
    assert any("25832" in finding.reason for finding in found.findings)


def test_bent_faces_are_cut_and_told() -> None:
    bent = "<gml:MultiSurface><gml:surfaceMember>" + polygon([(0, 0, 0), (4, 0, 0), (4, 3, 1), (0, 3, 0)])
    found = building_of(cell("a", "A", bent + "</gml:surfaceMember></gml:MultiSurface>"))
    assert len(found.items[0].body.faces) == 2
    assert any("not flat" in finding.reason for finding in found.findings)


def test_an_oriented_surface_is_turned() -> None:
    floor = polygon([(0, 0, 0), (4, 0, 0), (4, 3, 0), (0, 3, 0)])
    for sign, z in (("+", 1), ("-", -1)):
        turned = f'<gml:OrientableSurface orientation="{sign}"><gml:baseSurface>{floor}</gml:baseSurface></gml:OrientableSurface>'
        wall = polygon([(0, 0, 0), (4, 0, 0), (4, 0, 2), (0, 0, 2)])
        body = (
            building_of(cell("a", "A", f"<gml:CompositeSurface>{turned}{wall}</gml:CompositeSurface>"))
            .items[0]
            .body
        )
        a, b, c = (body.vertices_m[body.faces[:, corner]] for corner in range(3))
        assert np.sign(np.cross(b - a, c - a)[:, 2]).sum() == 2 * z


ENTITY = '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "b"><!ENTITY c SYSTEM "file:///etc/passwd">]>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ENTITY + HEAD[21:] + "&c;</IndoorFeatures>", "document type"),
        ("<a/>", "not an IndoorGML"),
        ("not xml", "not XML"),
        (HEAD, "not XML"),
        (HEAD + "</IndoorFeatures>", "no cells"),
        (HEAD + "<a>" * 200 + "</a>" * 200 + "</IndoorFeatures>", "inside each other"),
        (HEAD + cell("a", "A", polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0)], "", 'srsName="EPSG:4326"')) + "</IndoorFeatures>", "degrees"),
        (HEAD + cell("a", "A", polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0)], "", 'uomLabels="furlong"')) + "</IndoorFeatures>", "furlong"),
        (HEAD + cell("a", "A", polygon([(0, 0), (1, 0), (1, 1)])) + "</IndoorFeatures>", "no positions of 3"),
        (HEAD + cell("a", "A", polygon([(0, 0, "x"), (1, 0, 0), (1, 1, 0)])) + "</IndoorFeatures>", "no number"),
        (HEAD + cell("a", "A", polygon([(0, 0, "inf"), (1, 0, 0), (1, 1, 0)])) + "</IndoorFeatures>", "finite"),
        (HEAD + cell("a", "A", '<gml:Solid xlink:href="#gone"/>') + "</IndoorFeatures>", "not in this file"),
        (HEAD + cell("a", "A", '<gml:Solid gml:id="x"><gml:exterior xlink:href="#y"/></gml:Solid><gml:X gml:id="y"><gml:Z xlink:href="#y"/></gml:X>') + "</IndoorFeatures>", "refer to each other"),
    ],
)  # fmt: skip
def test_what_is_no_indoorgml_is_refused(text: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message) as refusal:
        parse_indoorgml(text.encode(), "f.gml")
    assert refusal.value.where.startswith("f.gml")
    assert refusal.value.remedy


def test_all_cells_that_are_wrong_are_told_at_once() -> None:
    bent = [cell(key, key, polygon([(0, 0, key), (1, 0, 0), (1, 1, 0)])) for key in "xyz"]
    with pytest.raises(InvalidInput) as refusal:
        building_of(cell("a", "A", box(0, 0, 0, 4, 3, 2)), *bent)
    first, *lines = str(refusal.value).splitlines()
    assert first == "f.gml: 3 cells are wrong:"
    assert ["no number" in line for line in lines] == [True] * 3


SOUND = (
    HEAD + cell("a", "A", box(0, 0, 0, 4, 3, 2)) + cell("b", "B", box(4, 0, 0, 4, 3, 2)) + state("a") + state("b")
    + way("t", "a", "b", "1 1 1 4 1 1 6 1 1") + "</IndoorFeatures>"
)  # fmt: skip


@given(st.integers(0, 10_000), st.integers(0, 30), st.text('<>/"= #&0a', max_size=4))
@settings(max_examples=200, deadline=None)
def test_a_damaged_file_is_read_or_refused(place: int, length: int, damage: str) -> None:
    at = place % len(SOUND)
    try:
        found = parse_indoorgml((SOUND[:at] + damage + SOUND[at + length :]).encode(), "f")
    except SemapError:
        return
    assert {item.concept for item in found.items} <= {"Room", "Opening"}


def test_the_suffix_indoorgml_is_read(tmp_path: Path) -> None:
    (tmp_path / "house.indoorgml").write_text(SOUND)
    found = read_building(tmp_path / "house.indoorgml")
    assert [item.name for item in found.items] == ["A", "B", "Opening A - B"]
    assert found.storeys == ()
