"""Moving features as JSON (OGC 19-045r3, MF-JSON Prism; OGC 22-003r3)."""

from __future__ import annotations

from sqlalchemy import Connection

from semap.store.motion.track_history import span
from semap.timeline.stamp import rfc3339

GREGORIAN = "urn:ogc:data:time:iso8601"


def moving_members(connection: Connection, track_id: int, uri: str) -> dict[str, object]:
    """What a track's feature says beyond GeoJSON: in which systems it is given, and when it lived."""
    members: dict[str, object] = {
        "crs": {"type": "Name", "properties": {"name": uri}},
        "trs": {"type": "Name", "properties": {"name": GREGORIAN}},
    }
    lived = span(connection, track_id)
    if lived is not None:
        members["time"] = [rfc3339(each) for each in lived]
    return members
