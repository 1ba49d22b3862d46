"""Systems of coordinates by their URI (OGC API Features, part 2)."""

from __future__ import annotations

import re
from collections.abc import Mapping

from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.store.features.placing import (
    CRS84,
    MAP_FRAME,
    WEB_MERCATOR,
    WGS84,
    Placing,
    System,
    is_north_first,
)

CRS84_URI = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
CRS84H_URI = "http://www.opengis.net/def/crs/OGC/0/CRS84h"
MAP_FRAME_URI = "urn:semap:crs:map-frame"
"""Metres in the frame of the map: x, y and z, right-handed, z up."""

EPSG_URI = "http://www.opengis.net/def/crs/EPSG/0/{}"
OTHER_SPELLING = re.compile(r"(?:urn:ogc:def:crs:EPSG:[\d.]*:|EPSG:)(\d+)")


def systems_of(connection: Connection, placing: Placing) -> dict[str, System]:
    """The systems that a map is offered in, by URI; the first is the default."""
    found: dict[str, System] = {
        CRS84_URI: CRS84,
        CRS84H_URI: CRS84,
        EPSG_URI.format(WGS84): System(WGS84, north_first=True, degrees=True),
        EPSG_URI.format(WEB_MERCATOR): System(WEB_MERCATOR),
        MAP_FRAME_URI: MAP_FRAME,
    }
    if placing.epsg is not None:
        found.setdefault(
            EPSG_URI.format(placing.epsg),
            System(placing.epsg, north_first=is_north_first(connection, placing.epsg)),
        )
    return found


def system_of(given: str | None, systems: Mapping[str, System], where: str) -> tuple[str, System]:
    """The URI and system that a parameter asks for; CRS84 where it asks for none.

    raises  InvalidInput for one that is not offered
    """
    if given is None:
        return CRS84_URI, CRS84
    known = given.strip("<>[]")
    if (spelling := OTHER_SPELLING.fullmatch(known)) is not None:
        known = EPSG_URI.format(spelling[1])
    if known not in systems:
        raise InvalidInput(f"{given} is not offered", f"Choose one of {', '.join(systems)}.", where)
    return known, systems[known]
