import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from mesh_bytes import exported

from semap.errors import InvalidInput, TooLarge
from semap.formats.mesh_file import FILE_TYPES, read_mesh
from semap.model.building import Mesh

BOX = trimesh.creation.box((1, 2, 3))
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def volume(mesh: Mesh) -> float:
    return float(trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False).volume)


@pytest.mark.parametrize(
    ("file_type", "size_m"),
    [("obj", [1, 2, 3]), ("ply", [1, 2, 3]), ("stl", [1, 2, 3]), ("glb", [1, 3, 2]), (".GLB", [1, 3, 2])],
)
def test_a_box_is_read_z_up_with_merged_vertices(file_type: str, size_m: list[float]) -> None:
    mesh = read_mesh(exported(BOX, file_type.lower().lstrip(".")), file_type)
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx(size_m)
    assert (mesh.vertices_m.shape, mesh.faces.shape) == ((8, 3), (12, 3))
    assert (mesh.vertices_m.dtype, mesh.faces.dtype) == (np.float64, np.int64)
    assert volume(mesh) == pytest.approx(6.0)


def test_up_in_gltf_is_up_here() -> None:
    tip = trimesh.Trimesh([[1, 0, 0], [0, 5, 0], [0, 0, 2]], [[0, 1, 2]], process=False)
    assert {tuple(corner) for corner in read_mesh(exported(tip, "glb"), "glb").vertices_m.tolist()} == {
        (1, 0, 0),
        (0, 0, 5),
        (0, -2, 0),
    }


def test_parts_of_a_scene_stand_where_it_places_them() -> None:
    scene = trimesh.Scene(BOX)
    scene.add_geometry(BOX, transform=trimesh.transformations.translation_matrix([10, 0, 0]))
    scene.add_geometry(
        BOX, transform=np.diag([1.0, 1.0, -1.0, 1.0]) @ trimesh.transformations.translation_matrix([20, 0, 0])
    )
    mesh = read_mesh(exported(scene, "glb"), "glb")
    assert len(mesh.faces) == 36
    assert mesh.vertices_m[:, 0].max() == pytest.approx(20.5)
    # The mirrored one too points outwards.
    assert volume(mesh) == pytest.approx(18.0)


@pytest.mark.parametrize("file_type", FILE_TYPES)
def test_limits_hold(file_type: str) -> None:
    data = exported(BOX, file_type)
    with pytest.raises(TooLarge, match="bytes") as refusal:
        read_mesh(data, file_type, max_bytes=len(data) - 1)
    assert refusal.value.remedy
    with pytest.raises(TooLarge, match="triangles"):
        read_mesh(data, file_type, max_faces=11)
    assert len(read_mesh(data, file_type, max_bytes=len(data), max_faces=12).faces) == 12


def test_one_mesh_placed_many_times_is_counted_before_it_is_copied() -> None:
    scene = trimesh.Scene()
    for place in range(50):
        scene.add_geometry(
            BOX, geom_name="box", transform=trimesh.transformations.translation_matrix([place, 0, 0])
        )
    with pytest.raises(TooLarge):
        read_mesh(exported(scene, "glb"), "glb", max_faces=599)


@pytest.mark.parametrize("file_type", ["zip", "xyz", "", "step", "../glb"])
def test_other_formats_are_refused(file_type: str) -> None:
    with pytest.raises(InvalidInput, match="no mesh format") as refusal:
        read_mesh(exported(BOX, "glb"), file_type)
    assert "glb, gltf, obj, ply, stl, off, dae, 3mf" in refusal.value.remedy


def glb(tree: object, binary: bytes = b"") -> bytes:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf(accessors: list[dict[str, object]], **members: object) -> dict[str, object]:
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": accessors,
        **members,
    }


POSITIONS: dict[str, object] = {"componentType": 5126, "type": "VEC3"}
OUTSIDE = gltf(
    [POSITIONS | {"count": 3, "bufferView": 0}],
    bufferViews=[{"buffer": 0, "byteLength": 36}],
    buffers=[{"uri": "file.bin", "byteLength": 36}],
)


