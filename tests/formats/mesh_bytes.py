"""Meshes as the bytes of files, written by trimesh or, where it needs other packages, by hand."""

import base64
import io
import json
import struct
import zipfile
from collections.abc import Mapping, Sequence

import numpy as np
import trimesh

DAE_GEOMETRY = """
  <geometry id="{name}"><mesh>
    <source id="{name}-p">
      <float_array id="{name}-a" count="{size}">{positions}</float_array>
      <technique_common><accessor source="#{name}-a" count="{count}" stride="3"/></technique_common>
    </source>
    <vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/></vertices>
    {primitives}
  </mesh></geometry>"""

DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset>{asset}</asset>
  <library_geometries>{geometries}</library_geometries>
  {libraries}
  <library_visual_scenes><visual_scene id="scene">{nodes}</visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>"""

THREE_MF = """<?xml version="1.0" encoding="UTF-8"?>
<model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
  xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06">
  <resources>{objects}</resources><build>{items}</build>
</model>"""


def exported(shape: trimesh.Trimesh | trimesh.Scene, file_type: str) -> bytes:
    if file_type == "dae":
        return dae([dae_geometry("box", shape.vertices, dae_triangles("box", shape.faces))])
    if file_type == "3mf":
        return three_mf(three_mf_object("1", shape.vertices, shape.faces), '<item objectid="1"/>', "meter")
    if file_type == "gltf":
        return gltf_of(exported(shape, "glb"))
    data = shape.export(file_type=file_type)
    return data if isinstance(data, bytes) else str(data).encode()


def gltf_of(glb: bytes) -> bytes:
    """The same as JSON alone, its buffer embedded."""
    length = struct.unpack_from("<I", glb, 12)[0]
    tree = json.loads(glb[20 : 20 + length])
    binary = glb[28 + length :]
    tree["buffers"] = [
        {
            "byteLength": len(binary),
            "uri": "data:application/octet-stream;base64," + base64.b64encode(binary).decode(),
        }
    ]
    return json.dumps(tree).encode()


def dae_triangles(name: str, faces: np.ndarray) -> str:
    indices = " ".join(map(str, np.asarray(faces).ravel().tolist()))
    return (
        f'<triangles count="{len(faces)}"><input semantic="VERTEX" source="#{name}-v" offset="0"/>'
        f"<p>{indices}</p></triangles>"
    )


def dae_geometry(name: str, vertices: np.ndarray, primitives: str) -> str:
    positions = " ".join(map(repr, np.asarray(vertices, dtype=float).ravel().tolist()))
    return DAE_GEOMETRY.format(
        name=name, positions=positions, size=3 * len(vertices), count=len(vertices), primitives=primitives
    )


def dae(
    geometries: Sequence[str],
    nodes: str = '<node><instance_geometry url="#box"/></node>',
    asset: str = '<unit meter="1" name="meter"/><up_axis>Z_UP</up_axis>',
    libraries: str = "",
) -> bytes:
    return DAE.format(geometries="".join(geometries), nodes=nodes, asset=asset, libraries=libraries).encode()


def three_mf_object(number: str, vertices: np.ndarray, faces: np.ndarray) -> str:
    points = "".join(
        f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in np.asarray(vertices, float).tolist()
    )
    corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in np.asarray(faces).tolist())
    return (
        f'<object id="{number}" type="model"><mesh><vertices>{points}</vertices>'
        f"<triangles>{corners}</triangles></mesh></object>"
    )


def three_mf(
    objects: str, items: str, unit: str = "millimeter", others: Mapping[str, bytes] | None = None
) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
        archive.writestr("3D/3dmodel.model", THREE_MF.format(unit=unit, objects=objects, items=items))
        for path, data in (others or {}).items():
            archive.writestr(path, data)
    return stream.getvalue()
