"""A server for the Foxglove app: the map as it is now, what happens, and what sensors say by way of others.

The app's protocol knows no tokens: whoever reaches the port sees the map, so it listens on this machine only
unless told otherwise.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence

import foxglove
from foxglove.websocket import Capability, WebSocketServer
from pydantic import BaseModel, ConfigDict, Field

from semap.errors import InvalidInput, ServiceUnreachable
from semap.store.motion.live import LiveMap, ShownTrack
from semap.timeline.stamp import to_us
from semap_bridge import adapter
from semap_bridge.adapter import Adapter, Display, Happening, Sight, Sink
from semap_bridge.adapters.foxglove.building import Building, door_entity, door_id_of, read_building
from semap_bridge.adapters.foxglove.channels import (
    BUILDING,
    DOORS,
    PEOPLE,
    STATE,
    TF_STATIC,
    Channels,
    State,
    give_entities,
)
from semap_bridge.adapters.foxglove.layout import LAYOUT
from semap_bridge.adapters.foxglove.listening import Listening
from semap_bridge.adapters.foxglove.people import person_entity, state_of, track_id_of
from semap_bridge.adapters.foxglove.robot import RobotTopics, Ros1Topics, Ros2Topics
from semap_bridge.config import ConfigPath

log = logging.getLogger(__name__)

ENCODINGS = ["protobuf", "json", "cdr", "ros1", "flatbuffer"]
"""What programs may publish in: as the app reads it."""
NEW_BUILDING_S = 1.0
"""So often, at most, a map that is edited is read anew."""


class ServerTls(BaseModel):
    """By what the server shows who it is."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    certificate_file: ConfigPath = Field(description="Certificate of this server, PEM.")
    key_file: ConfigPath = Field(description="Its key, PEM in PKCS#8.")


class FoxgloveSettings(adapter.Settings):
    """Where the app finds it, and what it may do."""

    host: str = Field(default="127.0.0.1", description="Address that it listens to.")
    port: int = Field(default=8765, ge=0, le=65535, description="Port that it listens to; 0: a free one.")
    rate_hz: float = Field(default=15.0, gt=0, le=100, description="So often who moved is shown, at most.")
    relay: bool = Field(
        default=False,
        description="Let programs that connect publish topics for all to see, such as scans and images.",
    )
    ros2: Ros2Topics | None = Field(
        default=None, description="Show topics of a robot of ROS 2: domain, interface, peers, topics."
    )
    ros1: Ros1Topics | None = Field(
        default=None, description="Show topics of a robot of ROS 1: master, own_address, python, topics."
    )
    tls: ServerTls | None = Field(default=None, description="certificate_file and key_file for wss://.")


