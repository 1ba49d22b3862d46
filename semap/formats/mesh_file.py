"""Triangle meshes in glb, obj, ply and stl, from bytes that nobody vouches for.

glTF is y-up by its specification (glTF 2.0, 3.4) and is turned to z-up: (x, y, z) becomes (x, -z, y). The
other formats say nothing about axes or units and are taken as z-up metres. Nothing but the given bytes is
read: materials, textures and buffers in other files are never opened.
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from semap.errors import InvalidInput, TooLarge
from semap.geometry.pose import transform_points
from semap.geometry.tin import merge_points
from semap.model.building import Mesh

FILE_TYPES = ("glb", "obj", "ply", "stl")
MAX_BYTES = 256 * 1024**2
MAX_FACES = 4_000_000

Z_UP_T_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
GLB_HEADER = struct.Struct("<4sII I4s")
SMALLER = "Simplify the mesh, or upload it in parts."


class _NoOtherFiles(trimesh.resolvers.Resolver):
    """Refuses every file that a mesh refers to."""

    def __init__(self) -> None:
        """There is nothing to remember."""

    def get(self, name: str) -> bytes:
        raise OSError(f"{name} lies outside the upload")

    def namespaced(self, namespace: str) -> _NoOtherFiles:
        return self

    def keys(self) -> tuple[str, ...]:
        return ()

    def write(self, name: str, data: bytes) -> None:
        raise OSError(f"{name} lies outside the upload")


def read_mesh(data: bytes, file_type: str, max_bytes: int = MAX_BYTES, max_faces: int = MAX_FACES) -> Mesh:
    """The one mesh of all parts of a file, each where its scene places it; equal vertices are merged.

    file_type  'glb', 'obj', 'ply' or 'stl', with or without a leading dot
    returns    metres, z up
    raises     TooLarge above the limits; InvalidInput if the type is another, the bytes do not follow it,
               no triangle is in it, or a vertex is not finite
    """
    kind = file_type.lower().lstrip(".")
    if kind not in FILE_TYPES:
        raise InvalidInput(
            f"{file_type!r} is no mesh format that semap reads", f"Give one of {', '.join(FILE_TYPES)}."
        )
    if len(data) > max_bytes:
        raise TooLarge(f"The mesh has {len(data)} bytes; the limit is {max_bytes}.", SMALLER)
    if kind == "glb":
        _refuse_huge_accessors(data, max_faces)
    scene = _load(_plain(data, kind), kind)
    parts = list(_parts(scene, max_faces))
    if not parts:
        raise InvalidInput(
            f"the {kind} file has no triangles", "Export a surface, not only points, lines or empty nodes."
        )
    mesh = _joined(parts)
    return Mesh(transform_points(Z_UP_T_Y_UP, mesh.vertices_m), mesh.faces) if kind == "glb" else mesh


def _plain(data: bytes, kind: str) -> bytes:
    """Text without bytes that trimesh would guess an encoding for; binary formats as they are.

    Only names can hold such bytes, and names are not used.
    """
    if kind == "obj":
        return data.decode(errors="replace").encode()
    if kind == "stl" and not _is_binary_stl(data):
        if not data.lstrip().startswith(b"solid"):
            raise InvalidInput(
                "the stl file is cut off: its length does not fit its number of triangles",
                "Copy or export it again.",
            )
        return data.decode(errors="replace").encode()
    return data


def _is_binary_stl(data: bytes) -> bool:
    """80 bytes of header, a count, and 50 bytes for each triangle."""
    return len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")


def _load(data: bytes, kind: str) -> Any:
    try:
        # Overflows in numbers of the file are met below, as values that are not finite.
        with np.errstate(all="ignore"):
            return trimesh.load_scene(
                io.BytesIO(data),
                file_type=kind,
                resolver=_NoOtherFiles(),
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
    count = 0
    for node in scene.graph.nodes_geometry:
        world_T_node, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh) or len(geometry.faces) == 0:
            continue
        count += len(geometry.faces)
        if count > max_faces:
            raise TooLarge(f"The mesh has more than {max_faces} triangles.", SMALLER)
        vertices = np.asarray(geometry.vertices, dtype=np.float64)
        faces = np.asarray(geometry.faces, dtype=np.int64)
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InvalidInput("a triangle names a vertex that is not there", "Export the mesh again.")
        # A mirroring placement turns surfaces inside out.
        is_mirrored = np.linalg.det(world_T_node[:3, :3]) < 0
        with np.errstate(all="ignore"):
            placed = transform_points(world_T_node, vertices)
        yield Mesh(placed, faces[:, ::-1] if is_mirrored else faces)


def _joined(parts: list[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(part.vertices_m) for part in parts[:-1])])
    corners = np.concatenate([part.vertices_m for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    used = np.unique(faces)
    if not np.isfinite(corners[used]).all():
        raise InvalidInput("a vertex is not finite (NaN or infinite)", "Repair the mesh before exporting it.")
    vertices_m, places = merge_points(corners[used])
    index_of: NDArray[np.int64] = np.zeros(len(corners), dtype=np.int64)
    index_of[used] = places
    return Mesh(vertices_m, index_of[faces])


def _refuse_huge_accessors(data: bytes, max_faces: int) -> None:
    """A few bytes of glTF can announce an array of any size; without a buffer it is made of zeros."""
    try:
        magic, _, _, length, _ = GLB_HEADER.unpack_from(data)
        tree = json.loads(data[GLB_HEADER.size : GLB_HEADER.size + length])
        counts = [int(accessor["count"]) for accessor in tree.get("accessors", [])]
    except (struct.error, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InvalidInput(
            f"the bytes are no readable glb file: {error}", "Export the mesh again, as binary glTF 2.0."
        ) from error
    if magic != b"glTF":
        raise InvalidInput("the bytes are no glb file", "Export the mesh again, as binary glTF 2.0.")
    if sum(counts) > 8 * 3 * max_faces:
        raise TooLarge(f"The mesh announces {sum(counts)} values.", SMALLER)
