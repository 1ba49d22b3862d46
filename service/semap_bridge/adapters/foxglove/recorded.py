"""What was, as an MCAP file: the same topics as live, at the pace that the app plays them."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from heapq import merge
from itertools import groupby
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import BinaryIO

import foxglove
from foxglove import Channel, Context
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import CompressedImage, Image
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.transform import Transform
from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.store.event.cloud_event import cloud_event_json, event_json
from semap.store.event.events import list_events_between
from semap.store.map.frames import Frame
from semap.store.map.placement import ROOT_FRAME
from semap.store.motion.live import UNKNOWN
from semap.store.motion.moment import door_states, extent, stays
from semap.store.motion.played import (
    Moved,
    Seen,
    SeenLines,
    ends_between,
    lines_between,
    moves_between,
    states_between,
)
from semap.timeline.stamp import MICROSECOND, to_us
from semap_bridge.adapters.foxglove.building import Building, door_entity, read_building
from semap_bridge.adapters.foxglove.channels import Channels, State, give_entities, log_time_ns, placed
from semap_bridge.adapters.foxglove.people import lines_entity, person_entity, track_id_of
from semap_bridge.adapters.foxglove.sensors import frame_transform, shown

MOST = 10_000_000
"""Of events, stays and states of doors, each of which is in memory."""
WHAT = {Scan: "scan", Image: "image", CompressedImage: "image", Boxes: "image/boxes"}

Given = tuple[int, Callable[[], None]]
"""A stamp [us], and what is written then."""


@dataclass(frozen=True)
class Written:
    """What is in a file: from when until before when, and how many of what."""

    start: datetime
    end: datetime
    counts: Mapping[str, int]


def write_mcap(
    connection: Connection,
    map_name: str,
    file: Path,
    start: datetime | None = None,
    end: datetime | None = None,
    sensors: Recording | None = None,
    sensors_frame: str = ROOT_FRAME,
) -> Written:
    """Write a map as it stands, and what was said of it, from its first stamp or `start` to before `end`.

    sensors        a recording whose scans, images, boxes and transforms are put in, too
    sensors_frame  the frame in it that is the map's
    raises         NotFound where there is no such map; InvalidInput where nothing was said of it;
                   OSError where the file cannot be written
    """
    since, until = _span(connection, map_name, start, end)
    scene = Context()
    with file.open("wb") as opened, foxglove.open_mcap(disk := _Disk(opened), context=scene):
        recorder = _Recorder(scene, read_building(connection, map_name, 0), to_us(since))
        streams = [
            recorder.seen(states_between(connection, map_name, since, until)),
            recorder.seen(ends_between(connection, map_name, since, until)),
            recorder.lines(lines_between(connection, map_name, since, until)),
            recorder.moves(moves_between(connection, map_name, since, until)),
            recorder.states(_changes(connection, map_name, since, until)),
            recorder.events(connection, map_name, since, until),
        ]
        if sensors is not None:
            streams.append(recorder.sensors(sensors, sensors_frame, to_us(since), to_us(until)))
        for _, write in merge(*streams, key=itemgetter(0)):
            write()
            disk.require_room()
    disk.require_room()
    return Written(since, until, recorder.counts)


class _Disk:
    """Mutable: a file that remembers what went wrong; the library would print a line a message and go on."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._failed: OSError | None = None

    def write(self, data: bytes | bytearray) -> int:
        if self._failed is None:
            try:
                return self._file.write(data)
            except OSError as error:
                self._failed = error
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def flush(self) -> None:
        if self._failed is None:
            try:
                self._file.flush()
            except OSError as error:
                self._failed = error

    def require_room(self) -> None:
        """raises OSError"""
        if self._failed is not None:
            raise self._failed


def _span(
    connection: Connection, map_name: str, start: datetime | None, end: datetime | None
) -> tuple[datetime, datetime]:
    known = extent(connection, map_name)
    if known is not None:
        return start or known[0], end or known[1] + MICROSECOND
    if start is None or end is None:
        raise InvalidInput(
            f"nothing was said of the map {map_name} yet", "Ingest tracks, or give --from and --to.", map_name
        )
    return start, end


