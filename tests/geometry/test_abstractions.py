"""Every abstraction against an oracle that shares nothing with it: trimesh, scipy, shapely, brute force."""

from collections import Counter

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from polygons import cell_polygons, star_polygons
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from shapely import MultiPolygon, Point, Polygon

from semap.errors import InvalidInput
from semap.geometry.abstractions import Abstraction, derive
from semap.geometry.pose import pose_from_matrix, pose_from_yaw, transform_mesh
from semap.geometry.prism import extrude
from semap.geometry.upright import upright
from semap.model.building import HeightBand, Mesh
from semap.model.pose import Pose
from semap.model.source_geometry import PolygonMesh, SourceGeometry

FLAT = ["FootprintHull", "FootprintBox", "AxisAligned2D", "Position2D"]
SOLID = ["Position3D", "AxisAligned3D", "BoundingBox", "BoundingHull"]
L_SHAPE = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])

seeds = st.integers(0, 2**32 - 1)


def by_type(sources: list[SourceGeometry] | Mesh) -> dict[str, Abstraction]:
    return {each.type: each for each in derive(sources)}


def mesh_in(found: dict[str, Abstraction], type_: str) -> Mesh:
    mesh = found[type_].geometry
    assert isinstance(mesh, Mesh)
    return mesh


def shape_in(found: dict[str, Abstraction], type_: str) -> shapely.Geometry:
    shape = found[type_].geometry
    assert not isinstance(shape, Mesh)
    return shape


def body_of(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)


def soup(seed: int) -> Mesh:
    """Random triangles in general position, some of them sharing vertices."""
    random = np.random.default_rng(seed)
    vertices_m = random.normal(0, 1, (int(random.integers(4, 40)), 3)) * random.uniform(0.1, 10, 3)
    faces = np.array([random.permutation(len(vertices_m))[:3] for _ in range(int(random.integers(2, 60)))])
    return Mesh(vertices_m + random.uniform(-100, 100, 3), faces)


def assert_closed(mesh: Mesh) -> None:
    directed = [tuple(edge) for edge in mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()]
    assert Counter(directed) == Counter((b, a) for a, b in directed)


