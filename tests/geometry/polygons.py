"""Random polygons and meshes, and what lies under a mesh by brute force."""

import numpy as np
import shapely
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semap.model.building import Mesh


@st.composite
def star_polygons(draw: st.DrawFn) -> Polygon:
    """Concave polygons around the origin, some with a hole, with corners in general position."""
    radii = draw(st.lists(st.integers(300, 900), min_size=3, max_size=16))
    turn = draw(st.floats(0, 1))
    outside = _star(np.array(radii) / 100, turn)
    holes = []
    if draw(st.booleans()):
        holes = [_star(np.array(draw(st.lists(st.integers(20, 100), min_size=3, max_size=6))) / 100, turn)]
    polygon = Polygon(outside, holes)
    return polygon if polygon.is_valid else Polygon(outside)


def _star(radii: NDArray[np.float64], turn: float) -> NDArray[np.float64]:
    angles = (np.arange(len(radii)) + turn) * 2 * np.pi / len(radii)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


@st.composite
def cell_polygons(draw: st.DrawFn) -> Polygon | MultiPolygon:
    """Unions of squares of a grid: separate parts, holes, holes and parts that touch at a corner."""
    cells = draw(st.sets(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1))
    squares = [shapely.box(0.7 * x, 0.7 * y, 0.7 * (x + 1), 0.7 * (y + 1)) for x, y in sorted(cells)]
    return shapely.union_all(squares).simplify(0)


def triangles_above(mesh: Mesh, point: NDArray[np.float64]) -> bool:
    """Whether the vertical line through a point (2,) meets a triangle of the mesh; tries every triangle."""
    a, b, c = (mesh.vertices_m[mesh.faces[:, i], :2] - point for i in range(3))
    sides = np.column_stack([_cross(a, b), _cross(b, c), _cross(c, a)])
    return bool(((sides > 0).all(axis=1) | (sides < 0).all(axis=1)).any())


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
