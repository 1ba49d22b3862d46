"""What is told of a map that is shown, as it is now and as it was: who is where, and how doors stand."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import ConfigDict, Field

from semap.store.live import ShownTrack
from semap_service.document import Document, Stamp


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


def track_values(track: ShownTrack) -> dict[str, Any]:
    """The values of a `ShownTrackDocument`, by name."""
    values = {name: getattr(track, name, None) for name in ShownTrackDocument.model_fields}
    variance_m2 = None if track.std_m is None else track.std_m**2
    return values | {
        "cov_xx_m2": variance_m2,
        "cov_xy_m2": None if variance_m2 is None else 0.0,
        "cov_yy_m2": variance_m2,
        "rooms": list(track.rooms),
        "ended": False,
    }
