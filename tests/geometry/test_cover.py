"""What is dropped before an outline is cut must not change it."""

from unittest.mock import patch

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shapely import Point

from semap.geometry import cover
from semap.geometry.cover import uncovered
from semap.geometry.grid import CELLS, classified, grid_over, point_counts, prefix_sums
from semap.geometry.outline import outline
from semap.geometry.projection import project
from semap.geometry.section import Sections, winding_numbers
from semap.geometry.union import united
from semap.model.building import Mesh

seeds = st.integers(0, 2**32 - 1)


def crumpled(seed: int) -> Mesh:
    """Overlapping folded bodies and loose triangles, some wound inwards, some open."""
    random = np.random.default_rng(seed)
    parts = []
    for _ in range(int(random.integers(1, 6))):
        body = [
            trimesh.creation.icosphere(1),
            trimesh.creation.torus(1, 0.3, 10, 6),
            trimesh.creation.box(),
        ][int(random.integers(3))]
        vertices_m = body.vertices + random.normal(0, random.uniform(0, 0.15), body.vertices.shape)
        vertices_m = Rotation.random(rng=random).apply(vertices_m * random.uniform(0.2, 2, 3))
        faces = body.faces[random.random(len(body.faces)) < random.choice([1, 1, 0.9])]
        parts.append(
            (vertices_m + random.uniform(-2, 2, 3), faces if random.random() < 0.7 else faces[:, ::-1])
        )
    starts = np.cumsum([0, *(len(vertices_m) for vertices_m, _ in parts[:-1])])
    return Mesh(
        np.concatenate([vertices_m for vertices_m, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=True)]).astype(
            np.int64
        ),
    )


def union_of(mesh: Mesh) -> shapely.Geometry:
    """By brute force."""
    triangles = shapely.polygons(mesh.vertices_m[mesh.faces][:, [0, 1, 2, 0], :2])
    return shapely.union_all(triangles, grid_size=1e-9)


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_an_outline_that_was_thinned_out_is_still_the_union(seed: int) -> None:
    mesh = crumpled(seed)
    with patch.object(cover, "ENOUGH", 0):
        footprint = outline(mesh)
    union = union_of(mesh)
    assert footprint.is_valid
    assert footprint.symmetric_difference(union).area <= 1e-4 * union.length


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_what_is_dropped_lies_inside_and_most_of_it_is_dropped(seed: int) -> None:
    mesh = crumpled(seed)
    projection = project(mesh)
    sections = Sections(projection)
    with patch.object(cover, "ENOUGH", 0):
        left = {tuple(edge) for edge in uncovered(projection, sections).tolist()}
    dropped = np.array([edge for edge in sections.borders().tolist() if tuple(edge) not in left])
    if len(dropped):
        inner = union_of(mesh).buffer(1e-7)
        shapely.prepare(inner)
        assert shapely.contains_properly(inner, shapely.linestrings(projection.corners_m[dropped])).all()


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_a_section_is_covered(seed: int) -> None:
    mesh = crumpled(seed)
    union = union_of(mesh).buffer(1e-6)
    sections = Sections(project(mesh))
    for height_m in np.quantile(mesh.vertices_m[:, 2], [0, 0.3, 0.5, 0.9]):
        assert sections.region_above(float(height_m)).difference(union).is_empty


def test_the_section_of_a_ball_is_a_disc_whatever_its_noise() -> None:
    ball = trimesh.creation.icosphere(4)
    random = np.random.default_rng(0)
    noisy = Mesh(ball.vertices * random.normal(1, 0.02, (len(ball.vertices), 1)), ball.faces.astype(np.int64))
    region = Sections(project(noisy)).region_above(0.0)
    assert region.area == pytest.approx(np.pi, rel=0.03)
    with patch.object(cover, "ENOUGH", 0):
        left = uncovered(project(noisy), Sections(project(noisy)))
    assert len(left) < 0.2 * len(Sections(project(noisy)).borders())


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_winding_numbers_of_loops(seed: int) -> None:
    random = np.random.default_rng(seed)
    ring = random.uniform(-1, 1, (7, 2))
    edges = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
    points = random.uniform(-1, 1, (20, 2))
    turned = np.arctan2(*np.moveaxis(edges[None] - points[:, None, None], -1, 0)[::-1])
    steps = (np.diff(turned, axis=2)[..., 0] + np.pi) % (2 * np.pi) - np.pi
    expected = np.round(steps.sum(axis=1) / (2 * np.pi)).astype(int)
    counts = np.ones(7, dtype=np.int32)
    assert winding_numbers(points, edges, counts).tolist() == expected.tolist()
    assert winding_numbers(points, edges, 3 * counts).tolist() == (3 * expected).tolist()


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_the_cells_of_a_grid_lie_as_they_are_classified(seed: int) -> None:
    random = np.random.default_rng(seed)
    region = shapely.union_all([Point(xy).buffer(r, 5) for *xy, r in random.uniform(0.01, 1, (4, 3))])
    grid = grid_over(shapely.get_coordinates(region))
    touched, inside = classified(grid, region, 1e-6)
    assert not (touched & inside).any()
    for place in random.integers(0, CELLS, (300, 2)):
        low, high = grid.low_m + place / grid.scale, grid.low_m + (place + 1) / grid.scale
        cell = shapely.box(*low, *high)
        assert touched[tuple(place + 1)] or inside[tuple(place + 1)] == region.contains(cell)
        assert touched[tuple(place + 1)] or not region.boundary.intersects(cell)


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_marks_in_boxes_are_counted(seed: int) -> None:
    random = np.random.default_rng(seed)
    points, low = random.uniform(-3, 3, (50, 2)), random.uniform(-5, 5, (30, 2))
    high = low + random.uniform(0, 5, (30, 2))
    grid = grid_over(points)
    counted = grid.counts_in(prefix_sums(point_counts(grid, points)), low, high)
    exact = ((points >= low[:, None]) & (points <= high[:, None])).all(axis=2).sum(axis=1)
    assert (counted >= exact).all()
    reach = 1 / grid.scale
    wide = ((points >= low[:, None] - reach) & (points <= high[:, None] + reach)).all(axis=2).sum(axis=1)
    assert (counted <= wide).all()


def test_a_union_that_geos_refuses_is_made_on_a_grid() -> None:
    squares = [shapely.box(0, 0, 1, 1), shapely.box(1, 0, 2, 1)]
    real = shapely.union_all

    def refusing(shapes: object, grid_size: float | None = None) -> shapely.Geometry:
        if grid_size is None:
            raise shapely.errors.GEOSException("TopologyException: found non-noded intersection")
        return real(shapes, grid_size=grid_size)

    with patch.object(shapely, "union_all", refusing):
        assert united(squares).equals(shapely.box(0, 0, 2, 1))
