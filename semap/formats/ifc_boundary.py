"""Where spaces of an IFC model meet without a wall: their virtual boundaries, as lines with heights.

The surface of a boundary is drawn in the frame of its space, as a curve that is swept upwards
(IfcSurfaceOfLinearExtrusion) or as a polygon in a plane (IfcCurveBoundedPlane); other kinds are not read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import LineString, STRtree

Entity = Any
Placement = Callable[[Entity], NDArray[np.float64]]
"""The (4, 4) matrix of an IfcAxis2Placement3D or of an IfcObjectPlacement, in units of the file."""

VIRTUAL = "VIRTUAL"
SAME_PLACE_M = 0.15
"""Boundaries of two spaces that meet are drawn at one place, or on both sides of a thin line."""

NARROWEST_M = 0.4
LOWEST_M = 1.5
"""Nobody passes through what is smaller."""


@dataclass(frozen=True)
class Boundary:
    """A part of the side of a space: its line seen from above [m, map frame], and its heights [m]."""

    space: int
    line: LineString
    z_min_m: float
    z_max_m: float


@dataclass(frozen=True)
class Meeting:
    """Where two spaces, by the numbers of their entities, meet."""

    spaces: tuple[int, int]
    line: LineString
    z_min_m: float
    z_max_m: float


def virtual_boundaries(file: Entity, scale: float, placement: Placement) -> tuple[list[Boundary], int]:
    """The upright virtual boundaries of spaces, and how many there are that cannot be read.

    scale      metres for one unit of the file
    """
    found: list[Boundary] = []
    unread = 0
    for relation in file.by_type("IfcRelSpaceBoundary"):
        space = relation.RelatingSpace
        if relation.PhysicalOrVirtualBoundary != VIRTUAL or space is None or not space.is_a("IfcSpace"):
            continue
        drawn = getattr(relation.ConnectionGeometry, "SurfaceOnRelatingElement", None)
        corners = None if drawn is None else _corners(drawn, placement)
        if corners is None:
            unread += 1
            continue
        world_T_space = placement(space.ObjectPlacement)
        corners_m = (corners @ world_T_space[:3, :3].T + world_T_space[:3, 3]) * scale
        flat_m = corners_m[:, :2]
        start = flat_m[np.argmax(np.linalg.norm(flat_m - flat_m[0], axis=1))]
        end = flat_m[np.argmax(np.linalg.norm(flat_m - start, axis=1))]
        z_min_m, z_max_m = float(corners_m[:, 2].min()), float(corners_m[:, 2].max())
        if np.linalg.norm(end - start) >= NARROWEST_M and z_max_m - z_min_m >= LOWEST_M:
            found.append(Boundary(space.id(), LineString([start, end]), z_min_m, z_max_m))
    return found, unread


def meetings(boundaries: Sequence[Boundary]) -> Iterator[Meeting]:
    """Where boundaries of two spaces lie at one place, wide and high enough to pass."""
    if not boundaries:
        return
    tree = STRtree([each.line.buffer(SAME_PLACE_M) for each in boundaries])
    near = {tuple(sorted(pair)) for pair in tree.query([each.line for each in boundaries]).T.tolist()}
    for i, j in sorted(near):
        one, other = boundaries[i], boundaries[j]
        z_min_m, z_max_m = max(one.z_min_m, other.z_min_m), min(one.z_max_m, other.z_max_m)
        if one.space == other.space or z_max_m - z_min_m < LOWEST_M:
            continue
        shared = one.line.intersection(other.line.buffer(SAME_PLACE_M, cap_style="flat"))
        if isinstance(shared, LineString) and shared.length >= NARROWEST_M:
            spaces = (min(one.space, other.space), max(one.space, other.space))
            yield Meeting(spaces, shared, z_min_m, z_max_m)


def _corners(surface: Entity, placement: Placement) -> NDArray[np.float64] | None:
    """Corners (n, 3) of a surface, in the frame of its space and in units of the file."""
    if surface.is_a("IfcSurfaceOfLinearExtrusion"):
        curve = _points(getattr(surface.SweptCurve, "Curve", None))
        if curve is None or surface.Position is None:
            return None
        way = np.array([*surface.ExtrudedDirection.DirectionRatios, 0.0])[:3] * surface.Depth
        local = np.concatenate([curve, curve + way])
    elif surface.is_a("IfcCurveBoundedPlane"):
        outside = _points(surface.OuterBoundary)
        if outside is None:
            return None
        local, surface = outside, surface.BasisSurface
    else:
        return None
    space_T_surface = placement(surface.Position)
    corners: NDArray[np.float64] = local @ space_T_surface[:3, :3].T + space_T_surface[:3, 3]
    return corners


def _points(curve: Entity | None) -> NDArray[np.float64] | None:
    """The corners (n, 3) of a curve of straight pieces."""
    if curve is None:
        return None
    if curve.is_a("IfcPolyline"):
        rows = [point.Coordinates for point in curve.Points]
    elif curve.is_a("IfcIndexedPolyCurve"):
        rows = list(curve.Points.CoordList)
    elif curve.is_a("IfcCompositeCurve"):
        parts = [_points(segment.ParentCurve) for segment in curve.Segments]
        known = [part for part in parts if part is not None]
        return np.concatenate(known) if len(known) == len(parts) and known else None
    else:
        return None
    return np.array([[*row, 0.0][:3] for row in rows], dtype=np.float64)
