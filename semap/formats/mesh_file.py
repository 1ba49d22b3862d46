"""Triangle meshes in glb, gltf, obj, ply, stl, off, dae and 3mf, from bytes that nobody vouches for.

`unit` and `up` say how to read coordinates that the file does not explain. Without them: glTF is metres
and y-up by its specification (2.0, 3.4), dae and 3mf state their unit, dae its axis; all others are taken
as metres, z-up. What comes out is metres, z-up, repaired, with a finding for each thing that was done or
could not be.

Nothing but the given bytes is read: materials, textures and buffers in other files are never opened.
Whatever the bytes are, the answer is a mesh or an error of semap, within the limits on bytes, on triangles,
and on what an archive may expand to.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput, SemapError, TooLarge
from semap.formats.collada import read_dae
from semap.formats.mesh_part import SMALLER, FaceCount, MeshParts, placed
from semap.formats.mesh_preflight import is_binary_stl, preflight, refuse_archives
from semap.formats.source import refuse_utf16
from semap.formats.three_mf import read_3mf
from semap.geometry.pose import transform_points
from semap.geometry.repair import repaired
from semap.geometry.tin import merge_points
from semap.model.building import Finding, Mesh

TEXTS = ("obj", "off", "ply", "gltf")
FILE_TYPES = ("glb", "gltf", "obj", "ply", "stl", "off", "dae", "3mf")
MAX_BYTES = 256 * 1024**2
MAX_FACES = 4_000_000
EXPANSION = 20
"""An archive may expand to so many times its bytes, and always to EXPANDED_BYTES."""

EXPANDED_BYTES = 64 * 1024**2

UNITS_M: Mapping[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}
UNITS = ("file", *UNITS_M)

Z_UP_T_UP: Mapping[str, NDArray[np.float64]] = {
    "x": np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]),
    "y": np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
    "z": np.eye(4),
}
"""Turns the axes as COLLADA 1.5 defines them: X_UP has -y to the right, Y_UP and Z_UP have x."""

OBJ_TEXTURES = re.compile(rb"/[^\s]*")


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh as read from a file [m, z up], and what was repaired or is left wrong."""

    mesh: Mesh
    findings: tuple[Finding, ...]


def read_mesh(data: bytes, file_type: str, max_bytes: int = MAX_BYTES, max_faces: int = MAX_FACES) -> Mesh:
    """The mesh of a file alone; see `read_mesh_file`."""
    return read_mesh_file(data, file_type, max_bytes=max_bytes, max_faces=max_faces).mesh


def read_mesh_file(
    data: bytes,
    file_type: str,
    unit: str = "file",
    up: str | None = None,
    max_bytes: int = MAX_BYTES,
    max_faces: int = MAX_FACES,
) -> MeshFile:
    """The one mesh of all parts of a file, each where its scene places it, equal vertices merged, repaired.

    file_type  one of FILE_TYPES, with or without a leading dot
    unit       of the file's numbers: one of UNITS; 'file': what the file or its format says, else metres
    up         the file's axis that points up: 'x', 'y', 'z'; None: what the file or its format says, else z
    raises     TooLarge above the limits; InvalidInput if an option is another, the bytes do not follow
               their type, no triangle is in it, or a vertex is not finite
    """
    kind = file_type.lower().lstrip(".")
    if kind not in FILE_TYPES:
        raise InvalidInput(
            f"{file_type!r} is no mesh format that semap reads", f"Give one of {', '.join(FILE_TYPES)}."
        )
    if unit not in UNITS:
        raise InvalidInput(f"{unit!r} is no unit", f"Give one of {', '.join(UNITS)}.", "unit")
    if up is not None and up not in Z_UP_T_UP:
        raise InvalidInput(f"{up!r} is no axis", f"Give one of {', '.join(Z_UP_T_UP)}.", "up")
    if len(data) > max_bytes:
        raise TooLarge(f"The mesh has {len(data)} bytes; the limit is {max_bytes}.", SMALLER)
    refuse_archives(data, kind)
    if kind in TEXTS:
        refuse_utf16(data, f"the {kind} file")
    parts = _read_parts(data, kind, max_faces)
    if not parts.meshes:
        raise InvalidInput(
            f"the {kind} file has no triangles", "Export a surface, not only points, lines or empty nodes."
        )
    unit_m = (parts.unit_m or 1.0) if unit == "file" else UNITS_M[unit]
    turned = unit_m * Z_UP_T_UP[up or parts.up or "z"][:3, :3]
    mesh, findings = repaired(_joined(parts.meshes, turned))
    return MeshFile(mesh, findings)


