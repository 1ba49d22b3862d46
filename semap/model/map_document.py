"""A whole map as values: what an export writes and an import reads, without loss.

Things name each other by name, which is unique in a map; ids of a database are not part of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal
from uuid import UUID

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semap.model.anchor import Anchor
from semap.model.building import HeightBand
from semap.model.pose import IDENTITY, Pose
from semap.model.source_geometry import SourceGeometry


@dataclass(frozen=True)
class ConceptEntry:
    """A kind of thing, with the kinds right above it; see `semap.store.map.concept.Concept`."""

    name: str
    parents: tuple[str, ...] = ()
    iris: tuple[str, ...] = ()
    comment: str | None = None
    attribute_schema: Mapping[str, object] | None = None


@dataclass(frozen=True)
class StampedPose:
    """parent_T_frame from a time on; None: from the beginning of time."""

    pose: Pose
    stamp: datetime | None = None


@dataclass(frozen=True)
class FrameEntry:
    """A frame; without a parent it is a root. `map` is the root in which a map's things are placed."""

    name: str
    parent: str | None
    poses: tuple[StampedPose, ...] = (StampedPose(IDENTITY),)


@dataclass(frozen=True, eq=False)
class DescriptionEntry:
    """What instances look like.

    key        names it in this document
    is_shared  whether it is a blueprint with that name; else it belongs to its one instance
    """

    key: str
    geometries: tuple[SourceGeometry, ...]
    is_shared: bool = False


@dataclass(frozen=True, eq=False)
class InstanceEntry:
    """A thing of the map; `frame` is the name of the frame in which its description stands."""

    uid: UUID
    name: str
    concept: str
    frame: str
    alias: str | None = None
    description: str | None = None
    storey: str | None = None
    joins: tuple[str, ...] = ()
    attributes: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class QueryEntry:
    """A continuous query.

    concept  of its objects; None: any
    options  what else it asks, as `semap.model.continuous_query.options_of` gives it
    """

    name: str
    predicate: str
    concept: str | None
    enabled: bool = True
    options: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class RuleEntry:
    """A rule, and the queries of the map that it reads."""

    name: str
    queries: tuple[str, ...]
    declaration: Mapping[str, object]
    enabled: bool = True


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A grid as ROS's map_server writes it: a backdrop of the map.

    pixels      (height, width) uint8, the first row at the top (largest y), as in the image
    origin      pose of the lower left corner of the lower left pixel in the map frame: x_m, y_m, yaw_rad
    thresholds  of the probability: occupied above the first, free below the second
    """

    name: str
    resolution_m: float
    origin: tuple[float, float, float]
    pixels: NDArray[np.uint8]
    negate: bool = False
    thresholds: tuple[float, float] = (0.65, 0.196)
    mode: Literal["trinary", "scale", "raw"] = "trinary"


@dataclass(frozen=True, eq=False)
class MapDocument:
    """All that is on a map."""

    name: str
    cell_m: float = 4.0
    anchor: Anchor | None = None
    concepts: tuple[ConceptEntry, ...] = ()
    frames: tuple[FrameEntry, ...] = (FrameEntry("map", None),)
    descriptions: tuple[DescriptionEntry, ...] = ()
    instances: tuple[InstanceEntry, ...] = ()
    queries: tuple[QueryEntry, ...] = ()
    rules: tuple[RuleEntry, ...] = ()
    grids: tuple[OccupancyGrid, ...] = ()


@dataclass(frozen=True, eq=False)
class PlacedInstance:
    """An instance with where it stands now; for exports that show rather than keep.

    pose       map_T_instance
    footprint  [m, map frame]
    sources    in the instance's own frame
    """

    entry: InstanceEntry
    pose: Pose
    footprint: Polygon | MultiPolygon | None
    band: HeightBand | None
    sources: tuple[SourceGeometry, ...]