class Foxglove(Adapter[FoxgloveSettings], Sink, Display):
    Settings = FoxgloveSettings

    _server: WebSocketServer | None = None
    _building: Building | None = None

    async def open(self) -> None:
        self.every_s = 1 / self.settings.rate_hz
        self._robots: list[RobotTopics] = []
        self._read_at_s = -NEW_BUILDING_S
        self._tracks: dict[int, ShownTrack] = {}
        self._doors: dict[int, str] = {}
        self._state: State | None = None
        self._scene = foxglove.Context()
        self._channels = Channels(self._scene)
        self._listening = Listening(self._scene, self.context, relay=self.settings.relay)
        self._server = await self.context.in_thread(self._start)
        await self.context.in_thread(self._hear_robots)
        log.info(
            "%s: serves ws://%s:%d to Foxglove; its layout is %s",
            self.context.name,
            self.settings.host,
            self._server.port,
            LAYOUT,
        )

    async def close(self) -> None:
        for each in self._robots:
            await self.context.in_thread(each.stop)
        if self._server is not None:
            await self.context.in_thread(self._server.stop)

    async def deliver(self, happenings: Sequence[Happening]) -> None:
        for each in happenings:
            self._channels.give_event(each.event, each.cloud_event_json())

    async def show(self, present: LiveMap) -> None:
        asked = self._listening.newly_wanted()
        for robot in self._robots:
            robot.wanted(asked)
            if robot.raised is not None:
                raise robot.raised
        stamp_us = _stamp_us(present)
        await self._show_building(present, stamp_us, whole=bool(asked & {TF_STATIC, BUILDING}))
        if self._building is not None:
            self._show_doors(present, self._building, stamp_us, whole=DOORS in asked)
            self._show_people(present, stamp_us, whole=PEOPLE in asked)
            state = state_of(present, self._building.rooms)
            if state != self._state or STATE in asked:
                self._state = state
                self._channels.give_state(state, stamp_us)

    async def look(self, seconds: float) -> Sequence[Sight]:
        port = 0 if self._server is None else self._server.port
        building = await self.context.ask(lambda c: read_building(c, self.context.map_name, 0))
        return [
            Sight(f"ws://{self.settings.host}:{port}", "server for Foxglove"),
            Sight("rooms", f"{len(building.rooms)}"),
            Sight("doors", f"{len(building.doors)}"),
            Sight("furniture and other things", f"{len(building.entities) - len(building.rooms)}"),
        ]

    def _hear_robots(self) -> None:
        for robot in (self.settings.ros2, self.settings.ros1):
            if robot is not None:
                try:
                    graph = robot.graph(self.context.name)
                except ImportError as error:
                    raise InvalidInput(
                        f"topics of ROS need the package {error.name}, which is not installed",
                        "pip install 'semap[ros2]'",
                    ) from error
                self._robots.append(RobotTopics(self._scene, self.context, graph, robot.topics))
                self._robots[-1].start()

    def _start(self) -> WebSocketServer:
        settings = self.settings
        tls = settings.tls
        try:
            return foxglove.start_server(
                name=f"semap: {self.context.map_name}",
                host=settings.host,
                port=settings.port,
                context=self._scene,
                server_listener=self._listening,
                capabilities=[Capability.ClientPublish] if settings.relay else [],
                supported_encodings=ENCODINGS if settings.relay else None,
                tls_cert=None if tls is None else tls.certificate_file.read_bytes(),
                tls_key=None if tls is None else tls.key_file.read_bytes(),
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise ServiceUnreachable(
                f"{settings.host}:{settings.port} cannot be served: {error}.",
                "Choose a free port of this machine, and files in PEM that this user can read.",
            ) from error

    async def _show_building(self, present: LiveMap, stamp_us: int, *, whole: bool) -> None:
        """What stands on the map, where it is new, and read anew where the map was edited."""
        before = self._building
        waited_s = asyncio.get_running_loop().time() - self._read_at_s
        if waited_s >= NEW_BUILDING_S and (before is None or before.change_set != present.change_set):
            self._read_at_s += waited_s
            self._building = await self.context.ask(
                lambda c: read_building(c, self.context.map_name, present.change_set)
            )
        building = self._building
        if building is None or (building is before and not whole):
            return
        known = {} if before is None or whole else before.encoded
        changed = [building.entities[key] for key, said in building.encoded.items() if known.get(key) != said]
        gone = () if before is None else [key for key in before.entities if key not in building.entities]
        if changed or gone:
            give_entities(self._channels.building, changed, list(gone), stamp_us)
        if before is None or whole or before.frames != building.frames:
            self._channels.give_frames(building.frames, stamp_us)
        if before is None or before.doors != building.doors:
            self._doors = {}
            lost = () if before is None else before.doors.keys() - building.doors.keys()
            give_entities(self._channels.doors, (), [door_id_of(each) for each in lost], stamp_us)

    def _show_doors(self, present: LiveMap, building: Building, stamp_us: int, *, whole: bool) -> None:
        doors = {door_id: each.state for door_id, each in present.doors.items() if door_id in building.doors}
        if doors != self._doors or whole:
            self._doors = doors
            shown = [door_entity(key, building.doors[key], state, stamp_us) for key, state in doors.items()]
            give_entities(self._channels.doors, shown, (), stamp_us)

    def _show_people(self, present: LiveMap, stamp_us: int, *, whole: bool) -> None:
        known = {} if whole else self._tracks
        gone = [track_id_of(each) for each in self._tracks if each not in present.tracks]
        changed = [each for track_id, each in present.tracks.items() if known.get(track_id) != each]
        self._tracks = dict(present.tracks)
        if (changed or gone) and self._channels.people.has_sinks():
            give_entities(self._channels.people, [person_entity(each) for each in changed], gone, stamp_us)


def _stamp_us(present: LiveMap) -> int:
    """The newest of what is known of a map."""
    stamps = [each.stamp for each in present.tracks.values()]
    stamps += [each.since for each in present.doors.values() if each.since is not None]
    return max((to_us(each) for each in stamps), default=0)
