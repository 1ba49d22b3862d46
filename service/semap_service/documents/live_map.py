"""What is told of a map that is shown, as it is now and as it was: who is where, and how doors stand."""

from __future__ import annotations

import math
from typing import Any, Literal

from pydantic import ConfigDict, Field

from semap.store.live import ShownTrack
from semap_service.documents.document import Document, Stamp


class ShownTrackDocument(Document):
    """Someone or something, as it was seen last."""

    track_id: int
    name: str = Field(examples=["person 3"])
    stamp: Stamp
    x_m: float
    y_m: float
    z_m: float | None
    heading_rad: float | None
    speed_mps: float | None
    length_m: float | None
    width_m: float | None
    cov_xx_m2: float | None = Field(description="Covariance of its place; null where it is not known.")
    cov_xy_m2: float | None
    cov_yy_m2: float | None
    rooms: list[int] = Field(description="Ids of the instances that it is in.")
    ended: bool = Field(description="False: what has ended is not shown.")


class ShownDoorDocument(Document):
    """How a door stands."""

    instance_id: int
    name: str = Field(examples=["Door07"])
    state: str = Field(description="open, closed, opening, closing, or unknown.", examples=["open"])
    since: Stamp | None


class Snapshot(Document):
    """All that is on the map now."""

    type: Literal["snapshot"] = "snapshot"
    stamp: Stamp | None = Field(description="The newest of the stamps; null where nothing was seen yet.")
    tracks: list[ShownTrackDocument]
    doors: list[ShownDoorDocument]
    rooms: dict[str, int] = Field(description="How many tracks are in each instance, by its id; 0 left out.")
    event_cursor: int = Field(description="Number of the newest event by then; 0 where there was none.")
    change_set: int = Field(description="The newest change of the map; 0 where there was none.")


class Delta(Document):
    """What is otherwise than in the message before."""

    model_config = ConfigDict(json_schema_serialization_defaults_required=False)

    type: Literal["delta"]
    stamp: Stamp | None
    tracks: list[ShownTrackDocument] = Field(description="Those that are new, or have changed.")
    gone: list[int] = Field(description="Ids of tracks that are on the map no more.")
    doors: list[ShownDoorDocument]
    rooms: dict[str, int] = Field(description="Instances whose number has changed; 0: nobody is in it now.")
    change_set: int = Field(
        default=0, description="Only where the map was changed: read what you need of it again."
    )


class LiveHeartbeat(Document):
    """Nothing has changed for a while; the connection is alive."""

    type: Literal["heartbeat"] = "heartbeat"


LiveMessage = Snapshot | Delta | LiveHeartbeat


def _covariance_m2(track: ShownTrack) -> tuple[float | None, float | None, float | None]:
    if track.std_m is None:
        return None, None, None
    if track.std_across_m is None or track.std_yaw_rad is None:
        return track.std_m**2, 0.0, track.std_m**2
    along_m2, across_m2 = track.std_m**2, track.std_across_m**2
    cos, sin = math.cos(track.std_yaw_rad), math.sin(track.std_yaw_rad)
    return (
        along_m2 * cos**2 + across_m2 * sin**2,
        (along_m2 - across_m2) * cos * sin,
        along_m2 * sin**2 + across_m2 * cos**2,
    )


def track_values(track: ShownTrack) -> dict[str, Any]:
    """The values of a `ShownTrackDocument`, by name."""
    values = {name: getattr(track, name, None) for name in ShownTrackDocument.model_fields}
    xx, xy, yy = _covariance_m2(track)
    return values | {
        "cov_xx_m2": xx,
        "cov_xy_m2": xy,
        "cov_yy_m2": yy,
        "rooms": list(track.rooms),
        "ended": False,
    }
