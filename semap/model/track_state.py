"""A state of a track: the one shape of it, of which columns, parsing and documents are made."""

from __future__ import annotations

from dataclasses import dataclass, fields
from datetime import datetime


@dataclass(frozen=True)
class Seen:
    """Where a track was seen, in the map frame; what its source does not know is None.

    std_m              standard deviation: of all directions, or along the longer axis of the error ellipse
    heading_rad        from x towards y, where the body faces
    length_m, width_m  of the body, along the heading and across
    std_across_m       along the shorter axis; None where it is alike in all directions
    std_yaw_rad        where the longer axis points, from x towards y
    """

    stamp: datetime
    x_m: float
    y_m: float
    z_m: float | None
    std_m: float | None
    heading_rad: float | None
    speed_mps: float | None
    length_m: float | None
    width_m: float | None
    std_across_m: float | None = None
    std_yaw_rad: float | None = None


@dataclass(frozen=True)
class TrackState(Seen):
    """A state as it is stored. After its last the track was gone."""

    is_last: bool = False


STATE_COLUMNS = tuple(each.name for each in fields(TrackState))
COORDINATES = ("x_m", "y_m", "z_m")
"""double precision in PostgreSQL"""
MEASURES = tuple(name for name in STATE_COLUMNS if name not in ("stamp", *COORDINATES, "is_last"))
"""real in PostgreSQL, each null where its source does not know it"""
