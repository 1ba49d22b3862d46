"""A map that is exported and imported again is equal, in the database and through files."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest
import shapely
from data_sets import data_set
from sqlalchemy import Engine

from semap.errors import Conflict, InvalidInput
from semap.formats import read_building
from semap.formats.yaml_map import read_map, write_map
from semap.geometry.ewkb import to_ewkb
from semap.geometry.prism import extrude
from semap.model.building import HeightBand, Mesh
from semap.model.map_document import (
    Anchor,
    ConceptEntry,
    DescriptionEntry,
    FrameEntry,
    InstanceEntry,
    MapDocument,
    OccupancyGrid,
    QueryEntry,
    RuleEntry,
    StampedPose,
)
from semap.model.pose import Pose
from semap.model.source_geometry import PolygonMesh, SourceGeometry
from semap.store.exchange.map_export import export_map, placed_instances
from semap.store.exchange.map_import import import_map
from semap.store.map.anchor import set_anchor
from semap.store.map.building import import_building
from semap.store.map.maps import create_map

SQUARE = shapely.box(0, 0, 2, 2)
LEANING = Pose(1, 2, 3, 0.5, 0.5, 0.5, 0.5)

WHOLE = MapDocument(
    name="whole",
    cell_m=2.5,
    anchor=Anchor(25832, Pose(500000.25, 5000000.5, 12)),
    concepts=(
        ConceptEntry("Desk", ("Furniture", "Shelf"), ("https://example.org/desk",), "to work at", {"type": "object"}),
        ConceptEntry("Shelf", ("Furniture",)),
    ),
    frames=(
        FrameEntry("map", None),
        FrameEntry("island", None),
        FrameEntry("first", "map", (StampedPose(Pose(z_m=3)),)),
        FrameEntry("robot", "map", (StampedPose(Pose()), StampedPose(LEANING, datetime(2026, 1, 1, 0, 0, 1, 500, tzinfo=UTC)))),
        FrameEntry("desk", "first", (StampedPose(LEANING),)),
        FrameEntry("hall", "first"),
        FrameEntry("door", "map", (StampedPose(Pose(0.1, 0.2, 1 / 3)),)),
    ),
    descriptions=(
        DescriptionEntry("big desk", (
            SourceGeometry("Body", "TRIANGLEMESH3D", extrude(SQUARE, 0, 0.7), LEANING),
            SourceGeometry("Top", "POLYGONMESH3D", PolygonMesh(np.array([[0.0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]), ((0, 1, 2, 3),))),
            SourceGeometry("grip", "POSE3D", shapely.Point(0, 0, 1), LEANING),
            SourceGeometry("seat", "POSE2D", shapely.Point(1, 1), Pose(qz=1, qw=0)),
            SourceGeometry("mark", "POINT2D", shapely.Point(0.5, 0.25)),
            SourceGeometry("lamp", "POINT3D", shapely.Point(0.5, 0.25, 2)),
            SourceGeometry("screen", "POLYGON3D", shapely.Polygon([(0, 0, 1), (1, 0, 1), (1, 0, 2)])),
        ), is_shared=True),
        DescriptionEntry("instance hall", (
            SourceGeometry("Outline", "POLYGON2D", shapely.box(0, 0, 9, 9).difference(SQUARE), band=HeightBand(0, 2.5)),
        )),
    ),
    instances=(
        InstanceEntry(UUID(int=1), "first", "Storey", "first"),
        InstanceEntry(UUID(int=2), "desk", "Desk", "desk", "my desk", "big desk", "first", (), {"a": [1, {"b": None}]}),
        InstanceEntry(UUID(int=3), "hall", "Room", "hall", None, "instance hall", "first"),
        InstanceEntry(UUID(int=4), "door", "Door", "door", joins=("hall",)),
    ),
    queries=(QueryEntry("who_is_where", "contains", "Room", enabled=False),),
    rules=(RuleEntry("visits", ("who_is_where",), {"input": "who_is_where", "emit": {"began": "in"}}, enabled=False),),
    grids=(OccupancyGrid("scan", 0.05, (-1.5, 2.25, 0.5), np.arange(6, dtype=np.uint8).reshape(2, 3)),),
)  # fmt: skip


def plain(value: object) -> object:
    """A value that can be compared, whatever arrays and shapes it holds."""
    if isinstance(value, Mesh | PolygonMesh | shapely.Geometry):
        return to_ewkb(value)
    if isinstance(value, np.ndarray):
        return value.dtype.name, value.tolist()
    if dataclasses.is_dataclass(value):
        return {each.name: plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, tuple | list):
        return [plain(each) for each in value]
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    return value


def by_name(document: MapDocument) -> object:
    """The same without the order of its parts, and without the concepts that every database has."""
    shown = plain(document)
    assert isinstance(shown, dict)
    own = {each.name for each in WHOLE.concepts}
    shown["concepts"] = [each for each in shown["concepts"] if each["name"] in own]
    for part in ("concepts", "frames", "descriptions", "instances", "queries", "rules", "grids"):
        shown[part].sort(key=lambda each: each.get("name") or each.get("key"))
    for each in shown["descriptions"]:
        each["geometries"].sort(key=lambda geometry: geometry["name"])
    return shown


def test_a_document_comes_out_as_it_went_in(engine: Engine) -> None:
    with engine.begin() as connection:
        import_map(connection, WHOLE)
    with engine.begin() as connection:
        assert by_name(export_map(connection, "whole")) == by_name(WHOLE)
        with pytest.raises(Conflict, match="whole"), connection.begin_nested():
            import_map(connection, WHOLE)
        import_map(connection, replace(export_map(connection, "whole"), name="again"))
        assert by_name(export_map(connection, "again")) == by_name(replace(WHOLE, name="again"))


@pytest.mark.parametrize(
    "file",
    [
        "duplex/Ifc2x3_Duplex_Architecture.ifc",
        "open_smart_home/04_Flat.ifc",
        "indoorgml/FJK-Haus_IndoorGML_withEXR-corrected_1_0_3.gml",
        "flat/rooms.geojson",
    ],
)
def test_a_building_goes_through_files_and_is_equal(engine: Engine, tmp_path: Path, file: str) -> None:
    folder, name = file.split("/")
    building = read_building(data_set(folder) / name)
    with engine.begin() as connection:
        create_map(connection, "first")
        report = import_building(connection, "first", building)
        exported = export_map(connection, "first")
        write_map(exported, tmp_path / "first")
        import_map(connection, replace(read_map(tmp_path / "first"), name="second"))
        assert plain(replace(export_map(connection, "second"), name="first")) == plain(exported)
        first, second = (placed_instances(connection, each) for each in ("first", "second"))
    assert len(first) == sum(report.concepts.values())
    for a, b in zip(first, second, strict=True):
        assert plain(replace(b, footprint=None)) == plain(replace(a, footprint=None))
        # derived anew from the same mesh, whose corners come in another order
        assert (a.footprint is None) == (b.footprint is None)
        if a.footprint is not None and b.footprint is not None:
            assert a.footprint.symmetric_difference(b.footprint).area < 1e-9


def test_a_map_written_by_hand_comes_out_equal(engine: Engine, tmp_path: Path) -> None:
    """The first example of the documentation, as it stands there."""
    teaching = (Path(__file__).parents[2] / "docs" / "map-format.md").read_text()
    (tmp_path / "map.yaml").write_text(teaching.split("```yaml\n")[1].split("```")[0])
    with engine.begin() as connection:
        written = read_map(tmp_path / "map.yaml")
        import_map(connection, written)
        exported = export_map(connection, "office")
        write_map(exported, tmp_path / "again")
        import_map(connection, replace(read_map(tmp_path / "again"), name="again"))
        assert plain(replace(export_map(connection, "again"), name="office")) == plain(exported)
        placed = {each.entry.name: each for each in placed_instances(connection, "again")}
    assert {each.name for each in written.instances} == set(placed)
    lamp = placed["Lamp1"]
    assert (lamp.pose.x_m, lamp.pose.y_m, lamp.pose.z_m) == pytest.approx((2, 1.3, 0.75))
    assert lamp.entry.attributes == {"watts": 7, "tags": ["desk"]}


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"instances": (replace(WHOLE.instances[1], frame="nowhere"),)}, "names the frame nowhere"),
        ({"instances": (replace(WHOLE.instances[1], description="none"),)}, "names the description none"),
        ({"instances": (replace(WHOLE.instances[3], joins=("none",)),)}, "names the other instance none"),
        ({"instances": (replace(WHOLE.instances[0], concept="None"),)}, "there is no concept None"),
        ({"frames": (FrameEntry("first", None),), "instances": ()}, "no root frame"),
        ({"rules": (replace(WHOLE.rules[0], queries=("none",)),)}, "names the query none"),
        ({"anchor": Anchor(4326)}, "not in metres"),
        ({"anchor": Anchor(20000)}, "unknown"),
        ({"frames": (*WHOLE.frames, FrameEntry("a", "b"), FrameEntry("b", "a"))}, "cannot be put below"),
    ],
)
def test_a_document_that_is_not_whole_changes_nothing(engine: Engine, changed: dict, match: str) -> None:
    with pytest.raises(InvalidInput, match=match), engine.begin() as connection:
        import_map(connection, replace(WHOLE, **changed))
    with engine.begin() as connection:
        assert connection.exec_driver_sql("select count(*) from semap.map").scalar_one() == 0
        assert (
            connection.exec_driver_sql("select count(*) from semap.concept where name = 'Desk'").scalar_one()
            == 0
        )


def test_a_map_on_the_earth(engine: Engine) -> None:
    """Checked against PROJ's own answer for the anchor point."""
    with engine.begin() as connection:
        create_map(connection, "office")
        set_anchor(
            connection, "office", Anchor(25832, Pose(500_000, 5_500_000, 0, qz=np.sqrt(0.5), qw=np.sqrt(0.5)))
        )
        row = connection.exec_driver_sql(
            "select st_astext(semap.to_earth('POINT(10 0)', map_id), 3), st_srid(semap.to_earth('POINT(1 2)', map_id)),"
            " st_distance(semap.to_earth('POINT(10 0)', map_id, 4326),"
            "             st_transform(st_setsrid(st_makepoint(500000, 5500010), 25832), 4326)),"
            " st_astext(semap.from_earth(semap.to_earth('POINT(3 4)', map_id, 4326), map_id), 6),"
            " semap.to_earth('POINT(0 0)', -1)"
            " from semap.map"
        ).one()
    assert row[0] == "POINT(500000 5500010)"
    assert row[1] == 25832
    assert row[2] < 1e-9
    assert row[3] == "POINT(3 4)"
    assert row[4] is None
