"""Meshes in 3MF (3D Manufacturing Format, core specification 1.3), a zip archive of XML.

Only the model parts are opened, streamed through a parser that refuses entities, and only as far as the
limits allow: the archive's own statement of its sizes is not believed. Materials, slices and the other
extensions are passed over; components in other parts (production extension) are followed.
"""

from __future__ import annotations

import io
import zipfile
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput, TooLarge
from semap.formats.mesh_part import SMALLER, FaceCount, MeshParts, floats, placed
from semap.formats.xml_guard import walk_xml
from semap.model.building import Mesh

UNITS_M = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}
ROOT_MODEL = "3d/3dmodel.model"
MAX_MEMBERS = 1_000
MAX_DEPTH = 32
MAX_VISITS = 100_000
CHUNK_BYTES = 1 << 20
AGAIN = "Export the mesh again, as 3MF without encryption."

Key = tuple[str, str]
"""Path of a model part, and the id of an object in it."""


@dataclass(eq=False)
class _Object:
    vertices: array[float] = field(default_factory=lambda: array("d"))
    triangles: array[int] = field(default_factory=lambda: array("q"))
    components: list[tuple[Key, NDArray[np.float64]]] = field(default_factory=list)


@dataclass(eq=False)
class _Model:
    unit: str = "millimeter"
    objects: dict[Key, _Object] = field(default_factory=dict)
    items: list[tuple[Key, NDArray[np.float64]]] = field(default_factory=list)
    paths: list[str] = field(default_factory=list)


def read_3mf(data: bytes, max_expanded_bytes: int, max_faces: int) -> MeshParts:
    """The objects that a 3MF file builds, each as often as it is built.

    raises  TooLarge above the limits; InvalidInput if the bytes are no 3MF file
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            model = _read_models(archive, max_expanded_bytes, max_faces)
    except (
        zipfile.BadZipFile,
        NotImplementedError,
        RuntimeError,
        EOFError,
        OSError,
        ValueError,
        KeyError,
    ) as error:
        raise InvalidInput(
            f"the bytes are no readable 3mf file: {type(error).__name__}: {error}", AGAIN
        ) from error
    except Exception as error:
        if isinstance(error, InvalidInput | TooLarge):
            raise
        # zlib.error and what else a damaged archive stumbles over.
        raise InvalidInput(f"the bytes are no readable 3mf file: {error}", AGAIN) from error
    if model.unit not in UNITS_M:
        raise InvalidInput(f"a 3mf file in {model.unit!r}", f"Use one of {', '.join(UNITS_M)}.")
    return MeshParts(list(_built(model, max_faces)), UNITS_M[model.unit], "z")


def _read_models(archive: zipfile.ZipFile, max_expanded_bytes: int, max_faces: int) -> _Model:
    members = archive.infolist()
    size = sum(member.file_size for member in members)
    if len(members) > MAX_MEMBERS or size > max_expanded_bytes:
        raise TooLarge(
            f"The 3mf file holds {len(members)} members of {size} bytes; "
            f"the limits are {MAX_MEMBERS} and {max_expanded_bytes}.",
            SMALLER,
        )
    by_path = {member.filename.lower().lstrip("/"): member for member in members}
    root = by_path.get(ROOT_MODEL) or next(
        (member for path, member in by_path.items() if path.endswith(".model")), None
    )
    if root is None:
        raise InvalidInput("a zip archive without a 3D model in it", "Upload the mesh itself.")
    model = _Model(paths=[root.filename.lower().lstrip("/")])
    left = [max_expanded_bytes]
    for path in model.paths:
        if path not in by_path:
            raise InvalidInput(f"the part {path!r} is not in the 3mf file", AGAIN)
        _read_model(archive, by_path[path], path, model, left, max_faces)
    return model


def _read_model(
    archive: zipfile.ZipFile,
    member: zipfile.ZipInfo,
    path: str,
    model: _Model,
    left: list[int],
    max_faces: int,
) -> None:
    current = _Object()
    is_root = path == model.paths[0]

    def target(attributes: dict[str, str]) -> tuple[Key, NDArray[np.float64]]:
        other = attributes.get("path", path).lower().lstrip("/")
        if other not in model.paths:
            model.paths.append(other)
        return (other, attributes["objectid"]), _matrix(attributes.get("transform"))

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal current
        if name == "vertex":
            current.vertices.extend((float(attributes["x"]), float(attributes["y"]), float(attributes["z"])))
        elif name == "triangle":
            current.triangles.extend((int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"])))
            if len(current.triangles) > 3 * max_faces:
                raise TooLarge(f"The mesh has more than {max_faces} triangles.", SMALLER)
        elif name == "object":
            current = _Object()
            model.objects[path, attributes["id"]] = current
        elif name == "component":
            current.components.append(target(attributes))
        elif name == "item" and is_root:
            model.items.append(target(attributes))
        elif name == "model" and is_root:
            model.unit = attributes.get("unit", "millimeter")

    def chunks() -> Iterator[bytes]:
        with archive.open(member) as part:
            while chunk := part.read(CHUNK_BYTES):
                left[0] -= len(chunk)
                if left[0] < 0:
                    raise TooLarge("The 3mf file expands beyond its limit.", SMALLER)
                yield chunk

    walk_xml(chunks(), 4 * max_faces + 100_000, start)


def _built(model: _Model, max_faces: int) -> Iterator[Mesh]:
    count = FaceCount(max_faces)
    visits = 0
    waiting = [(key, matrix, 0) for key, matrix in model.items]
    while waiting:
        key, world_T_object, depth = waiting.pop()
        visits += 1
        if depth > MAX_DEPTH or visits > MAX_VISITS:
            raise TooLarge("The 3mf file builds its objects too often, or nests them too deep.", SMALLER)
        found = model.objects.get(key)
        if found is None:
            raise InvalidInput(f"the object {key[1]} is not in the 3mf file", AGAIN)
        if found.triangles:
            count.add(len(found.vertices) // 3, len(found.triangles) // 3)
            vertices = np.frombuffer(found.vertices, dtype=np.float64).reshape(-1, 3)
            yield placed(world_T_object, vertices, np.array(found.triangles, dtype=np.int64).reshape(-1, 3))
        for part, object_T_part in found.components:
            waiting.append((part, world_T_object @ object_T_part, depth + 1))


def _matrix(transform: str | None) -> NDArray[np.float64]:
    """The file writes rows of a matrix that points are multiplied with from the left."""
    matrix = np.eye(4)
    if transform is not None:
        matrix[:3, :] = floats(transform, 12).reshape(4, 3).T
    return matrix
