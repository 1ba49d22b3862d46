"""What readers of mesh files hand on: placed parts, with the unit and the axes that the file states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput, TooLarge
from semap.geometry.pose import transform_points
from semap.model.building import Mesh

SMALLER = "Simplify the mesh, or upload it in parts."


@dataclass(frozen=True, eq=False)
class MeshParts:
    """The meshes of a file, each where its scene places it, in the file's own unit and axes.

    unit_m  length of the file's unit [m]; None: the file does not say
    up      'x', 'y' or 'z'; None: the file does not say
    """

    meshes: Sequence[Mesh]
    unit_m: float | None = None
    up: str | None = None


class FaceCount:
    """Counts triangles before they are copied, as a scene may repeat a mesh any number of times."""

    def __init__(self, max_faces: int) -> None:
        self._max_faces = max_faces
        self._count = 0

    def add(self, vertex_count: int, face_count: int) -> None:
        """Count one more part; vertices that no triangle uses take memory too.

        raises  TooLarge above the limit
        """
        self._count += max(face_count, vertex_count // 3)
        if self._count > self._max_faces:
            raise TooLarge(f"The mesh has more than {self._max_faces} triangles.", SMALLER)


def placed(
    world_T_part: NDArray[np.float64], vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> Mesh:
    """A part in the world of its file; a mirroring placement keeps surfaces right side out.

    raises  InvalidInput if a triangle names a vertex that is not there
    """
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise InvalidInput("a triangle names a vertex that is not there", "Export the mesh again.")
    with np.errstate(all="ignore"):
        is_mirrored = np.linalg.det(world_T_part[:3, :3]) < 0
        points = transform_points(world_T_part, vertices)
    return Mesh(points, faces[:, ::-1] if is_mirrored else faces)


def floats(text: str | None, count: int | None = None) -> NDArray[np.float64]:
    """Numbers separated by white space.

    count   how many there must be; None: any
    raises  ValueError if there is something else in it, or another number of them
    """
    words = (text or "").split()
    if count is not None and len(words) != count:
        raise ValueError(f"{count} numbers announced, {len(words)} found")
    return np.array(words, dtype=np.float64)


def integers(text: str | None) -> NDArray[np.int64]:
    """Whole numbers separated by white space.

    raises  ValueError if there is something else in it
    """
    return np.array((text or "").split(), dtype=np.int64)
