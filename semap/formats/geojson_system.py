"""Whether the coordinates of a floor plan are metres of the map or degrees, and degrees as metres.

RFC 7946 prescribes degrees; floor plans of robots are in metres of their own. So: what is asked for counts;
else what the member `crs` says, which programs still write; else how large the things are, since no room is
smaller than 2 cm, and none wider than 2 km, which is 0.02 degrees.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import shapely

from semap.errors import InvalidInput
from semap.formats.geojson_shape import Shape
from semap.geometry.utm import LATITUDES_DEG, project, zone_of
from semap.model.anchor import Anchor
from semap.model.building import Finding
from semap.model.pose import Pose

Crs: TypeAlias = Literal["metres", "degrees"]

GEOGRAPHIC = ("CRS84", "4326", "4979", "4258")
SMALLEST_ROOM = 0.02
"""What is smaller in metres is a crumb, what is larger in degrees a town."""

SITE_DEG = 1.0
"""A map of more is no site, and a zone of the projection is not much wider."""


@dataclass(frozen=True)
class System:
    """What the coordinates are, and how that is known."""

    crs: Crs
    reason: str


def system_of(document: object, shapes: Sequence[Shape], asked: Crs | None) -> System:
    """What the coordinates of a document are."""
    if asked is not None:
        return System(asked, "as was asked for")
    said = document.get("crs") if isinstance(document, Mapping) else None
    if said is not None:
        text = json.dumps(said, default=str)
        is_geographic = any(each in text for each in GEOGRAPHIC)
        return System("degrees" if is_geographic else "metres", f"since its `crs` is {text[:200]}")
    bounds = shapely.bounds(np.array(shapes, dtype=object))
    extents = np.maximum(bounds[:, 2] - bounds[:, 0], bounds[:, 3] - bounds[:, 1])
    extents = extents[extents > 0]
    if len(extents) == 0 or np.abs(bounds[:, [0, 2]]).max() > 180 or np.abs(bounds[:, [1, 3]]).max() > 90:
        return System("metres", "")
    middle = float(np.median(extents))
    if middle >= SMALLEST_ROOM:
        return System("metres", "")
    return System("degrees", f"since its features are {middle:.2g} wide")


def as_metres(
    shapes: Sequence[Shape], system: System, where: str
) -> tuple[tuple[Shape, ...], Anchor, Finding]:
    """Shapes in degrees as metres of a map that is anchored in the middle of them, x to the east.

    raises  InvalidInput if they are no degrees, or spread too far for one map
    """
    bounds = shapely.total_bounds(np.array(shapes, dtype=object))
    west, south, east, north = (float(each) for each in bounds)
    if max(abs(west), abs(east)) > 180 or not LATITUDES_DEG[0] <= south <= north <= LATITUDES_DEG[1]:
        raise InvalidInput(
            f"there is no place from {west:g}, {south:g} to {east:g}, {north:g}, or it is a pole; taken as"
            f" degrees {system.reason}",
            "Give longitude first, then latitude; or metres, with `--crs metres`.",
            where,
        )
    if max(east - west, north - south) > SITE_DEG:
        raise InvalidInput(
            f"the features lie {max(east - west, north - south):.3g} degrees apart, taken as degrees"
            f" {system.reason}",
            "Give each site a map of its own; or metres, with `--crs metres`.",
            where,
        )
    middle_deg = np.array([[(west + east) / 2, (south + north) / 2]])
    epsg = zone_of(*(float(each) for each in middle_deg[0]))
    origin_m = np.floor(project(middle_deg, epsg)[0])
    moved = shapely.transform(np.array(shapes, dtype=object), lambda deg: project(deg, epsg) - origin_m)
    anchor = Anchor(epsg, Pose(x_m=float(origin_m[0]), y_m=float(origin_m[1])))
    reason = (
        f"taken as degrees, {system.reason}; in metres of EPSG:{epsg}, the map's origin near"
        f" {middle_deg[0, 0]:.5f}, {middle_deg[0, 1]:.5f}, where the map is anchored (`--crs metres` if not)"
    )
    return tuple(moved), anchor, Finding("note", "coordinates", reason)
