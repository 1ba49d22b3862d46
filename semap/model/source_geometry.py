"""What a description is made of: geometries in its frame, as files, sensors and people give them.

The types are SEMAP's. The orientation of POSE2D and POSE3D is that of `pose`; their shape is a point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Point, Polygon

from semap.model.building import HeightBand, Mesh
from semap.model.pose import IDENTITY, Pose

GeometryType = Literal[
    "POINT2D",
    "POSE2D",
    "POLYGON2D",
    "POINT3D",
    "POSE3D",
    "POLYGON3D",
    "TRIANGLEMESH3D",
    "POLYGONMESH3D",
]

BODY = "Body"
"""The name of the mesh that a file gives."""

OUTLINE = "Outline"
"""The name of the area that a file or a person gives."""


@dataclass(frozen=True, eq=False)
class PolygonMesh:
    """A mesh of planar polygons.

    vertices_m  (n, 3) float64 [m]
    faces       of each face the indices of its corners, counter-clockwise seen from outside
    """

    vertices_m: NDArray[np.float64]
    faces: tuple[tuple[int, ...], ...]


Shape: TypeAlias = Point | Polygon | MultiPolygon | Mesh | PolygonMesh


@dataclass(frozen=True, eq=False)
class SourceGeometry:
    """One geometry of a description.

    name  once in its description
    pose  description_T_geometry
    band  heights over which a POLYGON2D holds, in its own frame; None: at every height
    """

    name: str
    type: GeometryType
    shape: Shape
    pose: Pose = IDENTITY
    band: HeightBand | None = None
