import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from polygons import cell_polygons, star_polygons
from shapely import MultiPolygon, Polygon

from semap.errors import InvalidInput
from semap.geometry.prism import extrude


@given(star_polygons())
def test_a_prism_is_closed_points_outwards_and_has_the_volume_of_its_footprint(polygon: Polygon) -> None:
    prism = extrude(polygon, -1.5, 2.0)
    body = trimesh.Trimesh(prism.vertices_m, prism.faces, process=False)
    assert body.is_watertight
    assert body.is_winding_consistent
    assert body.volume == pytest.approx(3.5 * polygon.area)
    assert body.bounds[:, 2].tolist() == [-1.5, 2.0]


@given(cell_polygons())
def test_parts_and_holes_that_touch_keep_the_volume(polygon: Polygon | MultiPolygon) -> None:
    prism = extrude(polygon, 0.0, 2.0)
    assert trimesh.Trimesh(prism.vertices_m, prism.faces, process=False).volume == pytest.approx(
        2 * polygon.area
    )


def test_a_prism_keeps_the_corners_exactly() -> None:
    polygon = Polygon([(0.1, 0.2), (4.3, 0.7), (1.1, 0.9), (0.3, 5.1)])
    corners = {tuple(corner) for corner in extrude(polygon, 0, 1).vertices_m[:, :2].tolist()}
    assert corners == set(polygon.exterior.coords)


@pytest.mark.parametrize(
    ("footprint", "z_max_m"),
    [
        (Polygon(), 1.0),
        (shapely.box(0, 0, 1, 1), 0.0),
        (shapely.box(0, 0, 1, 1), -1.0),
        (shapely.box(0, 0, 1, 1), np.nan),
        (Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), 1.0),
    ],
)
def test_what_is_no_prism_is_refused(footprint: Polygon, z_max_m: float) -> None:
    with pytest.raises(InvalidInput) as refusal:
        extrude(footprint, 0.0, z_max_m)
    assert refusal.value.remedy
