"""dae, 3mf, off and gltf; units and axes; archives and bombs."""

import gzip
import io
import json
import tracemalloc
import zipfile
from contextlib import suppress

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from mesh_bytes import (
    THREE_MF,
    dae,
    dae_geometry,
    dae_triangles,
    exported,
    three_mf,
    three_mf_object,
)
from numpy.typing import NDArray

from semap.errors import InvalidInput, SemapError, TooLarge
from semap.formats.mesh_file import FILE_TYPES, UNITS_M, read_mesh, read_mesh_file
from semap.model.building import Mesh

BOX = trimesh.creation.box((1, 2, 3))
BOX_DAE = dae_geometry("box", BOX.vertices, dae_triangles("box", BOX.faces))
BOX_3MF = three_mf_object("1", BOX.vertices, BOX.faces)
BINARY = ("glb", "stl")


def extents(mesh: Mesh) -> list[float]:
    return np.ptp(mesh.vertices_m, axis=0).round(9).tolist()


def corners(mesh: Mesh) -> NDArray[np.float64]:
    found = mesh.vertices_m[mesh.faces].reshape(-1, 3).round(6)
    return np.unique(found, axis=0)


@pytest.mark.parametrize("file_type", FILE_TYPES)
def test_every_format_gives_the_same_box(file_type: str) -> None:
    found = read_mesh_file(exported(BOX, file_type), file_type, up="z")
    assert corners(found.mesh) == pytest.approx(np.unique(BOX.vertices, axis=0))
    assert (found.mesh.vertices_m.shape, found.mesh.faces.shape) == ((8, 3), (12, 3))
    assert trimesh.Trimesh(found.mesh.vertices_m, found.mesh.faces).volume == pytest.approx(6)
    assert found.findings == ()


@pytest.mark.parametrize(("unit", "metres"), UNITS_M.items())
@pytest.mark.parametrize("file_type", FILE_TYPES)
def test_a_given_unit_wins(file_type: str, unit: str, metres: float) -> None:
    mesh = read_mesh_file(exported(BOX, file_type), file_type, unit=unit, up="z").mesh
    assert extents(mesh) == pytest.approx([metres, 2 * metres, 3 * metres])


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("micron", 1e-6), ("millimeter", 1e-3), ("inch", 0.0254), ("foot", 0.3048), ("meter", 1)],
)
def test_the_unit_of_a_3mf_file(unit: str, metres: float) -> None:
    data = three_mf(BOX_3MF, '<item objectid="1"/>', unit)
    assert extents(read_mesh(data, "3mf")) == pytest.approx([metres, 2 * metres, 3 * metres], abs=1e-9)


def test_the_unit_and_the_axis_of_a_dae_file() -> None:
    tip = dae_geometry(
        "box",
        np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]]),
        dae_triangles("box", np.array([[0, 1, 2], [0, 1, 3]])),
    )
    expected = {
        "X_UP": {(0, 0, 0), (0, 0, 0.01), (-0.02, 0, 0), (0, -0.03, 0)},
        "Y_UP": {(0, 0, 0), (0.01, 0, 0), (0, 0, 0.02), (0, -0.03, 0)},
        "Z_UP": {(0, 0, 0), (0.01, 0, 0), (0, 0.02, 0), (0, 0, 0.03)},
    }
    for axis, places in expected.items():
        data = dae([tip], asset=f'<unit name="centimeter" meter="0.01"/><up_axis>{axis}</up_axis>')
        assert {tuple(place) for place in (read_mesh(data, "dae").vertices_m + 0.0).tolist()} == places
    # The standard's default.
    assert extents(read_mesh(dae([tip], asset=""), "dae")) == [1, 3, 2]


