import io

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from map_documents import content, meshes

from semap.errors import InvalidInput
from semap.formats.ply import is_own_ply, read_ply, read_polygon_ply, write_ply
from semap.model.building import Mesh
from semap.model.source_geometry import PolygonMesh


@given(meshes())
def test_every_bit_comes_back(mesh: Mesh | PolygonMesh) -> None:
    data = write_ply(mesh)
    assert is_own_ply(data)
    found = read_ply(data) if isinstance(mesh, Mesh) else read_polygon_ply(data)
    assert content(found) == content(mesh)


def test_other_programs_read_it() -> None:
    box = trimesh.creation.box(extents=(1, 2, 3))
    data = write_ply(Mesh(np.asarray(box.vertices), np.asarray(box.faces)))
    found = trimesh.load(io.BytesIO(data), file_type="ply")
    assert found.volume == pytest.approx(6.0)
    faces = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    data = write_ply(PolygonMesh(np.asarray(box.vertices), faces))
    assert trimesh.load(io.BytesIO(data), file_type="ply").area == pytest.approx(22.0)


@given(meshes(), st.data())
def test_damaged_bytes_are_refused_or_a_mesh_whose_faces_name_its_vertices(mesh, data) -> None:
    good = write_ply(mesh)
    at = data.draw(st.integers(0, len(good)))
    bad = good[:at] + data.draw(st.binary(max_size=4)) + good[at + data.draw(st.integers(0, 8)) :]
    for read in (read_ply, read_polygon_ply):
        try:
            found = read(bad, "map.yaml:1:1")
        except InvalidInput as error:
            assert error.where == "map.yaml:1:1"  # noqa: PT017
        else:
            corners = [corner for face in found.faces for corner in face]
            assert all(0 <= corner < len(found.vertices_m) for corner in corners)
            assert np.isfinite(found.vertices_m).all()
