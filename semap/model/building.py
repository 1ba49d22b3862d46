"""A building as read from a file, before it is written to the map.

Coordinates are metres in the map frame (z up) unless a pose says otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from uuid import UUID

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semap.model.anchor import Anchor
from semap.model.pose import IDENTITY, Pose


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh.

    vertices_m  (n, 3) float64 [m]
    faces       (m, 3) int64, indices of vertices
    """

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]


@dataclass(frozen=True)
class HeightBand:
    """Heights [z_min_m, z_max_m) in the map frame; half open, so that stacked storeys do not overlap."""

    z_min_m: float
    z_max_m: float


@dataclass(frozen=True, eq=False)
class Storey:
    """One level of the building; it becomes an instance of Storey and a frame at its elevation."""

    uid: UUID
    name: str
    elevation_m: float


@dataclass(frozen=True, eq=False)
class Item:
    """A room, a door or another thing of the building; it becomes an instance.

    pose       map_T_item; `body` is in the item's own frame
    footprint  outline in the map frame where the file gives one; else it is derived from the body
    band       heights that belong to the item; None: those of its body
    joins      names of the rooms on both sides (doors and openings)
    """

    uid: UUID
    name: str
    concept: str
    alias: str | None = None
    storey: str | None = None
    pose: Pose = IDENTITY
    body: Mesh | None = None
    footprint: Polygon | MultiPolygon | None = None
    band: HeightBand | None = None
    joins: tuple[str, ...] = ()
    attributes: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Finding:
    """Something about an import that its reader should know: what was done to what, and why."""

    action: str
    """'repaired', 'skipped' or 'note'"""
    subject: str
    reason: str


@dataclass(frozen=True, eq=False)
class Building:
    """All that one file says, with what had to be repaired or skipped.

    anchor  where its coordinates lie on the earth; None: the file does not say
    """

    storeys: tuple[Storey, ...]
    items: tuple[Item, ...]
    findings: tuple[Finding, ...] = ()
    anchor: Anchor | None = None
