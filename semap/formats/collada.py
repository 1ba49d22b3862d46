"""Meshes in COLLADA (.dae, 1.4 and 1.5).

Triangles, polygon lists, polygons, strips and fans of every geometry that the scene instantiates, through
nodes, library nodes and controllers (a skin in its bind shape). Lines, splines, physics and animations are
passed over. Nothing outside the file is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput, TooLarge
from semap.formats.mesh_part import SMALLER, FaceCount, MeshParts, floats, integers, placed
from semap.formats.xml_guard import local, walk_xml
from semap.geometry.triangulation import face_triangles
from semap.model.building import Mesh

MAX_ELEMENTS = 500_000
MAX_DEPTH = 64
MAX_VISITS = 100_000
UP = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}

Element = ElementTree.Element
Surface = tuple[NDArray[np.float64], NDArray[np.int64]]


def read_dae(data: bytes, max_faces: int) -> MeshParts:
    """The geometries of the scene of a COLLADA file, each as often as it is instantiated.

    raises  TooLarge above the limits; InvalidInput if the bytes are no COLLADA file
    """
    walk_xml([data], MAX_ELEMENTS)
    try:
        # The walk above has refused every document type, and with it every entity.
        document = _Document(ElementTree.fromstring(data))  # noqa: S314
        return MeshParts(list(document.parts(max_faces)), document.unit_m(), document.up())
    except (
        ValueError,
        LookupError,
        StopIteration,
        RuntimeError,
        TypeError,
        AttributeError,
        ElementTree.ParseError,
    ) as error:
        raise InvalidInput(
            f"the bytes are no readable dae file: {type(error).__name__}: {error}", "Export the mesh again."
        ) from error


class _Document:
    """A parsed file, its elements by id, its geometries read once."""

    def __init__(self, root: Element) -> None:
        for element in root.iter():
            element.tag = local(str(element.tag))
        if root.tag != "COLLADA":
            raise ValueError(f"the root is {root.tag!r}")
        self._root = root
        self._by_id = {element.attrib["id"]: element for element in root.iter() if "id" in element.attrib}
        self._surfaces: dict[str, Surface] = {}

    def unit_m(self) -> float:
        unit = self._root.find("asset/unit")
        return 1.0 if unit is None else float(unit.attrib.get("meter", 1.0))

    def up(self) -> str:
        axis = self._root.find("asset/up_axis")
        return UP["Y_UP" if axis is None else (axis.text or "").strip()]

    def parts(self, max_faces: int) -> Iterator[Mesh]:
        count = FaceCount(max_faces)
        visits = 0
        waiting = [(node, np.eye(4), 0) for node in self._scene()]
        while waiting:
            node, world_T_parent, depth = waiting.pop()
            visits += 1
            if depth > MAX_DEPTH or visits > MAX_VISITS:
                raise TooLarge("The dae file repeats its nodes too often, or nests them too deep.", SMALLER)
            world_T_node = world_T_parent @ _transform(node)
            for child in node:
                if child.tag == "node":
                    waiting.append((child, world_T_node, depth + 1))
                elif child.tag == "instance_node":
                    waiting.append((self._named(child.attrib["url"]), world_T_node, depth + 1))
                elif child.tag in ("instance_geometry", "instance_controller"):
                    vertices, faces = self._surface(child.attrib["url"])
                    count.add(len(vertices), len(faces))
                    if len(faces):
                        yield placed(world_T_node, vertices, faces)

    def _scene(self) -> list[Element]:
        instance = self._root.find("scene/instance_visual_scene")
        if instance is not None:
            return list(self._named(instance.attrib["url"]).findall("node"))
        return list(self._root.findall("library_visual_scenes/visual_scene/node"))

    def _named(self, url: str) -> Element:
        if not url.startswith("#"):
            raise ValueError(f"{url!r} lies in another file")
        return self._by_id[url[1:]]

    def _surface(self, url: str) -> Surface:
        if url not in self._surfaces:
            element, bind = self._named(url), np.eye(4)
            skin = element.find("skin")
            if skin is not None:
                element = self._named(skin.attrib["source"])
                shape = skin.find("bind_shape_matrix")
                bind = bind if shape is None else floats(shape.text, 16).reshape(4, 4)
            mesh = element.find("mesh")
            empty = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
            vertices, faces = empty if mesh is None else self._mesh(mesh)
            part = placed(bind, vertices, faces)
            self._surfaces[url] = part.vertices_m, part.faces
        return self._surfaces[url]

    def _mesh(self, mesh: Element) -> Surface:
        faces: list[NDArray[np.int64]] = [np.empty((0, 3), dtype=np.int64)]
        # Primitives usually share one array of positions, which is read once.
        arrays: dict[str, tuple[int, NDArray[np.float64]]] = {}
        end = 0
        for primitive in mesh:
            if primitive.tag in PRIMITIVES:
                name = _input(primitive, "VERTEX").attrib["source"]
                if name not in arrays:
                    arrays[name] = end, self._positions(name)
                    end += len(arrays[name][1])
                start, points = arrays[name]
                faces.extend(found + start for found in _faces(primitive, points))
        return np.concatenate([np.empty((0, 3)), *(points for _, points in arrays.values())]), np.concatenate(
            faces
        )

    def _positions(self, vertices_url: str) -> NDArray[np.float64]:
        source = self._named(_input(self._named(vertices_url), "POSITION").attrib["source"])
        accessor = source.find("technique_common/accessor")
        assert accessor is not None  # noqa: S101  met above as AttributeError otherwise
        stride, offset = int(accessor.attrib.get("stride", 1)), int(accessor.attrib.get("offset", 0))
        values = floats(self._named(accessor.attrib["source"]).text)
        if stride < 3 or offset < 0:
            raise ValueError(f"positions of {stride} coordinates")
        rows = values[offset : offset + stride * ((len(values) - offset) // stride)].reshape(-1, stride)
        return rows[:, :3]


def _input(element: Element, semantic: str) -> Element:
    return next(each for each in element.findall("input") if each.attrib["semantic"] == semantic)


def _faces(primitive: Element, points: NDArray[np.float64]) -> Iterator[NDArray[np.int64]]:
    """Triangles (m, 3) of one primitive."""
    inputs = primitive.findall("input")
    width = max(int(each.attrib.get("offset", 0)) for each in inputs) + 1
    place = int(_input(primitive, "VERTEX").attrib.get("offset", 0))
    if not 0 < width <= 64:
        raise ValueError(f"{width} indices for each corner")
    runs = [integers(p.text).reshape(-1, width)[:, place] for p in primitive.iter("p")]
    for run in runs:
        if len(run) and (run.min() < 0 or run.max() >= len(points)):
            raise ValueError("an index outside its array")
        if primitive.tag == "triangles":
            yield run[: len(run) // 3 * 3].reshape(-1, 3)
        elif primitive.tag == "tristrips":
            strip = np.column_stack([run[:-2], run[1:-1], run[2:]])
            strip[1::2] = strip[1::2, ::-1]
            yield strip
        elif primitive.tag == "trifans":
            yield np.column_stack(
                [np.full(max(len(run) - 2, 0), run[0] if len(run) else 0), run[1:-1], run[2:]]
            )
        elif primitive.tag == "polygons":
            if len(run) >= 3:
                yield _polygon(points, run)
        else:
            yield from _polylist(primitive, points, run)


def _polylist(
    primitive: Element, points: NDArray[np.float64], run: NDArray[np.int64]
) -> Iterator[NDArray[np.int64]]:
    element = primitive.find("vcount")
    sizes = integers(None if element is None else element.text)
    if (sizes < 0).any() or sizes.sum() != len(run):
        raise ValueError("polygons of other sizes than announced")
    if len(sizes) and (sizes == 3).all():
        yield run.reshape(-1, 3)
        return
    for corners in np.split(run, np.cumsum(sizes)[:-1]):
        if len(corners) >= 3:
            yield _polygon(points, corners)


def _polygon(points: NDArray[np.float64], corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles of a polygon; of a bent one, which the format forbids and programs write, a fan."""
    try:
        return face_triangles(points, corners)
    except InvalidInput:
        return np.column_stack([np.full(len(corners) - 2, corners[0]), corners[1:-1], corners[2:]])


PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans")


def _transform(node: Element) -> NDArray[np.float64]:
    """parent_T_node: its transformations, in the order in which they are written."""
    matrix = np.eye(4)
    for child in node:
        step = np.eye(4)
        if child.tag == "matrix":
            step = floats(child.text, 16).reshape(4, 4)
        elif child.tag == "translate":
            step[:3, 3] = floats(child.text, 3)
        elif child.tag == "scale":
            step[:3, :3] = np.diag(floats(child.text, 3))
        elif child.tag == "rotate":
            *axis, degrees = floats(child.text, 4)
            length = float(np.linalg.norm(axis))
            if length > 0:
                turn = np.array(axis) / length * np.radians(degrees)
                from scipy.spatial.transform import Rotation  # noqa: PLC0415  slow to import

                step[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
        elif child.tag in ("lookat", "skew"):
            raise ValueError(f"a node placed by {child.tag!r}")
        matrix = matrix @ step
    return matrix