def as_cloud(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return points[np.lexsort(np.round(points, 6).T)]


@settings(deadline=None)
@given(seeds)
def test_the_footprint_of_random_triangles_is_their_union(seed: int) -> None:
    mesh = soup(seed)
    union = shapely.union_all(
        shapely.polygons(mesh.vertices_m[mesh.faces][:, [0, 1, 2, 0], :2]), grid_size=1e-9
    )
    footprint = shape_in(by_type(mesh), "Footprint")
    assert footprint.is_valid
    # Hairlines of 0.2 mm are closed, so that they differ by less than that along the border.
    assert footprint.symmetric_difference(union).area <= 1e-4 * union.length


@settings(deadline=None)
@given(seeds)
def test_hulls_and_boxes_of_random_triangles(seed: int) -> None:
    mesh = soup(seed)
    used = mesh.vertices_m[np.unique(mesh.faces)]
    assume(len(used) > 4)
    found = by_type(mesh)
    assert list(found) == ["Footprint", *FLAT, *SOLID]
    around = ConvexHull(used)
    hull = mesh_in(found, "BoundingHull")
    assert_closed(hull)
    assert body_of(hull).volume == pytest.approx(around.volume, rel=1e-9)
    assert np.array_equal(as_cloud(hull.vertices_m), as_cloud(used[around.vertices]))
    assert (
        shape_in(found, "FootprintHull")
        .symmetric_difference(shapely.MultiPoint(used[:, :2]).convex_hull)
        .area
        <= 1e-12 * shape_in(found, "FootprintHull").area
    )
    assert shapely.get_coordinates(shape_in(found, "Position3D"), include_z=True)[0] == pytest.approx(
        trimesh.convex.convex_hull(used).center_mass, rel=1e-7, abs=1e-7
    )
    box = mesh_in(found, "BoundingBox")
    assert_closed(box)
    _, extents = trimesh.bounds.oriented_bounds(used)
    assert body_of(box).volume <= np.prod(extents) * (1 + 1e-6)
    assert body_of(box).volume >= around.volume
    assert inside(box, used)
    axis_aligned = mesh_in(found, "AxisAligned3D")
    assert_closed(axis_aligned)
    assert axis_aligned.vertices_m.min(axis=0).tolist() == used.min(axis=0).tolist()
    assert axis_aligned.vertices_m.max(axis=0).tolist() == used.max(axis=0).tolist()
    assert body_of(axis_aligned).volume == pytest.approx(np.prod(np.ptp(used, axis=0)))
    assert {(each.z_min_m, each.z_max_m) for each in found.values()} == {(used[:, 2].min(), used[:, 2].max())}


def inside(closed: Mesh, points: NDArray[np.float64]) -> bool:
    """Whether points lie behind every face of a convex mesh, but for float noise."""
    corners = closed.vertices_m[closed.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return bool((points @ normals.T - np.einsum("ij,ij->i", corners[:, 0], normals) < 1e-9).all())


@settings(deadline=None)
@given(seeds)
def test_the_footprint_box_is_the_smallest_rectangle(seed: int) -> None:
    found = by_type(soup(seed))
    hull, box = shape_in(found, "FootprintHull"), shape_in(found, "FootprintBox")
    assert box.area == pytest.approx(hull.minimum_rotated_rectangle.area, rel=1e-9)
    assert hull.difference(box.buffer(1e-9)).is_empty
    assert shapely.is_ccw(box.exterior)
    assert shape_in(found, "AxisAligned2D").equals(shapely.box(*hull.bounds))
    assert shape_in(found, "Position2D").equals(hull.centroid)


@settings(deadline=None)
@given(
    st.one_of(star_polygons(), cell_polygons()),
    st.floats(-3.1, 3.1),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-50, 50)),
)
def test_an_upright_pose_carries_every_abstraction(
    polygon: Polygon | MultiPolygon, yaw_rad: float, shift_m: tuple[float, float, float]
) -> None:
    map_T_body = pose_from_yaw(*shift_m, yaw_rad).matrix()
    body = extrude(polygon, 0.2, 2.4)
    own, moved = by_type(body), by_type(transform_mesh(map_T_body, body))
    assert list(own) == list(moved)
    for type_ in ("Footprint", "FootprintHull"):
        carried = shapely.transform(
            shape_in(own, type_), lambda xy: xy @ map_T_body[:2, :2].T + map_T_body[:2, 3]
        )
        assert carried.symmetric_difference(shape_in(moved, type_)).area <= 1e-9 * carried.area
    for type_ in ("Position2D", "Position3D"):
        place = shapely.get_coordinates(shape_in(own, type_), include_z=True)[0]
        expected = np.nan_to_num(place) @ map_T_body[:3, :3].T + map_T_body[:3, 3]
        size = 2 if type_ == "Position2D" else 3
        found = shapely.get_coordinates(shape_in(moved, type_), include_z=True)[0]
        assert found[:size] == pytest.approx(expected[:size], abs=1e-9, rel=1e-9)
    assert shape_in(moved, "FootprintBox").area == pytest.approx(shape_in(own, "FootprintBox").area, rel=1e-9)
    for type_ in ("BoundingHull", "BoundingBox"):
        volume = body_of(mesh_in(moved, type_)).volume
        assert volume == pytest.approx(body_of(mesh_in(own, type_)).volume, rel=1e-9)
    hull = transform_mesh(map_T_body, mesh_in(own, "BoundingHull"))
    assert inside(mesh_in(moved, "BoundingHull"), hull.vertices_m)
    assert inside(hull, mesh_in(moved, "BoundingHull").vertices_m)


