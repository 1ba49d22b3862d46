"""What is derived from a mesh, so that questions of space can be answered without it.

The names are those of SEMAP's abstractions; `Footprint` is the true outline, concave where the body is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Point

from semap.errors import InvalidInput
from semap.geometry.outline import outline
from semap.model.building import Mesh


@dataclass(frozen=True, eq=False)
class Abstraction:
    """One geometry derived from a mesh, in the mesh's frame, and the heights over which it holds.

    z_min_m, z_max_m  None: it holds at every height
    """

    type: str
    geometry: shapely.Geometry
    z_min_m: float | None
    z_max_m: float | None


def derive(mesh: Mesh) -> tuple[Abstraction, ...]:
    """Every abstraction of `DERIVATIONS` for a mesh, in the order of that table.

    mesh     in the frame in which the abstractions are wanted, z up (see `semap.geometry.pose`)
    raises   InvalidInput if the mesh has no triangles, or no area seen from above
    """
    if len(mesh.faces) == 0:
        raise InvalidInput("a mesh without triangles", "Export the surface of the body, not only its points.")
    heights_m = mesh.vertices_m[mesh.faces, 2]
    z_min_m, z_max_m = float(heights_m.min()), float(heights_m.max())
    return tuple(
        Abstraction(type_, derivation(mesh), z_min_m, z_max_m) for type_, derivation in DERIVATIONS.items()
    )


def _footprint_hull(mesh: Mesh) -> shapely.Geometry:
    return shapely.MultiPoint(mesh.vertices_m[np.unique(mesh.faces), :2]).convex_hull


def _position_3d(mesh: Mesh) -> shapely.Geometry:
    used = mesh.vertices_m[np.unique(mesh.faces)]
    return Point((used.min(axis=0) + used.max(axis=0)) / 2)


DERIVATIONS: Mapping[str, Callable[[Mesh], shapely.Geometry]] = {
    "Footprint": outline,
    "FootprintHull": _footprint_hull,
    "Position3D": _position_3d,
}
"""One line for each type of abstraction."""
