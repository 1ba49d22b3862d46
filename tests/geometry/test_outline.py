import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from polygons import cell_polygons, star_polygons, triangles_above
from scipy.spatial.transform import Rotation
from shapely import MultiPolygon, Point, Polygon

from semap.errors import InvalidInput
from semap.geometry.outline import outline
from semap.geometry.pose import transform_mesh
from semap.geometry.prism import extrude
from semap.model.building import Mesh

L_SHAPE = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])


def mesh_of(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(shape.vertices, dtype=np.float64), np.asarray(shape.faces, dtype=np.int64))


def without(mesh: Mesh, is_left_out: NDArray[np.bool_]) -> Mesh:
    return Mesh(mesh.vertices_m, mesh.faces[~is_left_out])


def is_wall(mesh: Mesh) -> NDArray[np.bool_]:
    return np.ptp(mesh.vertices_m[mesh.faces, 2], axis=1) > 0


@given(st.one_of(star_polygons(), cell_polygons()))
def test_the_outline_of_a_prism_is_its_footprint(polygon: Polygon | MultiPolygon) -> None:
    footprint = outline(extrude(polygon, 0.3, 2.8))
    assert footprint.is_valid
    assert footprint.symmetric_difference(polygon).area <= 1e-9
    assert shapely.get_num_coordinates(footprint) == shapely.get_num_coordinates(polygon)


@given(star_polygons(), st.floats(-3.1, 3.1), st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)))
def test_turned_walls_leave_no_slivers(polygon: Polygon, yaw: float, shift: tuple[float, float]) -> None:
    map_T_body = np.eye(4)
    map_T_body[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    map_T_body[:2, 3] = shift
    body = extrude(polygon, 0, 2.5)
    # Heights computed apart, as from a file with other digits.
    noise = np.random.default_rng(0).normal(0, 1e-9, body.vertices_m.shape)
    footprint = outline(transform_mesh(map_T_body, Mesh(body.vertices_m + noise, body.faces)))
    expected = shapely.transform(polygon, lambda xy: xy @ map_T_body[:2, :2].T + map_T_body[:2, 3])
    assert footprint.symmetric_difference(expected).area < 1e-5
    assert shapely.get_num_coordinates(footprint) <= shapely.get_num_coordinates(polygon)


@pytest.mark.parametrize("seed", range(8))
def test_a_point_is_inside_exactly_if_a_vertical_ray_meets_the_mesh(seed: int) -> None:
    random = np.random.default_rng(seed)
    map_T_body = np.eye(4)
    map_T_body[:3, :3] = Rotation.random(rng=random).as_matrix()
    shapes = [extrude(L_SHAPE, 0, 0.5), mesh_of(trimesh.creation.torus(2, 0.4, 24, 12))]
    mesh = transform_mesh(map_T_body, shapes[seed % 2])
    footprint = outline(mesh)
    assert footprint.is_valid
    low, high = mesh.vertices_m[:, :2].min(axis=0), mesh.vertices_m[:, :2].max(axis=0)
    for point in random.uniform(low, high, (400, 2)):
        if footprint.boundary.distance(Point(point)) > 1e-3:
            assert footprint.contains(Point(point)) == triangles_above(mesh, point)


def test_holes_stay() -> None:
    torus = mesh_of(trimesh.creation.torus(2, 0.5, 64, 32))
    footprint = outline(torus)
    assert isinstance(footprint, Polygon)
    assert len(footprint.interiors) == 1
    assert footprint.area == pytest.approx(32 * np.sin(np.pi / 32) * (2.5**2 - 1.5**2))


@pytest.mark.parametrize("gap_m", [1e-7, 1e-5, 1.5e-4])
def test_a_hairline_between_slabs_is_closed(gap_m: float) -> None:
    left, right = shapely.box(0, 0, 2, 3), shapely.box(2 + gap_m, 0, 4, 3)
    footprint = outline(extrude(MultiPolygon([left, right]), 0, 1))
    assert isinstance(footprint, Polygon)
    assert shapely.get_num_coordinates(footprint) == 5
    assert footprint.symmetric_difference(shapely.box(0, 0, 4, 3)).area < 1e-6


def test_a_gap_that_is_more_than_a_hairline_stays() -> None:
    slabs = MultiPolygon([shapely.box(0, 0, 2, 3), shapely.box(2.001, 0, 4, 3)])
    assert outline(extrude(slabs, 0, 1)).equals(slabs)


def test_a_mesh_needs_neither_walls_nor_floor_nor_one_winding() -> None:
    body = extrude(L_SHAPE, 0, 2)
    roof = without(body, is_wall(body) | (body.vertices_m[body.faces[:, 0], 2] < 1))
    torn = Mesh(
        roof.vertices_m, np.where(np.arange(len(roof.faces))[:, None] % 2, roof.faces[:, ::-1], roof.faces)
    )
    assert outline(roof).equals(L_SHAPE)
    assert outline(torn).equals(L_SHAPE)


def test_holes_that_touch_a_shared_line_from_both_sides() -> None:
    """Turned, the line is two lines a float apart; the corridor between them joins the holes."""
    cells = {(x, y) for x in range(5) for y in range(5)} - {(1, 1), (2, 3), (2, 2), (3, 1)}
    for missing in ((1, 2), (2, 1), (1, 3), (3, 2), (3, 3)):
        squares = [shapely.box(0.7 * x, 0.7 * y, 0.7 * (x + 1), 0.7 * (y + 1)) for x, y in cells - {missing}]
        polygon = shapely.union_all(squares).simplify(0)
        for yaw in np.linspace(0.01, 3, 40):
            map_T_body = np.eye(4)
            map_T_body[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
            map_T_body[:2, 3] = 17, 62
            expected = shapely.transform(polygon, lambda xy, m=map_T_body: xy @ m[:2, :2].T + m[:2, 3])
            footprint = outline(transform_mesh(map_T_body, extrude(polygon, 0, 1)))
            assert footprint.symmetric_difference(expected).area < 1e-8


def test_walls_alone_have_no_outline() -> None:
    body = extrude(L_SHAPE, 0, 2)
    walls = without(body, ~is_wall(body))
    with pytest.raises(InvalidInput, match="neither floor nor ceiling") as refusal:
        outline(walls)
    assert "outline" in refusal.value.remedy
    turned = np.eye(4)
    turned[:3, :3] = Rotation.from_euler("z", 0.7).as_matrix()
    with pytest.raises(InvalidInput):
        outline(transform_mesh(turned, walls))


def test_a_million_triangles_have_an_outline() -> None:
    sphere = mesh_of(trimesh.creation.icosphere(subdivisions=8))
    assert len(sphere.faces) > 1_000_000
    footprint = outline(sphere)
    assert footprint.area == pytest.approx(np.pi, rel=1e-4)