@settings(deadline=None)
@given(
    st.one_of(star_polygons(), cell_polygons()),
    st.floats(-3.1, 3.1),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    st.floats(1e-3, 1e3),
)
def test_what_stands_upright_has_what_qhull_gives(
    polygon: Polygon | MultiPolygon, yaw_rad: float, shift_m: tuple[float, float], height_m: float
) -> None:
    flat = shapely.affinity.translate(shapely.affinity.rotate(polygon, yaw_rad, use_radians=True), *shift_m)
    body = extrude(flat, -0.4, height_m)
    found = by_type(body)
    # With the corners above in another order than those below it is taken for any body.
    order = np.argsort(body.vertices_m[:, 2], kind="stable")
    order[len(order) // 2 :] = order[len(order) // 2 :][::-1]
    other = Mesh(body.vertices_m[order], np.argsort(order)[body.faces])
    assert upright(other.vertices_m) is None
    expected = by_type(other)
    assert list(found) == list(expected)
    for type_, one in found.items():
        assert (one.z_min_m, one.z_max_m) == (-0.4, height_m)
        if type_ in ("Footprint", "FootprintHull", "AxisAligned2D"):
            one_shape, same_shape = shape_in(found, type_), shape_in(expected, type_)
            assert one_shape.symmetric_difference(same_shape).area <= 1e-9 * same_shape.area
    assert as_cloud(mesh_in(found, "AxisAligned3D").vertices_m) == pytest.approx(
        as_cloud(mesh_in(expected, "AxisAligned3D").vertices_m)
    )
    # qhull may leave out a corner that float noise made.
    hull, same_hull = mesh_in(found, "BoundingHull"), mesh_in(expected, "BoundingHull")
    assert_closed(hull)
    assert inside(hull, body.vertices_m)
    assert body_of(hull).volume == pytest.approx(body_of(same_hull).volume, rel=1e-9)
    box = mesh_in(found, "BoundingBox")
    assert_closed(box)
    assert inside(box, body.vertices_m)
    # Of equally small ones either may be taken.
    assert body_of(box).volume == pytest.approx(body_of(mesh_in(expected, "BoundingBox")).volume, rel=1e-9)
    centre, same_centre = (
        shapely.get_coordinates(shape_in(each, "Position3D"), include_z=True) for each in (found, expected)
    )
    assert centre == pytest.approx(same_centre, rel=1e-9, abs=1e-9)


def test_a_room_is_known_from_above() -> None:
    for yaw_rad in (0.0, 0.3):
        turned = shapely.affinity.rotate(L_SHAPE, yaw_rad, use_radians=True)
        assert upright(extrude(turned, 0, 2.5).vertices_m) is not None
    for thin in (shapely.box(0, 0, 4, 3e-6), shapely.box(1e10, 0, 1e10 + 4, 3)):
        assert upright(extrude(thin, 0, 2.5).vertices_m) is None
    assert upright(extrude(L_SHAPE, 0, 1e-6).vertices_m) is None


def test_a_box_does_not_turn_with_float_noise() -> None:
    table = extrude(shapely.box(-1, -0.4, 1, 0.4), 0.7, 0.75)
    for degrees in range(0, 180, 7):
        map_T_table = pose_from_yaw(3, -2, 1, np.radians(degrees)).matrix()
        found = by_type(transform_mesh(map_T_table, table))
        own = by_type(table)
        for type_ in ("BoundingBox", "BoundingHull"):
            carried = transform_mesh(map_T_table, mesh_in(own, type_)).vertices_m
            assert as_cloud(mesh_in(found, type_).vertices_m) == pytest.approx(as_cloud(carried), abs=1e-9)


def test_every_abstraction_of_a_room() -> None:
    body = extrude(L_SHAPE, 0.5, 3.0)
    # A vertex that no triangle uses belongs to no surface.
    found = by_type(Mesh(np.concatenate([body.vertices_m, [[99.0, 99.0, 99.0]]]), body.faces))
    assert list(found) == ["Footprint", *FLAT, *SOLID]
    assert shape_in(found, "Footprint").equals(L_SHAPE)
    assert shape_in(found, "FootprintHull").equals(L_SHAPE.convex_hull)
    assert shape_in(found, "Position3D").z == pytest.approx(1.75)
    assert body_of(mesh_in(found, "BoundingHull")).volume == pytest.approx(2.5 * L_SHAPE.convex_hull.area)
    assert body_of(mesh_in(found, "BoundingBox")).volume == pytest.approx(
        2.5 * shape_in(found, "FootprintBox").area
    )
    assert {(each.z_min_m, each.z_max_m) for each in found.values()} == {(0.5, 3.0)}


FLOOR = Mesh(np.array([[0.0, 0, 1], [4, 0, 1], [4, 2, 1], [0, 2, 1]]), np.array([[0, 1, 2], [0, 2, 3]]))


def tilted(mesh: Mesh, seed: int) -> Mesh:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    matrix[:3, 3] = 30, -20, 5
    return transform_mesh(matrix, mesh)


def test_a_floor_has_boxes_without_thickness() -> None:
    found = by_type(FLOOR)
    assert list(found) == ["Footprint", *FLAT, *SOLID]
    assert shapely.get_coordinates(shape_in(found, "Position3D"), include_z=True).tolist() == [[2, 1, 1]]
    for type_ in ("AxisAligned3D", "BoundingBox", "BoundingHull"):
        mesh = mesh_in(found, type_)
        assert_closed(mesh)
        assert set(map(tuple, np.round(mesh.vertices_m, 12).tolist())) == set(
            map(tuple, FLOOR.vertices_m.tolist())
        )
        assert body_of(mesh).area == pytest.approx(16)
    assert {(each.z_min_m, each.z_max_m) for each in found.values()} == {(None, None)}


@pytest.mark.parametrize("seed", range(20))
def test_a_flat_mesh_in_any_place(seed: int) -> None:
    found = by_type(tilted(FLOOR, seed))
    assert list(found) == ["Footprint", *FLAT, *SOLID]
    assert body_of(mesh_in(found, "BoundingHull")).area == pytest.approx(16)
    box = mesh_in(found, "BoundingBox")
    assert_closed(box)
    assert body_of(box).area == pytest.approx(16)
    middle = tilted(Mesh(np.array([[2.0, 1, 1]]), FLOOR.faces), seed).vertices_m[0]
    assert shapely.get_coordinates(shape_in(found, "Position3D"), include_z=True)[0] == pytest.approx(middle)


@pytest.mark.parametrize("yaw_rad", [0, 0.3, np.pi / 2])
def test_a_wall_has_no_area_from_above(yaw_rad: float) -> None:
    wall = Mesh(np.array([[1.0, 1, 0], [4, 1, 0], [4, 1, 2.5], [1, 1, 2.5]]), FLOOR.faces)
    found = by_type(transform_mesh(pose_from_yaw(0, 0, 0, yaw_rad).matrix(), wall))
    assert list(found) == ["Position2D", *SOLID]
    assert body_of(mesh_in(found, "BoundingBox")).area == pytest.approx(15)
    assert {(each.z_min_m, each.z_max_m) for each in found.values()} == {(0, 2.5)}
    assert shape_in(found, "Position2D").distance(Point(shape_in(found, "Position3D").coords[0][:2])) < 1e-9


def test_four_walls_enclose_an_area_but_cover_none() -> None:
    body = extrude(L_SHAPE, 0, 2)
    walls = Mesh(body.vertices_m, body.faces[np.ptp(body.vertices_m[body.faces, 2], axis=1) > 0])
    assert list(by_type(walls)) == [*FLAT, *SOLID]


@pytest.mark.parametrize(
    "corners",
    [
        [[1, 2, 3], [1, 2, 3], [1, 2, 3]],
        [[0, 0, 0], [1, 1, 1], [3, 3, 3]],
        [[1, 1, 0], [1, 1, 1], [1, 1, 5]],
    ],
    ids=["point", "slope", "mast"],
)
def test_what_is_collinear_has_only_positions(corners: list[list[float]]) -> None:
    found = by_type(Mesh(np.array(corners, dtype=np.float64), np.array([[0, 1, 2]])))
    assert list(found) == ["Position2D", "Position3D"]
    middle = (np.min(corners, axis=0) + np.max(corners, axis=0)) / 2
    assert (
        shapely.get_coordinates(shape_in(found, "Position3D"), include_z=True)[0].tolist() == middle.tolist()
    )


@settings(deadline=None)
@given(st.integers(1, 6), st.lists(st.tuples(*[st.integers(-2, 2)] * 3), min_size=3, max_size=12), seeds)
@example(1, [(0, 0, 0), (0, 0, 0), (1, 0, 0)], 0)
def test_no_mesh_is_too_degenerate(scale: int, corners: list[tuple[int, int, int]], seed: int) -> None:
    points = np.array(corners, dtype=np.float64) * 10.0**-scale
    random = np.random.default_rng(seed)
    mesh = Mesh(points, random.integers(0, len(points), (6, 3)))
    found = by_type(mesh)
    assert {"Position2D", "Position3D"} <= set(found)
    assert ("BoundingHull" in found) == ("BoundingBox" in found) == ("AxisAligned3D" in found)
    for each in found.values():
        if isinstance(each.geometry, Mesh):
            assert_closed(each.geometry)
            assert inside_or_flat(each.geometry, mesh.vertices_m[np.unique(mesh.faces)])
        else:
            assert each.geometry.is_valid
            assert not each.geometry.is_empty


def inside_or_flat(closed: Mesh, points: NDArray[np.float64]) -> bool:
    corners = closed.vertices_m[closed.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    keep = lengths > 1e-12 * lengths.max()
    normals = normals[keep] / lengths[keep, None]
    return bool((points @ normals.T - np.einsum("ij,ij->i", corners[keep, 0], normals) < 1e-9).all())


def test_a_polygon_has_no_space_unless_it_has_heights() -> None:
    area = SourceGeometry("area", "POLYGON2D", L_SHAPE)
    found = by_type([area])
    assert list(found) == ["Footprint", *FLAT]
    assert {(each.z_min_m, each.z_max_m) for each in found.values()} == {(None, None)}
    with_heights = by_type([SourceGeometry("area", "POLYGON2D", L_SHAPE, band=HeightBand(1, 3))])
    assert list(with_heights) == ["Footprint", *FLAT, *SOLID]
    assert body_of(mesh_in(with_heights, "BoundingHull")).volume == pytest.approx(
        2 * L_SHAPE.convex_hull.area
    )
    assert {(each.z_min_m, each.z_max_m) for each in with_heights.values()} == {(1, 3)}


def test_an_explicit_outline_wins_over_the_mesh_on_the_plane_and_only_there() -> None:
    body = extrude(shapely.box(10, 10, 12, 12), 0, 3)
    outline = SourceGeometry("Outline", "POLYGON2D", L_SHAPE, Pose(z_m=1), HeightBand(0, 2))
    mesh = SourceGeometry("Body", "TRIANGLEMESH3D", body)
    both, alone = by_type([outline, mesh]), by_type(body)
    assert shape_in(both, "Footprint").equals(L_SHAPE)
    assert {(both[type_].z_min_m, both[type_].z_max_m) for type_ in ["Footprint", *FLAT]} == {(1, 3)}
    for type_ in ("AxisAligned3D", "BoundingBox", "BoundingHull"):
        assert np.array_equal(mesh_in(both, type_).vertices_m, mesh_in(alone, type_).vertices_m)
    assert both["Position3D"].geometry == alone["Position3D"].geometry
    assert (both["Position3D"].z_min_m, both["Position3D"].z_max_m) == (0, 3)


def test_points_and_poses_have_positions() -> None:
    spot = SourceGeometry("spot", "POINT2D", Point(1, 2), Pose(10, 20, 30))
    assert [(each.type, each.geometry.wkt) for each in derive([spot])] == [("Position2D", "POINT (11 22)")]
    pose = SourceGeometry("grasp", "POSE3D", Point(1, 2, 3), pose_from_yaw(10, 20, 30, np.pi / 2))
    found = by_type([pose])
    assert list(found) == ["Position2D", "Position3D"]
    assert shapely.get_coordinates(shape_in(found, "Position3D"), include_z=True)[0] == pytest.approx(
        [8, 21, 33]
    )
    # Beside a body it is a mark on it, and does not enlarge it.
    body = SourceGeometry("Body", "TRIANGLEMESH3D", extrude(L_SHAPE, 0, 1))
    assert by_type([pose, body])["BoundingHull"].z_max_m == 1


def test_polygons_in_space_and_polygon_meshes() -> None:
    ramp = Polygon(
        [(0, 0, 0), (4, 0, 2), (4, 3, 2), (0, 3, 0)], [[(1, 1, 0.5), (1, 2, 0.5), (2, 2, 1), (2, 1, 1)]]
    )
    found = by_type([SourceGeometry("ramp", "POLYGON3D", ramp)])
    assert shape_in(found, "Footprint").equals(Polygon(shapely.force_2d(ramp)))
    cube = PolygonMesh(
        np.array([[x, y, z] for x in (0.0, 2.0) for y in (0.0, 1.0) for z in (0.0, 3.0)]),
        ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)),
    )
    cube_found = by_type([SourceGeometry("cube", "POLYGONMESH3D", cube)])
    assert body_of(mesh_in(cube_found, "BoundingBox")).volume == pytest.approx(6)
    assert shape_in(cube_found, "Footprint").equals(shapely.box(0, 0, 2, 1))