def _read_parts(data: bytes, kind: str, max_faces: int) -> MeshParts:
    if kind == "3mf":
        return read_3mf(data, max(EXPANDED_BYTES, EXPANSION * len(data)), max_faces)
    if kind == "dae":
        return read_dae(data, max_faces)
    preflight(data, kind, max_faces)
    meshes = list(_parts(_load(_plain(data, kind), kind), max_faces))
    return MeshParts(meshes, 1.0, "y") if kind in ("glb", "gltf") else MeshParts(meshes)


def _plain(data: bytes, kind: str) -> bytes:
    """Text without bytes that trimesh would guess an encoding for; binary formats as they are.

    Only names can hold such bytes, and names are not used. Of obj only corners and faces are kept: groups
    and materials would split the mesh into as many parts.
    """
    if kind == "obj":
        lines = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
        kept = [line for line in map(bytes.strip, lines) if line.startswith((b"v ", b"v\t", b"f ", b"f\t"))]
        return OBJ_TEXTURES.sub(b"", b"\n".join(kept)).decode(errors="replace").encode() + b"\n"
    if kind == "off":
        return data.decode(errors="replace").encode()
    if kind == "stl" and not is_binary_stl(data):
        if not data.lstrip().startswith(b"solid"):
            raise InvalidInput(
                "the stl file is cut off: its length does not fit its number of triangles",
                "Copy or export it again.",
            )
        return data.decode(errors="replace").encode()
    return data


def _load(data: bytes, kind: str) -> Any:
    import trimesh  # noqa: PLC0415  slow to import

    from semap.formats.no_other_files import NoOtherFiles  # noqa: PLC0415  slow to import

    try:
        # Overflows in numbers of the file are met below, as values that are not finite.
        with np.errstate(all="ignore"):
            return trimesh.load_scene(
                io.BytesIO(data),
                file_type=kind,
                resolver=NoOtherFiles(),
                process=False,
                skip_materials=True,
            )
    except Exception as error:
        # trimesh lets whatever its parsers stumble over through: KeyError, struct.error, IndexError, ...
        raise InvalidInput(
            f"the bytes are no readable {kind} file: {type(error).__name__}: {error}",
            "Export the mesh again, as one file with everything inside.",
        ) from error


def _parts(scene: Any, max_faces: int) -> Iterator[Mesh]:
    """The meshes of a scene in its world frame; counted before copying, as a node may repeat a mesh."""
    from trimesh import Trimesh  # noqa: PLC0415  slow to import

    count = FaceCount(max_faces)
    try:
        for node in scene.graph.nodes_geometry:
            world_T_node, name = scene.graph[node]
            geometry = scene.geometry[name]
            if not isinstance(geometry, Trimesh) or len(geometry.faces) == 0:
                continue
            count.add(len(geometry.vertices), len(geometry.faces))
            vertices = np.asarray(geometry.vertices, dtype=np.float64)
            yield placed(world_T_node, vertices, np.asarray(geometry.faces, dtype=np.int64))
    except SemapError:
        raise
    except Exception as error:
        raise InvalidInput(
            f"the scene of the file cannot be read: {type(error).__name__}: {error}", "Export the mesh again."
        ) from error


def _joined(parts: list[Mesh] | tuple[Mesh, ...] | Any, z_up_T_file: NDArray[np.float64]) -> Mesh:
    starts = np.cumsum([0, *(len(part.vertices_m) for part in parts[:-1])])
    corners = np.concatenate([part.vertices_m for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    is_used = np.zeros(len(corners), dtype=bool)
    is_used[faces] = True
    turned = np.eye(4)
    turned[:3, :3] = z_up_T_file
    with np.errstate(all="ignore"):
        used_m = transform_points(turned, corners[is_used])
    if not np.isfinite(used_m).all():
        raise InvalidInput("a vertex is not finite (NaN or infinite)", "Repair the mesh before exporting it.")
    vertices_m, places = merge_points(used_m)
    index_of: NDArray[np.int64] = np.zeros(len(corners), dtype=np.int64)
    index_of[is_used] = places
    return Mesh(vertices_m, index_of[faces])