class _Recorder:
    """Mutable by what it counts. Each of its streams is in the order of stamps."""

    def __init__(self, scene: Context, building: Building, since_us: int) -> None:
        self.counts: Counter[str] = Counter()
        self._scene = scene
        self._building = building
        self._channels = Channels(scene)
        self._sensors: dict[tuple[str, str], Channel] = {}
        give_entities(self._channels.building, list(building.entities.values()), (), since_us)
        self._channels.give_frames(building.frames, since_us)

    def seen(self, found: Iterable[Seen]) -> Iterator[Given]:
        for each in found:
            stamp_us = to_us(each.stamp)
            gone = [track_id_of(track_id) for track_id in each.ended]
            there = [person_entity(track) for track in each.tracks if track.track_id not in each.ended]
            self.counts["states"] += len(each.tracks)
            yield stamp_us, partial(give_entities, self._channels.people, there, gone, stamp_us)

    def lines(self, found: Iterable[SeenLines]) -> Iterator[Given]:
        for each in found:
            stamp_us = to_us(each.stamp)
            entity = lines_entity(each.source, each.ends_m, stamp_us)
            self.counts["lines"] += len(each.ends_m)
            yield stamp_us, partial(give_entities, self._channels.lines, [entity], (), stamp_us)

    def moves(self, found: Iterable[Moved]) -> Iterator[Given]:
        for each in found:
            stamp_us = to_us(each.stamp)
            frame = Frame(0, "", each.frame, each.parent, each.pose, is_static=False)
            yield stamp_us, partial(self._channels.give_moves, [placed(frame, stamp_us)], stamp_us)

    def states(self, changes: Iterable[_Change]) -> Iterator[Given]:
        """Doors, and the timeline: at each stamp at which something is otherwise."""
        doors = dict.fromkeys(self._building.doors, UNKNOWN)
        within: dict[str, set[str]] = defaultdict(set)
        for stamp_us, together in groupby(changes, attrgetter("stamp_us")):
            for each in together:
                each.make(doors, within)
            yield self._state_given(stamp_us, doors, within)

    def events(
        self, connection: Connection, map_name: str, start: datetime, end: datetime
    ) -> Iterator[Given]:
        for each in list_events_between(connection, map_name, start, end - MICROSECOND, limit=MOST):
            self.counts["events"] += 1
            document = cloud_event_json(each, event_json(each))
            yield to_us(each.stamp), partial(self._channels.give_event, each, document)

    def sensors(self, recording: Recording, frame: str, start_us: int, end_us: int) -> Iterator[Given]:
        """By the time at which the recorder wrote them down, which is in order."""
        for each in recording.records():
            match each.value:
                case Transform(is_static=True) as fixed if each.sent_us < end_us:
                    stamp_us = max(each.sent_us, start_us)
                    yield stamp_us, partial(self._give_move, fixed, frame, stamp_us)
                case _ if not start_us <= each.sent_us < end_us:
                    continue
                case Transform() as moved:
                    yield each.sent_us, partial(self._give_move, moved, frame, each.sent_us)
                case Scan() | Image() | CompressedImage() | Boxes() as seen:
                    yield each.sent_us, partial(self._give_sensed, seen, each.topic, each.sent_us)

    def _state_given(self, stamp_us: int, doors: Mapping[int, str], within: Mapping[str, set[str]]) -> Given:
        counts = Counter(room for rooms in within.values() for room in rooms)
        known = self._building.doors
        state = State(
            {room: counts[room] for room in sorted(self._building.rooms.values())},
            {known[door_id].name: value for door_id, value in doors.items() if door_id in known},
            {who: ", ".join(sorted(rooms)) for who, rooms in sorted(within.items())},
        )
        entities = [
            door_entity(door_id, known[door_id], value, stamp_us)
            for door_id, value in doors.items()
            if door_id in known
        ]

        def give() -> None:
            give_entities(self._channels.doors, entities, (), stamp_us)
            self._channels.give_state(state, stamp_us)

        return stamp_us, give

    def _give_move(self, moved: Transform, frame: str, sent_us: int) -> None:
        parent = ROOT_FRAME if moved.parent == frame else moved.parent
        self._channels.give_moves([frame_transform(replace(moved, parent=parent))], sent_us)

    def _give_sensed(self, seen: Scan | Image | CompressedImage | Boxes, topic: str, sent_us: int) -> None:
        made, what = shown(seen), WHAT[type(seen)]
        channel = self._sensors.get((what, topic))
        if channel is None:
            is_first = what not in {each for each, _ in self._sensors}
            channel = self._sensors[what, topic] = Channel(
                f"/{what}" if is_first else f"/{what}/{topic.strip('/')}",
                schema=made.get_schema(),
                message_encoding="protobuf",
                context=self._scene,
            )
        self.counts[what] += 1
        channel.log(made.encode(), log_time=log_time_ns(sent_us))


@dataclass(frozen=True)
class _Change:
    """A door stands otherwise, or somebody came into a room or left it, at a stamp; or it begins."""

    stamp_us: int
    door_id: int | None = None
    value: str = ""
    who: str = ""
    room: str = ""
    has_come: bool = False

    def make(self, doors: dict[int, str], within: dict[str, set[str]]) -> None:
        if self.door_id is not None:
            doors[self.door_id] = self.value
        elif self.has_come:
            within[self.who].add(self.room)
        elif self.who:
            within[self.who].discard(self.room)


def _changes(connection: Connection, map_name: str, start: datetime, end: datetime) -> list[_Change]:
    """In the order of stamps; who leaves a room does so before somebody comes."""
    start_us, end_us = to_us(start), to_us(end)
    last = end - MICROSECOND
    found = [_Change(start_us)]
    found += [
        _Change(max(to_us(each.since), start_us), each.instance_id, each.state)
        for each in door_states(connection, map_name, start, last, MOST)
    ]
    for each in stays(connection, map_name, start, last, MOST):
        found.append(
            _Change(max(to_us(each.since), start_us), who=each.track, room=each.instance, has_come=True)
        )
        if each.until is not None and to_us(each.until) < end_us:
            found.append(_Change(to_us(each.until), who=each.track, room=each.instance))
    return sorted(found, key=lambda each: (each.stamp_us, each.has_come))