def test_a_tilted_outline_is_seen_from_above() -> None:
    up = np.eye(4)
    up[:3, :3] = Rotation.from_euler("x", 60, degrees=True).as_matrix()
    square = SourceGeometry("Outline", "POLYGON2D", shapely.box(0, 0, 2, 2), pose_from_matrix(up))
    assert shape_in(by_type([square]), "Footprint").equals_exact(
        shapely.box(0, 0, 2, 1), 1e-9, normalize=True
    )


@pytest.mark.parametrize(
    "source",
    [
        SourceGeometry("Body", "TRIANGLEMESH3D", Mesh(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int64))),
        SourceGeometry("Body", "TRIANGLEMESH3D", Mesh(np.zeros((3, 3)), np.array([[0, 1, 3]]))),
        SourceGeometry("Body", "TRIANGLEMESH3D", Mesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]]))),
        SourceGeometry("roof", "POLYGON3D", Polygon([(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 0)])),
        SourceGeometry("cube", "POLYGONMESH3D", PolygonMesh(np.zeros((3, 3)), ((0, 1),))),
        SourceGeometry("cube", "POLYGONMESH3D", PolygonMesh(np.zeros((3, 3)), ((0, 1, 5),))),
        SourceGeometry("area", "POLYGON2D", L_SHAPE, band=HeightBand(2, 2)),
    ],
    ids=["empty", "index", "nan", "bent", "two corners", "corner", "heights"],
)
def test_what_is_no_geometry_is_refused(source: SourceGeometry) -> None:
    with pytest.raises(InvalidInput) as refusal:
        derive([source])
    assert refusal.value.remedy


def test_nothing_gives_nothing() -> None:
    assert derive([]) == ()
