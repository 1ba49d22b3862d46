import struct

import numpy as np
import psycopg
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray
from shapely import box

from semap.errors import InvalidInput
from semap.geometry.prism import extrude
from semap.geometry.tin import mesh_from_wkb, mesh_to_wkb
from semap.model.building import Mesh

TWO = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0.25]]), np.array([[0, 1, 2], [0, 2, 3]]))
TWO_TEXT = "TIN Z (((0 0 0,1 0 0,1 1 0.5,0 0 0)),((0 0 0,1 1 0.5,0 1 0.25,0 0 0)))"

coordinates = st.floats(-1e6, 1e6)
soups = arrays.arrays(np.float64, st.tuples(st.integers(0, 20), st.just(3), st.just(3)), elements=coordinates)


@given(soups)
def test_a_round_trip_keeps_every_triangle_and_merges_vertices(soup: NDArray[np.float64]) -> None:
    mesh = Mesh(soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3))
    back = mesh_from_wkb(mesh_to_wkb(mesh))
    assert np.array_equal(back.vertices_m[back.faces], soup)
    assert len(back.vertices_m) == len({tuple(corner + 0.0) for corner in soup.reshape(-1, 3)})


def test_a_box_comes_back_with_eight_vertices() -> None:
    back = mesh_from_wkb(mesh_to_wkb(extrude(box(0, 0, 1, 2), 0, 3)))
    assert back.vertices_m.shape == (8, 3)
    assert back.faces.shape == (12, 3)


def test_postgis_reads_what_is_written_and_writes_what_is_read(empty_database: str) -> None:
    with psycopg.connect(empty_database) as connection:
        connection.execute("create extension if not exists postgis")
        written = connection.execute(
            "select ST_AsText(%s::bytea::geometry), ST_AsEWKB(%s::bytea::geometry)",
            (mesh_to_wkb(TWO), mesh_to_wkb(TWO)),
        ).fetchone()
        read = connection.execute(
            "select ST_AsEWKB(ST_GeomFromText(%s)), ST_AsEWKB(ST_SetSRID(ST_GeomFromText(%s), 4978))",
            (TWO_TEXT, TWO_TEXT),
        ).fetchone()
    assert written == (TWO_TEXT, mesh_to_wkb(TWO))
    assert read is not None
    for wkb in read:
        back = mesh_from_wkb(wkb)
        assert np.array_equal(back.vertices_m[back.faces], TWO.vertices_m[TWO.faces])


def _with(offset: int, value: bytes) -> bytes:
    good = mesh_to_wkb(TWO)
    return good[:offset] + value + good[offset + len(value) :]


@pytest.mark.parametrize(
    "wkb",
    [
        b"",
        b"\x01",
        mesh_to_wkb(TWO)[:-1],
        mesh_to_wkb(TWO)[:9],
        mesh_to_wkb(TWO) + b"\0",
        _with(0, b"\0"),
        _with(1, struct.pack("<I", 0x8000000F)),
        _with(5, struct.pack("<I", 4_000_000_000)),
        _with(10, struct.pack("<I", 0x80000003)),
        _with(18, struct.pack("<I", 5)),
    ],
    ids=["empty", "byte", "cut", "header", "longer", "order", "type", "count", "part", "ring"],
)
def test_other_bytes_are_refused(wkb: bytes) -> None:
    with pytest.raises(InvalidInput, match="not a TIN Z"):
        mesh_from_wkb(wkb)
