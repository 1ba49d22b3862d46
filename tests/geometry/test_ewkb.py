"""Every shape of a source geometry to PostGIS and back."""

import struct
from contextlib import suppress

import numpy as np
import psycopg
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import MultiPolygon, Point, Polygon

from semap.errors import InvalidInput
from semap.geometry.ewkb import from_ewkb, to_ewkb
from semap.geometry.prism import extrude
from semap.geometry.triangulation import triangulated
from semap.model.building import Mesh
from semap.model.source_geometry import PolygonMesh

CUBE = PolygonMesh(
    np.array([[x, y, z] for x in (0.0, 2.0) for y in (0.0, 1.0) for z in (0.0, 3.0)]),
    ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)),
)
SHAPES = {
    "POINT": Point(1, 2),
    "POINT Z": Point(1, 2, 3),
    "POLYGON": Polygon([(0, 0), (3, 0), (0, 3)], [[(0.5, 0.5), (1, 0.5), (0.5, 1)]]),
    "MULTIPOLYGON": MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)]),
    "POLYGON Z": Polygon([(0, 0, 0), (4, 0, 2), (4, 3, 2), (0, 3, 0)]),
}


def rings(mesh: PolygonMesh) -> list[list[list[float]]]:
    return [mesh.vertices_m[list(face)].tolist() for face in mesh.faces]


def test_every_shape_comes_back_from_postgis(empty_database: str) -> None:
    with psycopg.connect(empty_database) as connection:
        connection.execute("create extension if not exists postgis")

        def there_and_back(ewkb: bytes) -> tuple[str, bytes]:
            row = connection.execute(
                "select st_astext(%s::bytea::geometry), st_asewkb(%s::bytea::geometry)", (ewkb, ewkb)
            ).fetchone()
            assert row is not None
            return row

        for text, shape in SHAPES.items():
            written, ewkb = there_and_back(to_ewkb(shape))
            assert written.startswith(f"{text} (" if text.endswith("Z") else f"{text}(")
            back = from_ewkb(ewkb)
            assert isinstance(back, shapely.Geometry)
            assert shapely.equals_identical(back, shape)
        written, ewkb = there_and_back(to_ewkb(CUBE))
        assert written.startswith("POLYHEDRALSURFACE Z (((0 0 0,0 0 3,0 1 3,0 1 0,0 0 0)),")
        back = from_ewkb(ewkb)
        assert isinstance(back, PolygonMesh)
        assert rings(back) == rings(CUBE)
        body = extrude(shapely.box(0, 0, 1, 2), 0, 3)
        back = from_ewkb(there_and_back(to_ewkb(body))[1])
        assert isinstance(back, Mesh)
        assert np.array_equal(back.vertices_m[back.faces], body.vertices_m[body.faces])


def test_a_polygon_mesh_in_triangles_keeps_its_winding() -> None:
    cube = triangulated(CUBE)
    a, b, c = (cube.vertices_m[cube.faces[:, i]] for i in range(3))
    assert cube.faces.shape == (12, 3)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(6)


@given(st.binary(max_size=100))
def test_random_bytes_are_a_shape_or_a_refusal(data: bytes) -> None:
    for head in (b"", struct.pack("<BI", 1, 0x8000000F), struct.pack("<BI", 1, 0x80000010)):
        with suppress(InvalidInput):
            from_ewkb(head + data)


@pytest.mark.parametrize("cut", [1, 5, 9, 13, 30, -1])
def test_a_polygon_mesh_cut_short_is_refused(cut: int) -> None:
    with pytest.raises(InvalidInput):
        from_ewkb(to_ewkb(CUBE)[:cut])
    with pytest.raises(InvalidInput):
        from_ewkb(to_ewkb(CUBE) + b"\0")
