"""Export to binary glTF 2.0 (glb): a picture of the map that any viewer opens.

glTF is y-up (2.0, 3.4), so that one root node turns the map: (x, y, z) becomes (x, z, -y). Below it, each
instance is a node with its pose, its name, and as `extras` what the map knows of it. Instances of the same
blueprint share a mesh. Positions are float32, as glTF demands, and in the instance's own frame, where they
are small; the export is to be looked at, not to be read back.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semap.errors import InvalidInput
from semap.geometry.prism import extrude
from semap.geometry.triangulation import triangles
from semap.model.building import HeightBand, Mesh
from semap.model.map_document import PlacedInstance
from semap.model.source_geometry import SourceGeometry

SLAB_M = 0.01
"""Height of an outline that has no heights."""

ROOT_ROTATION = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
"""A quarter turn about x, which takes z up to y up."""

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963

COLOURS: Mapping[str, tuple[float, float, float, float]] = {
    "Room": (0.75, 0.85, 0.95, 0.35),
    "Door": (0.55, 0.35, 0.2, 1.0),
    "Window": (0.6, 0.8, 0.95, 0.5),
    "Furniture": (0.8, 0.65, 0.45, 1.0),
}
OTHER_COLOUR = (0.7, 0.7, 0.7, 1.0)


def write_gltf(instances: Sequence[PlacedInstance], name: str = "map") -> bytes:
    """A glb file of instances where they stand.

    An instance without a surface is shown as its outline carried through its heights, or, without those, as a
    slab at the height of its pose. One without either is a node without a mesh.
    """
    scene = _Scene()
    nodes = [scene.node(each) for each in instances]
    tree: dict[str, object] = {
        "asset": {"version": "2.0", "generator": "semap"},
        "scene": 0,
        "scenes": [{"name": name, "nodes": [0]}],
        "nodes": [
            {"name": name, "rotation": ROOT_ROTATION, "children": list(range(1, len(nodes) + 1))}
            if nodes
            else {"name": name},
            *nodes,
        ],
    }
    if scene.meshes:
        tree |= {
            "meshes": scene.meshes,
            "materials": scene.materials,
            "accessors": scene.accessors,
            "bufferViews": scene.views,
            "buffers": [{"byteLength": len(scene.data)}],
        }
    return _glb(tree, bytes(scene.data))


def shown_surface(placed: PlacedInstance) -> Mesh | None:
    """What an instance is shown by, in its own frame; None for one without a surface and an outline."""
    surface = _surface(placed.sources)
    return _extruded(placed) if surface is None else surface


@dataclass(eq=False)
class _Scene:
    """The parts of a file as they are added; each mesh and material once."""

    meshes: list[dict[str, object]] = field(default_factory=list)
    materials: list[dict[str, object]] = field(default_factory=list)
    accessors: list[dict[str, object]] = field(default_factory=list)
    views: list[dict[str, object]] = field(default_factory=list)
    data: bytearray = field(default_factory=bytearray)
    known: dict[tuple[object, ...], int] = field(default_factory=dict)

    def node(self, placed: PlacedInstance) -> dict[str, object]:
        entry, pose = placed.entry, placed.pose
        node: dict[str, object] = {
            "name": entry.name,
            "translation": [pose.x_m, pose.y_m, pose.z_m],
            "rotation": _unit([pose.qx, pose.qy, pose.qz, pose.qw]),
            "extras": _extras(placed),
        }
        if (mesh := self._mesh_of(placed)) is not None:
            node["mesh"] = mesh
        return node

    def _mesh_of(self, placed: PlacedInstance) -> int | None:
        colour = COLOURS.get(placed.entry.concept, OTHER_COLOUR)
        # Shared sources are the same objects, and the scene keeps them alive as long as the key.
        key: tuple[object, ...] = (colour, *(id(source.shape) for source in placed.sources))
        if key in self.known:
            return self.known[key]
        surface = _surface(placed.sources)
        if surface is not None:
            self.known[key] = self._add_mesh(surface, colour)
            return self.known[key]
        slab = _extruded(placed)
        return None if slab is None else self._add_mesh(slab, colour)

    def _add_mesh(self, mesh: Mesh, colour: tuple[float, float, float, float]) -> int:
        positions = np.ascontiguousarray(mesh.vertices_m, dtype="<f4")
        primitive = {
            "attributes": {
                "POSITION": self._accessor(
                    positions, FLOAT, "VEC3", ARRAY_BUFFER, positions.min(axis=0), positions.max(axis=0)
                )
            },
            "indices": self._accessor(
                np.ascontiguousarray(mesh.faces, dtype="<u4").reshape(-1),
                UNSIGNED_INT,
                "SCALAR",
                ELEMENT_ARRAY_BUFFER,
            ),
            "material": self._material(colour),
        }
        self.meshes.append({"primitives": [primitive]})
        return len(self.meshes) - 1

    def _accessor(
        self,
        values: NDArray[np.float32] | NDArray[np.uint32],
        component: int,
        kind: str,
        target: int,
        *limits: NDArray[np.float32],
    ) -> int:
        self.views.append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes, "target": target}
        )
        self.data += values.tobytes()
        accessor: dict[str, object] = {
            "bufferView": len(self.views) - 1,
            "componentType": component,
            "count": len(values),
            "type": kind,
        }
        for bound, limit in zip(("min", "max"), limits, strict=False):
            accessor[bound] = [float(part) for part in limit]
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def _material(self, colour: tuple[float, float, float, float]) -> int:
        key = ("material", colour)
        if key not in self.known:
            self.known[key] = len(self.materials)
            self.materials.append(
                {
                    "pbrMetallicRoughness": {
                        "baseColorFactor": list(colour),
                        "metallicFactor": 0.0,
                        "roughnessFactor": 0.9,
                    },
                    "doubleSided": True,
                    "alphaMode": "OPAQUE" if colour[3] == 1.0 else "BLEND",
                }
            )
        return self.known[key]


def _surface(sources: Sequence[SourceGeometry]) -> Mesh | None:
    """The triangles of all meshes and polygons in space, in the instance's frame; not those of outlines."""
    parts: list[Mesh] = []
    for source in sources:
        try:
            part = None if source.type == "POLYGON2D" else triangles(source)
        except InvalidInput:
            # What cannot be triangulated cannot be shown.
            part = None
        if part is not None and len(part.faces):
            parts.append(part)
    if not parts:
        return None
    starts = np.cumsum([0, *(len(part.vertices_m) for part in parts[:-1])])
    return Mesh(
        np.concatenate([part.vertices_m for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
    )


def _extruded(placed: PlacedInstance) -> Mesh | None:
    """The prism over the footprint, in the instance's frame."""
    if placed.footprint is None or placed.footprint.is_empty:
        return None
    origin = np.array([placed.pose.x_m, placed.pose.y_m, placed.pose.z_m])
    band = placed.band or HeightBand(placed.pose.z_m, placed.pose.z_m + SLAB_M)
    # Moved to the pose before it is turned, so that places far from the origin keep their digits.
    near: Polygon | MultiPolygon = shapely.transform(placed.footprint, lambda points: points - origin[:2])
    prism = extrude(near, band.z_min_m - origin[2], band.z_max_m - origin[2])
    return Mesh(prism.vertices_m @ placed.pose.matrix()[:3, :3], prism.faces)


def _extras(placed: PlacedInstance) -> dict[str, object]:
    entry = placed.entry
    extras: dict[str, object] = {"uid": str(entry.uid), "concept": entry.concept}
    for key, value in (("alias", entry.alias), ("storey", entry.storey), ("joins", list(entry.joins))):
        if value:
            extras[key] = value
    if entry.attributes:
        extras["attributes"] = dict(entry.attributes)
    return extras


def _unit(quaternion: list[float]) -> list[float]:
    return [float(part) for part in np.array(quaternion) / np.linalg.norm(quaternion)]


def _glb(tree: Mapping[str, object], data: bytes) -> bytes:
    """The container: a header, the JSON chunk padded with blanks, the binary chunk padded with zeros."""
    text = json.dumps(tree, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if data:
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
