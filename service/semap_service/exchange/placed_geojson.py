"""Instances with where they stand, as GeoJSON: in metres of the map frame, or in a system of the earth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import shapely
from sqlalchemy import Connection

from semap.formats.geojson_export import write_geojson
from semap.model.map_document import PlacedInstance
from semap.store.anchor import on_earth
from semap_service.exchange.crs import epsg_of

WGS84 = 4326


def placed_geojson(
    connection: Connection, map_name: str, placed: Sequence[PlacedInstance], crs: str | None
) -> dict[str, Any]:
    """A FeatureCollection of all instances; in another system than RFC 7946's it says in which.

    raises  Conflict if the map has no anchor, InvalidInput for an unknown system
    """
    document: dict[str, Any] = write_geojson(placed)
    epsg = epsg_of(crs)
    if epsg is None:
        return document
    features = document["features"]
    shapes = [shapely.from_geojson(json.dumps(each["geometry"])) for each in features]
    moved = on_earth(connection, map_name, shapes, epsg)
    document["features"] = [
        {**feature, "geometry": json.loads(shapely.to_geojson(shape))}
        for feature, shape in zip(features, moved, strict=True)
    ]
    if epsg != WGS84:
        # The member of the former GeoJSON (2008, 3), which GIS programs still read.
        document["crs"] = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:EPSG::{epsg}"}}
    return document
