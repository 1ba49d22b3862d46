"""What semap tells a robot: the map and how its doors stand, people, events, and the room that it is in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
import shapely

from semap.store.motion.live import LiveMap, ShownTrack
from semap.timeline.stamp import to_us
from semap_bridge.adapter import Display, Happening, Sink
from semap_bridge.adapters.ros.map_picture import (
    MapPicture,
    colour_message,
    grid_message,
    map_markers,
    read_picture,
    text_marker,
)
from semap_bridge.adapters.ros.settings import RosSettings
from semap_bridge.context import Context
from semap_bridge.ros.graph import Graph, Publisher
from semap_bridge.ros.message import Messages, messages

TOPICS: dict[str, tuple[tuple[str, str, bool], ...]] = {
    "map": (("map", "nav_msgs/msg/OccupancyGrid", True),),
    "markers": (
        ("markers", "visualization_msgs/msg/MarkerArray", True),
        ("people_markers", "visualization_msgs/msg/MarkerArray", False),
    ),
    "people": (("people", "people_msgs/msg/People", False),),
    "detections": (("detections", "vision_msgs/msg/Detection3DArray", False),),
    "events": (("events", "std_msgs/msg/String", False), ("event", "semap_msgs/msg/Event", False)),
    "room": (("room", "std_msgs/msg/String", True),),
}
"""By what a config calls it: name under the namespace, type, and whether it is latched."""
CYLINDER, DELETE_ALL = 3, 3
PERSON_M, HEIGHT_M = 0.5, 1.7
PERSON_COLOUR = (0.95, 0.6, 0.1, 0.9)


class Telling(Sink, Display):
    """Mutable: what was told last."""

    def __init__(self, settings: RosSettings, context: Context, graph: Graph) -> None:
        self._settings, self._context = settings, context
        self._messages = messages(is_ros1=graph.is_ros1)
        self._robot = settings.robot_name or context.name
        self.every_s = 1.0 / settings.people_hz
        self._publishers: dict[str, Publisher] = {
            name: graph.publish(f"/{settings.namespace}/{name}", type_name, is_latched=is_latched)
            for told in settings.tell
            for name, type_name, is_latched in TOPICS[told]
        }
        self._picture: MapPicture | None = None
        self._change_set: int | None = None
        self._doors: dict[int, str] | None = None
        self._room: str | None = None

    async def deliver(self, happenings: Sequence[Happening]) -> None:
        await self._context.in_thread(lambda: self._tell_events(happenings))

    async def show(self, present: LiveMap) -> None:
        if self._picture is None or present.change_set != self._change_set:
            picture = await self._context.ask(lambda c: read_picture(c, self._context.map_name))
            is_new, self._picture, self._change_set = True, picture, present.change_set
        else:
            is_new, picture = False, self._picture
        await self._context.in_thread(lambda: self._tell_present(present, picture, is_new))

    def _tell_events(self, happenings: Sequence[Happening]) -> None:
        for each in happenings:
            told = each.cloud_event_json().decode()
            self._send("events", lambda m, told=told: m.new("std_msgs/msg/String", data=told))
            self._send("event", lambda m, each=each, told=told: self._event(m, each, told))

    def _event(self, m: Messages, happening: Happening, told: str) -> Any:
        event = happening.event
        place = None if event.place is None else shapely.from_wkb(event.place).centroid
        return m.new(
            "semap_msgs/msg/Event",
            header=m.header(to_us(event.stamp), self._settings.frame),
            id=str(event.event_id),
            sequence=happening.number,
            map=event.map,
            type=event.type,
            rule=event.rule,
            track=event.track_name or "",
            instance=event.instance_name or "",
            has_place=place is not None,
            place=m.point(0, 0) if place is None else m.point(place.x, place.y),
            json=told,
        )

    def _tell_present(self, present: LiveMap, picture: MapPicture, is_new: bool) -> None:
        tracks = list(present.tracks.values())
        stamp_us = max((to_us(each.stamp) for each in tracks), default=to_us(datetime.now(UTC)))
        frame = self._settings.frame
        if is_new:
            grid = grid_message(self._messages, picture, stamp_us, frame)
            if grid is not None:
                self._send("map", lambda m: grid)
        doors = {each.instance_id: each.state for each in present.doors.values()}
        if is_new or doors != self._doors:
            self._doors = doors
            self._send("markers", lambda m: map_markers(m, picture, present.doors, stamp_us, frame))
        people = [each for each in tracks if each.name != self._robot]
        self._send("people", lambda m: self._people(m, people, stamp_us))
        self._send("detections", lambda m: self._detections(m, people, stamp_us))
        self._send("people_markers", lambda m: self._people_markers(m, people, stamp_us))
        robot = next((each for each in tracks if each.name == self._robot), None)
        room = "" if robot is None else self._rooms(robot)
        if room != self._room:
            self._room = room
            self._send("room", lambda m: m.new("std_msgs/msg/String", data=room))

    def _send(self, name: str, make: Any) -> None:
        publisher = self._publishers.get(name)
        if publisher is not None:
            publisher.send(self._messages.write(make(self._messages)))

    def _rooms(self, track: ShownTrack) -> str:
        picture = self._picture
        names = () if picture is None else (picture.names[i] for i in track.rooms if i in picture.rooms)
        return ", ".join(names)

    def _people(self, m: Messages, people: Sequence[ShownTrack], stamp_us: int) -> Any:
        told = []
        for each in people:
            speed_mps, heading_rad = each.speed_mps or 0.0, each.heading_rad or 0.0
            told.append(
                m.new(
                    "people_msgs/msg/Person",
                    name=each.name,
                    position=m.point(each.x_m, each.y_m, each.z_m or 0.0),
                    velocity=m.point(speed_mps * math.cos(heading_rad), speed_mps * math.sin(heading_rad)),
                    reliability=1.0,
                    tagnames=["track_id", "room"],
                    tags=[str(each.track_id), self._rooms(each)],
                )
            )
        return m.new("people_msgs/msg/People", header=m.header(stamp_us, self._settings.frame), people=told)

    def _detections(self, m: Messages, people: Sequence[ShownTrack], stamp_us: int) -> Any:
        header = m.header(stamp_us, self._settings.frame)
        return m.new(
            "vision_msgs/msg/Detection3DArray",
            header=header,
            detections=[self._detection(m, each, header) for each in people],
        )

    def _detection(self, m: Messages, track: ShownTrack, header: Any) -> Any:
        pose = m.pose(track.x_m, track.y_m, track.z_m or 0.0, track.heading_rad or 0.0)
        place = m.new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=_covariance(track))
        if m.is_ros1:
            result = m.new(
                "vision_msgs/msg/ObjectHypothesisWithPose", id=track.track_id, score=1.0, pose=place
            )
            named = {}
        else:
            kind = m.new("vision_msgs/msg/ObjectHypothesis", class_id="person", score=1.0)
            result = m.new("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=kind, pose=place)
            named = {"id": track.name}
        size = m.new(
            "geometry_msgs/msg/Vector3",
            x=track.length_m or PERSON_M,
            y=track.width_m or PERSON_M,
            z=HEIGHT_M,
        )
        box = m.new("vision_msgs/msg/BoundingBox3D", center=pose, size=size)
        return m.new("vision_msgs/msg/Detection3D", header=header, results=[result], bbox=box, **named)

    def _people_markers(self, m: Messages, people: Sequence[ShownTrack], stamp_us: int) -> Any:
        header = m.header(stamp_us, self._settings.frame)
        markers = [m.new("visualization_msgs/msg/Marker", header=header, action=DELETE_ALL)]
        for each in people:
            markers.append(
                m.new(
                    "visualization_msgs/msg/Marker",
                    header=header,
                    ns="people",
                    id=each.track_id % 2**31,
                    type=CYLINDER,
                    pose=m.pose(each.x_m, each.y_m, HEIGHT_M / 2, each.heading_rad or 0.0),
                    scale=m.new(
                        "geometry_msgs/msg/Vector3",
                        x=each.length_m or PERSON_M,
                        y=each.width_m or PERSON_M,
                        z=HEIGHT_M,
                    ),
                    color=colour_message(m, PERSON_COLOUR),
                )
            )
            at = shapely.Point(each.x_m, each.y_m)
            markers.append(text_marker(m, header, "people/names", each.track_id, each.name, at))
        return m.new("visualization_msgs/msg/MarkerArray", markers=markers)


def _covariance(track: ShownTrack) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(36,) of a pose, of which x and y are known."""
    covariance = np.zeros((6, 6))
    along_m = track.std_m or 0.0
    across_m = along_m if track.std_across_m is None else track.std_across_m
    yaw_rad = track.std_yaw_rad or 0.0
    turn = np.array([[math.cos(yaw_rad), -math.sin(yaw_rad)], [math.sin(yaw_rad), math.cos(yaw_rad)]])
    covariance[:2, :2] = turn @ np.diag([along_m**2, across_m**2]) @ turn.T
    return covariance.ravel()
