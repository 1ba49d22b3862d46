import io
import json
import struct

import numpy as np
import pytest
import shapely
import trimesh
from data_sets import data_set
from placed import instance, place
from shapely import box

from semap.formats import read_building
from semap.formats.gltf import SLAB_M, write_gltf
from semap.formats.mesh_file import read_mesh
from semap.geometry.pose import pose_from_yaw, transform_points
from semap.model.building import HeightBand, Mesh
from semap.model.pose import Pose
from semap.model.source_geometry import PolygonMesh, SourceGeometry


def scene_of(data: bytes) -> trimesh.Scene:
    return trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)


def tree_of(data: bytes) -> dict:
    length, kind = struct.unpack_from("<I4s", data, 12)
    assert (data[:4], kind, len(data)) == (b"glTF", b"JSON", struct.unpack_from("<I", data, 8)[0])
    return json.loads(data[20 : 20 + length])


def points_of(data: bytes, name: str) -> np.ndarray:
    """The points of a node in the map, z up again."""
    scene = scene_of(data)
    world_T_node, geometry = scene.graph[name]
    x, y, z = transform_points(world_T_node, scene.geometry[geometry].vertices).T
    return np.column_stack([x, -z, y])


def wedge() -> Mesh:
    return Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]]),
        np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]),
    )


def test_meshes_stand_where_their_poses_put_them() -> None:
    pose = Pose(5.0, -2.0, 1.0, 0.1, -0.5, 0.3, 0.8)
    source = SourceGeometry("Body", "TRIANGLEMESH3D", wedge(), pose_from_yaw(0.5, 0, 0, 0.3))
    data = write_gltf([instance("a", pose, source)])
    expected = transform_points(pose.matrix() @ source.pose.matrix(), wedge().vertices_m)
    assert points_of(data, "a") == pytest.approx(expected, abs=1e-5)
    # Without materials and nodes, semap's own reader sees the same body, turned to z-up again.
    assert trimesh.Trimesh(*vars(read_mesh(data, "glb")).values()).volume == pytest.approx(1.0, abs=1e-5)


def test_every_node_says_what_the_map_knows() -> None:
    building = read_building(data_set("flat/rooms.geojson"))
    placed = place(building)
    tree = tree_of(write_gltf(placed, "flat"))
    root, *nodes = tree["nodes"]
    assert root["name"] == "flat"
    assert root["children"] == list(range(1, len(placed) + 1))
    assert [node["name"] for node in nodes] == [item.name for item in building.items]
    for node, item in zip(nodes, building.items, strict=True):
        assert node["extras"]["uid"] == str(item.uid)
        assert node["extras"]["concept"] == item.concept
        assert node["extras"].get("attributes", {}) == item.attributes
        assert tuple(node["extras"].get("joins", ())) == item.joins
        assert ("mesh" in node) == (item.body is not None)


def test_volumes_of_a_building_come_through() -> None:
    building = read_building(data_set("flat/rooms.geojson"))
    scene = scene_of(write_gltf(place(building)))
    for item in building.items:
        if item.body is not None:
            world_T_node, geometry = scene.graph[item.name]
            assert np.linalg.det(world_T_node) == pytest.approx(1.0)
            assert abs(scene.geometry[geometry].volume) == pytest.approx(item.footprint.area * 2.5, rel=1e-4)


@pytest.mark.parametrize("band", [None, HeightBand(1.5, 4.0)])
def test_an_outline_without_a_mesh_is_carried_through_its_heights(band: HeightBand | None) -> None:
    pose = pose_from_yaw(445_534.25, 5_444_900.5, 1.0, 0.7)
    x, y = 445_530.0, 5_444_900.0
    outline = box(x, y, x + 4, y + 3)
    points = points_of(write_gltf([instance("a", pose, footprint=outline, band=band)]), "a")
    low, high = (1.0, 1.0 + SLAB_M) if band is None else (1.5, 4.0)
    assert points.min(axis=0) == pytest.approx([x, y, low], abs=1e-4)
    assert points.max(axis=0) == pytest.approx([x + 4, y + 3, high], abs=1e-4)


def test_a_blueprint_is_written_once() -> None:
    source = SourceGeometry("Body", "TRIANGLEMESH3D", wedge())
    placed = [instance(f"t{number}", Pose(float(number)), source) for number in range(50)]
    tree = tree_of(write_gltf(placed))
    assert len(tree["meshes"]) == 1
    assert [node["mesh"] for node in tree["nodes"][1:]] == [0] * 50
    assert len(tree["materials"]) == 1


def test_polygons_are_cut_into_triangles() -> None:
    cube = trimesh.creation.box()
    faces = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    mesh = PolygonMesh(np.asarray(cube.vertices), faces)
    flat = shapely.Polygon([(0, 0, 2), (1, 0, 2), (1, 1, 2)])
    data = write_gltf(
        [
            instance("a", Pose(), SourceGeometry("Body", "POLYGONMESH3D", mesh)),
            instance("b", Pose(), SourceGeometry("Top", "POLYGON3D", flat)),
            instance("c", Pose(), SourceGeometry("At", "POINT3D", shapely.Point(1, 2, 3))),
        ]
    )
    scene = scene_of(data)
    areas = {name: scene.geometry[scene.graph[name][1]].area for name in ("a", "b")}
    assert areas == pytest.approx({"a": 6.0, "b": 0.5})
    assert "mesh" not in tree_of(data)["nodes"][3]


def test_an_empty_map_is_a_valid_file() -> None:
    tree = tree_of(write_gltf([], "empty"))
    assert tree["nodes"] == [{"name": "empty"}]
    assert "buffers" not in tree
