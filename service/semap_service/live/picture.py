"""What is on a map, each part as JSON, so that parts are written once and compared as they are sent."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from pydantic import ConfigDict, Field, TypeAdapter

from semap.store.live import LiveMap, LiveTrack
from semap_service.document import Document, Stamp, rfc3339


class LiveTrackDocument(Document):
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
    ended: bool = Field(description="False: what has ended is `gone`.")


class LiveDoorDocument(Document):
    """How a door stands."""

    instance_id: int
    name: str = Field(examples=["Door07"])
    state: str = Field(description="open, closed, opening, closing, or unknown.", examples=["open"])
    since: Stamp | None


class Snapshot(Document):
    """All that is on the map now."""

    type: Literal["snapshot"] = "snapshot"
    stamp: Stamp | None = Field(description="The newest of the stamps; null where nothing was seen yet.")
    tracks: list[LiveTrackDocument]
    doors: list[LiveDoorDocument]
    rooms: dict[str, int] = Field(description="How many tracks are in each instance, by its id; 0 left out.")
    event_cursor: int = Field(description="Number of the newest event by then; 0 where there was none.")
    change_set: int = Field(description="The newest change of the map; 0 where there was none.")


class Delta(Document):
    """What is otherwise than in the message before."""

    model_config = ConfigDict(json_schema_serialization_defaults_required=False)

    type: Literal["delta"]
    stamp: Stamp | None
    tracks: list[LiveTrackDocument] = Field(description="Those that are new, or have changed.")
    gone: list[int] = Field(description="Ids of tracks that are on the map no more.")
    doors: list[LiveDoorDocument]
    rooms: dict[str, int] = Field(description="Instances whose number has changed; 0: nobody is in it now.")
    change_set: int = Field(
        default=0, description="Only where the map was changed: read what you need of it again."
    )


class LiveHeartbeat(Document):
    """Nothing has changed for a while; the connection is alive."""

    type: Literal["heartbeat"] = "heartbeat"


LiveMessage = Snapshot | Delta | LiveHeartbeat


@dataclass(frozen=True)
class Picture:
    """A map at a moment. tracks, doors: JSON by id."""

    stamp: datetime | None
    tracks: Mapping[int, bytes]
    doors: Mapping[int, bytes]
    rooms: Mapping[int, int]
    event_cursor: int
    change_set: int
    live: LiveMap

    def shows_the_same(self, other: Picture) -> bool:
        """Whether there is nothing to tell beyond it."""
        return (
            self.tracks == other.tracks and self.doors == other.doors and self.change_set == other.change_set
        )


def picture_of(live: LiveMap, before: Picture | None = None) -> Picture:
    """What is on a map; what is as it was before is not written anew."""
    tracks = {
        track_id: before.tracks[track_id]
        if before is not None and before.live.tracks.get(track_id) == track
        else _TRACK.dump_json(_track(track))
        for track_id, track in live.tracks.items()
    }
    doors = {
        instance_id: before.doors[instance_id]
        if before is not None and before.live.doors.get(instance_id) == door
        else _DOOR.dump_json(LiveDoorDocument.model_validate(door))
        for instance_id, door in live.doors.items()
    }
    stamps = [
        *(track.stamp for track in live.tracks.values()),
        *(door.since for door in live.doors.values() if door.since is not None),
    ]
    rooms = Counter(room for track in live.tracks.values() for room in track.rooms)
    return Picture(
        max(stamps, default=None if before is None else before.stamp),
        tracks,
        doors,
        rooms,
        live.event_cursor,
        live.change_set,
        live,
    )


def snapshot(picture: Picture) -> bytes:
    """All of a picture, as JSON in UTF-8."""
    return b"".join(
        [
            b'{"type":"snapshot","stamp":',
            _stamp(picture),
            b',"tracks":[',
            b",".join(picture.tracks.values()),
            b'],"doors":[',
            b",".join(picture.doors.values()),
            b'],"rooms":',
            _rooms(picture.rooms),
            b',"event_cursor":%d,"change_set":%d}' % (picture.event_cursor, picture.change_set),
        ]
    )


def delta(before: Picture, now: Picture) -> bytes:
    """What is otherwise in a later picture, as JSON in UTF-8."""
    rooms = {
        room: now.rooms.get(room, 0)
        for room in {**before.rooms, **now.rooms}
        if now.rooms.get(room, 0) != before.rooms.get(room, 0)
    }
    gone = [track_id for track_id in before.tracks if track_id not in now.tracks]
    parts = [
        b'{"type":"delta","stamp":',
        _stamp(now),
        b',"tracks":[',
        b",".join(written for each, written in now.tracks.items() if before.tracks.get(each) != written),
        b'],"gone":',
        json.dumps(gone, separators=(",", ":")).encode(),
        b',"doors":[',
        b",".join(written for each, written in now.doors.items() if before.doors.get(each) != written),
        b'],"rooms":',
        _rooms(rooms),
        b',"change_set":%d' % now.change_set if now.change_set != before.change_set else b"",
        b"}",
    ]
    return b"".join(parts)


def _track(track: LiveTrack) -> LiveTrackDocument:
    variance_m2 = None if track.std_m is None else track.std_m**2
    return LiveTrackDocument(
        track_id=track.track_id,
        name=track.name,
        stamp=track.stamp,
        x_m=track.x_m,
        y_m=track.y_m,
        z_m=track.z_m,
        heading_rad=track.heading_rad,
        speed_mps=track.speed_mps,
        length_m=track.length_m,
        width_m=track.width_m,
        cov_xx_m2=variance_m2,
        cov_xy_m2=None if variance_m2 is None else 0.0,
        cov_yy_m2=variance_m2,
        rooms=list(track.rooms),
        ended=False,
    )


def _stamp(picture: Picture) -> bytes:
    return b"null" if picture.stamp is None else b'"%b"' % rfc3339(picture.stamp).encode()


def _rooms(rooms: Mapping[int, int]) -> bytes:
    return json.dumps({str(room): count for room, count in rooms.items()}, separators=(",", ":")).encode()


_TRACK = TypeAdapter(LiveTrackDocument)
_DOOR = TypeAdapter(LiveDoorDocument)