@pytest.mark.parametrize(
    ("data", "file_type"),
    [
        (b"", "glb"),
        (b"glTF", "glb"),
        (b"\0" * 64, "glb"),
        (glb([]), "glb"),
        (glb({"asset": {"version": "2.0"}}), "glb"),
        (glb(gltf([{}])), "glb"),
        (glb(gltf([POSITIONS | {"count": 3, "bufferView": 9}])), "glb"),
        (glb(OUTSIDE), "glb"),
        (b"", "obj"),
        (TRIANGLE, "obj"),
        (TRIANGLE + b"f 1 2 9\n", "obj"),
        (TRIANGLE + b"f 1 2 x\n", "obj"),
        (b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "obj"),
        (b"v 0 0 1e999\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "obj"),
        (b"", "ply"),
        (b"ply\nformat ascii 1.0\n", "ply"),
        (b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n1\n", "ply"),
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty float x\n"
            b"property float y\nproperty float z\nend_header\n",
            "ply",
        ),
        (b"", "stl"),
        (b"\0" * 80 + b"\xff\xff\xff\xff" + b"\0" * 50, "stl"),
        (exported(BOX, "stl")[:-3], "stl"),
        (b"\0" * 84, "stl"),
        (b"solid nothing\nendsolid\n", "stl"),
        (exported(BOX, "ply"), "stl"),
        (exported(BOX, "glb"), "ply"),
        (exported(BOX, "glb")[:-8], "glb"),
        (exported(BOX, "ply")[:-1], "ply"),
    ],
)
def test_bytes_that_are_no_mesh_are_refused(data: bytes, file_type: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        read_mesh(data, file_type)
    assert refusal.value.remedy


def test_an_array_that_is_announced_but_not_there_is_not_made() -> None:
    with pytest.raises(TooLarge, match="announces"):
        read_mesh(glb(gltf([POSITIONS | {"count": 10**11}])), "glb")


def test_not_a_number_is_refused_in_every_format() -> None:
    holed = trimesh.Trimesh(np.where(BOX.vertices > 0.9, np.nan, BOX.vertices), BOX.faces, process=False)
    for file_type in ("ply", "stl", "glb"):
        with pytest.raises(InvalidInput, match="not finite"):
            read_mesh(exported(holed, file_type), file_type)


def test_names_in_another_encoding_are_no_obstacle() -> None:
    assert len(read_mesh("o Küche\n".encode("latin-1") + TRIANGLE + b"f 1 2 3\n", "obj").faces) == 1


def test_no_other_file_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paint.mtl").write_text("newmtl paint\nmap_Kd paint.png\n")
    (tmp_path / "file.bin").write_bytes(bytes(36))
    opened: list[str] = []
    real_open = Path.open

    def watched(path: Path, *args: object, **options: object) -> object:
        opened.append(str(path))
        return real_open(path, *args, **options)  # type: ignore[call-overload]

    monkeypatch.setattr(Path, "open", watched)
    monkeypatch.setattr("builtins.open", lambda path, *_, **__: opened.append(str(path)))
    for library in ("paint.mtl", str(tmp_path / "paint.mtl"), "/etc/passwd"):
        data = f"mtllib {library}\n".encode() + TRIANGLE + b"usemtl paint\nf 1 2 3\n"
        assert len(read_mesh(data, "obj").faces) == 1
    with pytest.raises(InvalidInput):
        read_mesh(glb(OUTSIDE), "glb")
    assert opened == []


@given(st.sampled_from(FILE_TYPES), st.integers(0, 2000), st.binary(min_size=1, max_size=8))
def test_changed_bytes_give_a_mesh_or_a_refusal(file_type: str, place: int, change: bytes) -> None:
    data = exported(BOX, file_type)
    place %= len(data)
    try:
        mesh = read_mesh(data[:place] + change + data[place + len(change) :], file_type)
    except (InvalidInput, TooLarge):
        return
    assert np.isfinite(mesh.vertices_m).all()
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices_m)
