"""What is on a map, each part as JSON, so that parts are written once and compared as they are sent."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from pydantic import TypeAdapter

from semap.store.motion.live import LiveMap
from semap.timeline.stamp import rfc3339
from semap_service.documents.live_map import ShownDoorDocument, ShownTrackDocument, track_values


@dataclass(frozen=True)
class Picture:
    """A map at a moment. tracks, doors: JSON by id."""

    stamp: datetime | None
    tracks: Mapping[int, bytes]
    doors: Mapping[int, bytes]
    rooms: Mapping[int, int]
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
        else _TRACK.dump_json(ShownTrackDocument(**track_values(track)))
        for track_id, track in live.tracks.items()
    }
    doors = {
        instance_id: before.doors[instance_id]
        if before is not None and before.live.doors.get(instance_id) == door
        else _DOOR.dump_json(ShownDoorDocument.model_validate(door))
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
        live.change_set,
        live,
    )


def snapshot(picture: Picture, *, own: bool = False) -> bytes:
    """All of a picture, as JSON in UTF-8; for who may see this map alone, its events by their own numbers."""
    event_cursor = picture.live.own_event_cursor if own else picture.live.event_cursor
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
            b',"event_cursor":%d,"change_set":%d}' % (event_cursor, picture.change_set),
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


def _stamp(picture: Picture) -> bytes:
    return b"null" if picture.stamp is None else b'"%b"' % rfc3339(picture.stamp).encode()


def _rooms(rooms: Mapping[int, int]) -> bytes:
    return json.dumps({str(room): count for room, count in rooms.items()}, separators=(",", ":")).encode()


_TRACK = TypeAdapter(ShownTrackDocument)
_DOOR = TypeAdapter(ShownDoorDocument)