@pytest.mark.parametrize(("option", "value"), [("unit", "yard"), ("unit", ""), ("up", "w"), ("up", "Z")])
def test_other_options_are_refused(option: str, value: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        read_mesh_file(exported(BOX, "stl"), "stl", **{option: value})  # type: ignore[arg-type]
    assert refusal.value.where == option


def test_nodes_of_dae_place_what_they_instantiate() -> None:
    nodes = """
      <node><translate>10 0 0</translate><rotate>0 0 1 90</rotate><scale>2 1 1</scale>
        <node><matrix>1 0 0 0 0 1 0 0 0 0 1 5 0 0 0 1</matrix><instance_geometry url="#box"/></node></node>
      <node><instance_node url="#shared"/></node>"""
    libraries = """<library_nodes><node id="shared"><scale>-1 1 1</scale><instance_controller url="#skin"/></node></library_nodes>
      <library_controllers><controller id="skin"><skin source="#box">
        <bind_shape_matrix>1 0 0 -20 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix></skin></controller></library_controllers>"""
    mesh = read_mesh(dae([BOX_DAE], nodes, libraries=libraries), "dae")
    assert len(mesh.faces) == 24
    box_m = BOX.vertices
    first = np.column_stack([10 - box_m[:, 1], 2 * box_m[:, 0], box_m[:, 2] + 5])
    second = np.column_stack([20 - box_m[:, 0], box_m[:, 1], box_m[:, 2]])
    assert corners(mesh) == pytest.approx(np.unique(np.concatenate([first, second]).round(6), axis=0))
    # The mirrored one too points outwards.
    assert trimesh.Trimesh(mesh.vertices_m, mesh.faces).volume == pytest.approx(18)


ELL = np.array([[0, 0, 0], [4, 0, 0], [4, 1, 0], [1, 1, 0], [1, 3, 0], [0, 3, 0]])
INPUT = (
    '<input semantic="VERTEX" source="#box-v" offset="1"/><input semantic="NORMAL" source="#n" offset="0"/>'
)


@pytest.mark.parametrize(
    ("primitive", "area"),
    [
        (f"<polylist count='1'>{INPUT}<vcount>6</vcount><p>9 0 9 1 9 2 9 3 9 4 9 5</p></polylist>", 6),
        (f"<polygons count='1'>{INPUT}<p>9 0 9 1 9 2 9 3 9 4 9 5</p></polygons>", 6),
        (f"<trifans count='1'>{INPUT}<p>9 3 9 4 9 5 9 0 9 1 9 2</p></trifans>", 6),
        (f"<tristrips count='1'>{INPUT}<p>9 1 9 2 9 0 9 3 9 5 9 4</p></tristrips>", 6),
        (
            f"<lines count='1'>{INPUT}<p>9 0 9 1</p></lines><polylist count='2'>{INPUT}<vcount>3 3</vcount><p>0 0 0 1 0 3 0 0 0 3 0 5</p></polylist>",
            2 + 1.5,
        ),
    ],
    ids=["polylist", "polygons", "trifans", "tristrips", "triangles among lines"],
)
def test_polygons_strips_and_fans_of_dae(primitive: str, area: float) -> None:
    mesh = read_mesh(dae([dae_geometry("box", ELL, primitive)]), "dae")
    body = trimesh.Trimesh(mesh.vertices_m, mesh.faces)
    assert body.area == pytest.approx(area)
    assert (body.face_normals[:, 2] > 0.99).all()


def test_components_of_3mf_stand_where_they_are_placed() -> None:
    objects = BOX_3MF + (
        '<object id="2"><components><component objectid="1"/>'
        '<component objectid="1" transform="0 1 0 -1 0 0 0 0 1 10 0 0"/>'
        '<component objectid="7" p:path="/3D/other.model"/></components></object>'
    )
    other = THREE_MF.format(unit="inch", objects=three_mf_object("7", BOX.vertices + 30, BOX.faces), items="")
    data = three_mf(
        objects,
        '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 100"/>',
        "meter",
        {"3D/other.model": other.encode()},
    )
    mesh = read_mesh(data, "3mf")
    box_m = BOX.vertices
    turned = np.column_stack([10 - box_m[:, 1], box_m[:, 0], box_m[:, 2]])
    expected = np.concatenate([box_m, turned, box_m + 30]) + np.array([0, 0, 100])
    assert corners(mesh) == pytest.approx(np.unique(expected.round(6), axis=0))


def test_gltf_with_other_files_is_refused() -> None:
    tree = json.loads(exported(BOX, "gltf"))
    tree["buffers"][0]["uri"] = "box.bin"
    with pytest.raises(InvalidInput, match=r"box\.bin") as refusal:
        read_mesh(json.dumps(tree).encode(), "gltf")
    assert "glb" in refusal.value.remedy


def zipped(members: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return stream.getvalue()


@pytest.mark.parametrize("file_type", FILE_TYPES)
@pytest.mark.parametrize(
    "data",
    [
        gzip.compress(b"solid"),
        zipped({"box.stl": exported(BOX, "stl")}),
        b"7z\xbc\xaf\x27\x1c" + bytes(90),
        b"\xfd7zXZ\x00" + bytes(90),
        b"BZh91AY" + bytes(90),
        b"Rar!\x1a\x07" + bytes(90),
        b"\x28\xb5\x2f\xfd" + bytes(90),
        bytes(257) + b"ustar" + bytes(300),
    ],
    ids=["gzip", "zip", "7z", "xz", "bzip2", "rar", "zstd", "tar"],
)
def test_archives_are_refused(data: bytes, file_type: str) -> None:
    with pytest.raises(InvalidInput, match=r"archive|3D model"):
        read_mesh(data, file_type)


BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c SYSTEM "file:///etc/passwd">]>'


@pytest.mark.parametrize("entity", ["&b;", "&c;", "%c;", ""])
def test_entities_are_refused(entity: str) -> None:
    text = dae([BOX_DAE]).decode().replace("?>\n", f"?>{BOMB}", 1).replace("<asset>", f"<asset>{entity}")
    with pytest.raises(InvalidInput, match="document type"):
        read_mesh(text.encode(), "dae")
    model = THREE_MF.format(unit="meter", objects=BOX_3MF, items=entity).replace("?>\n", f"?>{BOMB}", 1)
    with pytest.raises(InvalidInput, match="document type"):
        read_mesh(zipped({"3D/3dmodel.model": model.encode()}), "3mf")


def doubled(levels: int) -> str:
    """Each object is made of two of the one before."""
    return BOX_3MF + "".join(
        f'<object id="{n}"><components><component objectid="{n - 1}"/><component objectid="{n - 1}"/></components></object>'
        for n in range(2, levels + 2)
    )


@pytest.mark.parametrize(
    "data",
    [
        three_mf(doubled(60), '<item objectid="61"/>'),
        three_mf(doubled(25), '<item objectid="26"/>'),
        three_mf(
            '<object id="1"><components><component objectid="1"/></components></object>',
            '<item objectid="1"/>',
        ),
        zipped({"3D/3dmodel.model": b"<model>" + bytes(10) + b" " * 200_000_000}),
        zipped({f"{n}.png": b"" for n in range(2000)}),
        three_mf("<x>" * 300 + "</x>" * 300, ""),
        dae(
            [BOX_DAE],
            '<node><instance_node url="#n0"/></node>',
            libraries="<library_nodes>"
            + "".join(
                f'<node id="n{n}"><instance_node url="#n{n + 1}"/><instance_node url="#n{n + 1}"/></node>'
                for n in range(40)
            )
            + '<node id="n40"><instance_geometry url="#box"/></node></library_nodes>',
        ),
        dae([BOX_DAE], '<node id="n"><instance_node url="#n"/></node>'),
        dae([BOX_DAE], "<node>" * 300 + "</node>" * 300),
    ],
    ids=["deep", "wide", "cycle", "expanding", "members", "nested", "dae wide", "dae cycle", "dae deep"],
)
def test_what_expands_beyond_the_limits_is_refused(data: bytes) -> None:
    kind = "dae" if data.startswith(b"<?xml") else "3mf"
    tracemalloc.start()
    try:
        with pytest.raises(TooLarge) as refusal:
            read_mesh(data, kind, max_faces=100_000)
        assert tracemalloc.get_traced_memory()[1] < 150e6
    finally:
        tracemalloc.stop()
    assert refusal.value.remedy


def test_a_member_that_lies_about_its_size() -> None:
    honest = zipped({"3D/3dmodel.model": b"<model>" + b" " * 90_000_000 + b"</model>"})
    size = (90_000_015).to_bytes(4, "little")
    with pytest.raises(SemapError):
        read_mesh(honest.replace(size, (100).to_bytes(4, "little")), "3mf")


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (b"OFF\n99999999 1 0\n0 0 0\n", "off"),
        (b"OFF\n-1 1 0\n0 0 0\n", "off"),
        (b"OFF", "off"),
        (b"", "off"),
        (b"3 1 0\n", "off"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "off"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 nan\n3 0 1 2\n", "off"),
        (b"ply\nformat ascii 1.0\nelement vertex -5\nproperty float x\nend_header\n", "ply"),
        (b"ply\nformat ascii 1.0\nelement face 999999999999\nend_header\n", "ply"),
        (
            b"ply\nformat binary_little_endian 1.0\nelement face 9999\nproperty list uchar int vertex_index\nend_header\n",
            "ply",
        ),
        (b"", "dae"),
        (b"<COLLADA/>", "dae"),
        (b"<x/>", "dae"),
        (b"<COLLADA>", "dae"),
        (dae([]), "dae"),
        (dae([BOX_DAE], '<node><instance_geometry url="other.dae#box"/></node>'), "dae"),
        (
            dae([BOX_DAE], '<node><lookat>0 0 0 0 0 0 0 0 0</lookat><instance_geometry url="#box"/></node>'),
            "dae",
        ),
        (dae([BOX_DAE.replace("<p>", "<p>99 99 99 ")]), "dae"),
        (dae([BOX_DAE.replace('stride="3"', 'stride="0"')]), "dae"),
        (dae([BOX_DAE.replace('offset="0"', 'offset="99999999"')]), "dae"),
        (b"", "3mf"),
        (b"PK\x03\x04", "3mf"),
        (zipped({"readme": b""}), "3mf"),
        (zipped({"3D/3dmodel.model": b"<model>"}), "3mf"),
        (three_mf("", ""), "3mf"),
        (three_mf(BOX_3MF, '<item objectid="9"/>'), "3mf"),
        (three_mf(BOX_3MF, '<item objectid="1" p:path="/gone.model"/>'), "3mf"),
        (three_mf(BOX_3MF, '<item objectid="1" transform="1 2"/>'), "3mf"),
        (three_mf(BOX_3MF, '<item objectid="1"/>', "parsec"), "3mf"),
        (three_mf(BOX_3MF.replace('v1="0"', 'v1="99"'), '<item objectid="1"/>'), "3mf"),
        (three_mf(BOX_3MF.replace('v1="0"', 'v1="x"'), '<item objectid="1"/>'), "3mf"),
        (b"", "gltf"),
        (b"[]", "gltf"),
        (b"[" * 100_000, "gltf"),
    ],
)
def test_bytes_that_are_no_mesh_are_refused(data: bytes, kind: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        read_mesh(data, kind)
    assert refusal.value.remedy


def gltf_tree(**members: object) -> bytes:
    return json.dumps(json.loads(exported(BOX, "gltf")) | members).encode()


@pytest.mark.parametrize(
    ("data", "error"),
    [
        (gltf_tree(meshes=[{"primitives": [{"attributes": {"POSITION": 1}}] * 20_000}]), TooLarge),
        (gltf_tree(nodes=[{"mesh": 0}] * 30_000), TooLarge),
        (gltf_tree(nodes=[*({"children": [n + 1]} for n in range(500)), {"mesh": 0}]), TooLarge),
        (gltf_tree(nodes=[{"children": [0], "mesh": 0}]), TooLarge),
        (gltf_tree(nodes=[{"children": [2]}, {"children": [2]}, {"mesh": 0}]), InvalidInput),
        (gltf_tree(nodes=[{"children": [5]}]), InvalidInput),
        (gltf_tree(nodes=[{"children": 5}]), InvalidInput),
    ],
    ids=["primitives", "nodes", "deep", "cycle", "shared", "gone", "no list"],
)
def test_gltf_that_repeats_itself_is_refused(data: bytes, error: type[SemapError]) -> None:
    with pytest.raises(error):
        read_mesh(data, "gltf", max_faces=10_000)


@given(st.sampled_from(FILE_TYPES), st.binary(max_size=300))
def test_random_bytes_are_a_mesh_or_a_refusal(file_type: str, data: bytes) -> None:
    with suppress(SemapError):
        read_mesh(data, file_type)


SAMPLES = {kind: exported(trimesh.creation.icosphere(1), kind) for kind in FILE_TYPES}


@given(st.sampled_from(FILE_TYPES), st.data())
def test_any_mutation_gives_a_mesh_or_a_refusal(file_type: str, data: st.DataObject) -> None:
    mutated = bytearray(SAMPLES[file_type])
    for _ in range(data.draw(st.integers(1, 5))):
        place = data.draw(st.integers(0, len(mutated)))
        cut = data.draw(st.sampled_from([0, 1, 4, 50]))
        insert = data.draw(
            st.one_of(
                st.binary(max_size=8),
                st.sampled_from([b"-1", b"999999999", b"nan", b"<a>", b'"', b"\xff" * 4]),
            )
        )
        mutated[place : place + cut] = insert
    try:
        found = read_mesh_file(bytes(mutated), file_type)
    except SemapError:
        return
    assert np.isfinite(found.mesh.vertices_m).all()
    assert 0 <= found.mesh.faces.min() <= found.mesh.faces.max() < len(found.mesh.vertices_m)
