"""Export to GeoJSON: outlines and openings with all that is known of them, for maps on screens and for GIS.

In metres, what `semap.formats.geojson` reads again: equal rooms and doors. Attributes that would be taken
for something else there lie in the property `attributes`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from semap.formats.geojson import OPENING_CONCEPTS, OWN_PROPERTIES
from semap.model.map_document import PlacedInstance

STOREY = "Storey"

ToWgs84 = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""From (n, 2) [m, map frame] to (n, 2) [degrees: longitude, latitude]."""


def write_geojson(instances: Sequence[PlacedInstance], to_wgs84: ToWgs84 | None = None) -> dict[str, object]:
    """A FeatureCollection of instances, as `json.dumps` takes it.

    Outlines are polygons; a door with a width is a line, anything else without an outline a point. Storeys
    are not features: the member `storeys` has their elevations.

    to_wgs84  gives RFC 7946's degrees; without it coordinates are metres of the map frame, which other
              programs must be told
    """
    storeys = {each.entry.name: each.pose.z_m for each in instances if each.entry.concept == STOREY}
    document: dict[str, object] = {
        "type": "FeatureCollection",
        "features": [_feature(each, to_wgs84) for each in instances if each.entry.concept != STOREY],
    }
    return document | {"storeys": storeys} if storeys else document


def _feature(placed: PlacedInstance, to_wgs84: ToWgs84 | None) -> dict[str, object]:
    shape = _shape(placed)
    if to_wgs84 is not None:
        shape = shapely.transform(shape, to_wgs84)
    return {
        "type": "Feature",
        "id": str(placed.entry.uid),
        "geometry": json.loads(shapely.to_geojson(shape)),
        "properties": _properties(placed),
    }


def _shape(placed: PlacedInstance) -> shapely.Geometry:
    if placed.footprint is not None:
        return shapely.force_2d(placed.footprint)
    pose = placed.pose
    width_m = placed.entry.attributes.get("width_m")
    is_line = placed.entry.concept in OPENING_CONCEPTS and isinstance(width_m, int | float) and width_m > 0
    if not is_line:
        return shapely.Point(pose.x_m, pose.y_m)
    along = pose.matrix()[:2, 0] * float(str(width_m)) / 2
    middle = np.array([pose.x_m, pose.y_m])
    return shapely.LineString([middle - along, middle + along])


def _properties(placed: PlacedInstance) -> dict[str, object]:
    entry = placed.entry
    own: dict[str, object] = {"name": entry.name, "concept": entry.concept, "uid": str(entry.uid)}
    if entry.alias is not None:
        own["alias"] = entry.alias
    if entry.storey is not None:
        own["storey"] = entry.storey
    if entry.joins or entry.concept in OPENING_CONCEPTS:
        own["joins"] = list(entry.joins)
    if placed.footprint is None:
        own["elevation_m"] = placed.pose.z_m
    elif placed.band is not None:
        own["elevation_m"] = placed.band.z_min_m
        own["height_m"] = placed.band.z_max_m - placed.band.z_min_m
    plain, hidden = _parted(entry.attributes)
    return own | plain | ({"attributes": hidden} if hidden else {})


def _parted(attributes: Mapping[str, object]) -> tuple[dict[str, object], dict[str, object]]:
    """Attributes, and those whose names mean something else in a feature."""
    plain = {key: value for key, value in attributes.items() if key not in OWN_PROPERTIES}
    return plain, {key: value for key, value in attributes.items() if key in OWN_PROPERTIES}
