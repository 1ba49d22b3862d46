"""Repairs of meshes, judged by trimesh."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from semap.geometry.repair import repaired
from semap.model.building import Mesh

SPHERE = trimesh.creation.icosphere(2)
BOX = trimesh.creation.box((1, 2, 3))


def mesh_of(*bodies: trimesh.Trimesh) -> Mesh:
    body = trimesh.util.concatenate(bodies)
    return Mesh(np.asarray(body.vertices, dtype=np.float64), np.asarray(body.faces, dtype=np.int64))


def body_of(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)


def reasons(mesh: Mesh) -> list[tuple[str, str]]:
    return [(finding.action, finding.reason) for finding in repaired(mesh)[1]]


def test_a_sound_mesh_stays_as_it_is() -> None:
    mesh = mesh_of(SPHERE)
    found, findings = repaired(mesh)
    assert np.array_equal(found.faces, mesh.faces)
    assert findings == ()


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_triangles_turned_dropped_and_repeated_are_put_right(seed: int) -> None:
    random = np.random.default_rng(seed)
    mesh = mesh_of(SPHERE)
    faces = mesh.faces.copy()
    turned = random.random(len(faces)) < random.random()
    faces[turned] = faces[turned, ::-1]
    spare = np.column_stack([faces[:5, 0], faces[:5, 0], faces[:5, 1]])
    rolled = np.roll(faces[random.integers(0, len(faces), 7)], 1, axis=1)
    mixed = random.permutation(np.concatenate([faces, spare, rolled]))
    found, findings = repaired(Mesh(mesh.vertices_m, mixed))
    body = body_of(found)
    assert body.is_watertight
    assert body.is_winding_consistent
    assert body.volume == pytest.approx(SPHERE.volume)
    assert len(found.faces) == len(mesh.faces)
    assert {finding.action for finding in findings} == {"repaired"}
    assert findings[0].reason == "5 degenerate triangles removed"
    assert "duplicate triangles removed" in findings[1].reason


def test_a_body_inside_out_is_turned_and_said_to_be() -> None:
    mesh = mesh_of(BOX)
    found, findings = repaired(Mesh(mesh.vertices_m, mesh.faces[:, ::-1]))
    assert body_of(found).volume == pytest.approx(6)
    assert [finding.reason for finding in findings] == ["1 bodies turned outwards"]


def test_a_cavity_stays_a_cavity_and_a_cupboard_a_cupboard() -> None:
    room = trimesh.creation.box((10, 10, 3))
    cupboard = trimesh.creation.box((1, 1, 1))
    cavity = cupboard.copy()
    cavity.invert()
    assert body_of(repaired(mesh_of(room, cupboard))[0]).volume == pytest.approx(301)
    assert body_of(repaired(mesh_of(room, cavity))[0]).volume == pytest.approx(299)
    beside = cavity.copy()
    beside.apply_translation((20, 0, 0))
    assert body_of(repaired(mesh_of(room, beside))[0]).volume == pytest.approx(301)


@pytest.mark.parametrize("missing", [1, 2, 3, 4])
def test_a_small_hole_is_closed(missing: int) -> None:
    fine = trimesh.creation.icosphere(6)
    mesh = mesh_of(fine)
    neighbours = fine.face_adjacency[(fine.face_adjacency == 0).any(axis=1)].sum(axis=1)
    around = [0, *neighbours][:missing]
    found, findings = repaired(Mesh(mesh.vertices_m, np.delete(mesh.faces, around, axis=0)))
    assert body_of(found).is_watertight
    assert body_of(found).volume == pytest.approx(fine.volume, rel=1e-3)
    assert [finding.reason for finding in findings] == ["1 small holes closed"]


def test_a_large_hole_and_a_sheet_stay_open_and_are_named() -> None:
    mesh = mesh_of(BOX)
    assert reasons(Mesh(mesh.vertices_m, mesh.faces[:-1])) == [
        ("note", "not closed: 3 edges have one triangle only")
    ]
    sheet = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    assert reasons(sheet) == [("note", "not closed: 4 edges have one triangle only")]
    three = Mesh(np.vstack([sheet.vertices_m, [[0, 0, 1]]]), np.array([[0, 1, 2], [0, 2, 3], [0, 2, 4]]))
    assert ("note", "1 edges have more than two triangles") in reasons(three)


def test_a_moebius_strip_is_named() -> None:
    around = np.arange(12)
    angle = around * 2 * np.pi / 12
    rim = np.array(
        [
            [
                (2 + side * np.cos(a / 2)) * np.cos(a),
                (2 + side * np.cos(a / 2)) * np.sin(a),
                side * np.sin(a / 2),
            ]
            for a in angle
            for side in (-0.5, 0.5)
        ]
    )
    faces = []
    for i in around:
        a, b = 2 * i, 2 * i + 1
        c, d = (2 * i + 2, 2 * i + 3) if i < 11 else (1, 0)
        faces += [[a, c, b], [b, c, d]]
    assert reasons(Mesh(rim, np.array(faces)))[0][1].startswith("a surface has one side only")


def test_nothing_but_degenerate_triangles() -> None:
    mesh = Mesh(np.zeros((2, 3)), np.array([[0, 0, 1]]))
    found, findings = repaired(mesh)
    assert found is mesh
    assert findings[0].action == "note"
