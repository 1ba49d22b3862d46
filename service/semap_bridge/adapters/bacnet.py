"""BACnet/IP: each room as two inputs, whether somebody is in it and how many, with change of value.

The protocol knows no passwords: whoever reaches the port reads, and nobody writes. While semap does not say
how things stand, the inputs say so (a fault, communication failure), so that nobody takes an old value for
the present one.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Mapping, Sequence
from typing import Any

from bacpypes3.app import Application
from bacpypes3.basetypes import BinaryPV, EngineeringUnits, Reliability, StatusFlags
from bacpypes3.errors import ExecutionError
from bacpypes3.local.analog import AnalogInputObject
from bacpypes3.local.binary import BinaryInputObject
from bacpypes3.local.device import DeviceObject
from bacpypes3.local.networkport import NetworkPortObject
from bacpypes3.pdu import IPv4Address
from pydantic import Field, field_validator

from semap.errors import ServiceUnreachable
from semap.model.plan import Kind
from semap.store.motion.live import LiveMap
from semap.store.motion.plan import things
from semap_bridge import adapter
from semap_bridge.adapter import Adapter, Display, Sight

log = logging.getLogger(__name__)

LAST_INSTANCE = 4_194_302
"""The largest number of an object: 22 bits, of which one value is kept for none."""
BEYOND = f"a room with a number above {LAST_INSTANCE}"
REMEDY = "Import the map into a database of its own."
LONGEST_TEXT = 200
ANEW_S = 1.0
"""So often, at most, the rooms of a map that is edited are read anew."""


class BacnetSettings(adapter.Settings):
    """Who it is on the network, and where."""

    device: int = Field(
        ge=0, le=LAST_INSTANCE, description="Number of the device: the only one on the network."
    )
    address: str = Field(description="Address with its network, such as 192.168.1.20/24, or with :port, too.")
    rate_hz: float = Field(default=2.0, gt=0, le=20, description="So often values are compared, at most.")
    stale_s: float = Field(
        default=10.0, gt=0, description="After so long without word from the database there is a fault."
    )

    @field_validator("address")
    @classmethod
    def _require_address(cls, address: str) -> str:
        try:
            IPv4Address(address)
        except (RuntimeError, TypeError, ValueError) as error:
            raise ValueError("no IPv4 address, such as 192.168.1.20/24 or 192.168.1.20/24:47808") from error
        return address


class _Device(Application):  # type: ignore[misc]  # of a library without types
    """A device that nobody writes to."""

    async def do_WritePropertyRequest(self, apdu: Any) -> None:  # noqa: N802  (its name in the protocol)
        raise ExecutionError(errorClass="property", errorCode="writeAccessDenied")

    async def do_WritePropertyMultipleRequest(self, apdu: Any) -> None:  # noqa: N802
        raise ExecutionError(errorClass="property", errorCode="writeAccessDenied")


class _Room:
    """Its two inputs."""

    def __init__(self, instance_id: int, name: str) -> None:
        self.name = name
        shared: dict[str, Any] = {
            "eventState": "normal",
            "outOfService": False,
            "statusFlags": StatusFlags([0, 1, 0, 0]),
            "reliability": Reliability.communicationFailure,
        }
        self.presence = BinaryInputObject(
            objectIdentifier=("binary-input", instance_id),
            objectName=f"{name} presence",
            description=f"Whether somebody is in {name}",
            presentValue=BinaryPV.inactive,
            polarity="normal",
            activeText="occupied",
            inactiveText="vacant",
            **shared,
        )
        self.count = AnalogInputObject(
            objectIdentifier=("analog-input", instance_id),
            objectName=f"{name} count",
            description=f"How many are in {name}",
            presentValue=0.0,
            units=EngineeringUnits.noUnits,
            covIncrement=1.0,
            **shared,
        )

    def tell(self, count: int) -> None:
        """What is otherwise is told to those who subscribed."""
        value = BinaryPV.active if count else BinaryPV.inactive
        if self.presence.presentValue != value:
            self.presence.presentValue = value
        if self.count.presentValue != count:
            self.count.presentValue = float(count)

    def trust(self, *, is_fresh: bool) -> None:
        """Say whether its values are of the present."""
        reliability = Reliability.noFaultDetected if is_fresh else Reliability.communicationFailure
        for each in (self.presence, self.count):
            if each.reliability != reliability:
                each.reliability = reliability
                each.statusFlags = StatusFlags([0, 0 if is_fresh else 1, 0, 0])


class Bacnet(Adapter[BacnetSettings], Display):
    Settings = BacnetSettings

    _device: _Device | None = None
    _watching: asyncio.Task[None] | None = None

    async def open(self) -> None:
        self.every_s = 1 / self.settings.rate_hz
        self._rooms: dict[int, _Room] = {}
        self._change_set: int | None = None
        self._read_at_s = -ANEW_S
        self._shown = asyncio.Event()
        address = IPv4Address(self.settings.address)
        _require_free(address)
        self._identity = DeviceObject(
            objectIdentifier=("device", self.settings.device),
            objectName=f"semap {self.context.map_name} {self.context.name}"[:LONGEST_TEXT],
            vendorName="semap",
            vendorIdentifier=999,
            modelName="semap bridge",
        )
        port = NetworkPortObject(address, objectIdentifier=("network-port", 1), objectName="BACnet/IP")
        self._device = _Device.from_object_list([self._identity, port])
        self._watching = asyncio.create_task(self._watch())
        log.info("%s: device %d on %s", self.context.name, self.settings.device, address)

    async def close(self) -> None:
        if self._watching is not None:
            self._watching.cancel()
            await asyncio.wait({self._watching})
        if self._device is not None:
            self._device.close()

    async def show(self, present: LiveMap) -> None:
        waited_s = asyncio.get_running_loop().time() - self._read_at_s
        if present.change_set != self._change_set and waited_s >= ANEW_S:
            self._read_at_s += waited_s
            self._have(await self._read_rooms())
            self._change_set = present.change_set
        counts = dict.fromkeys(self._rooms, 0)
        for track in present.tracks.values():
            for room in track.rooms:
                if room in counts:
                    counts[room] += 1
        for room, count in counts.items():
            self._rooms[room].tell(count)
            self._rooms[room].trust(is_fresh=True)
        self._shown.set()

    async def look(self, seconds: float) -> Sequence[Sight]:
        sights = [Sight(f"device {self.settings.device}", f"BACnet/IP on {self.settings.address}")]
        for number, name in (await self._read_rooms()).items():
            if _fits(number):
                sights.append(Sight(name, f"binary-input and analog-input {number}"))
            else:
                sights.append(Sight(name, f"room {number}", trouble=BEYOND, remedy=REMEDY))
        return sights

    async def _read_rooms(self) -> Mapping[int, str]:
        """Names of rooms, by the ids of instances, which are the numbers of their objects."""
        found = await self.context.ask(lambda c: things(c, self.context.map_name))
        return {each.instance_id: each.name for each in found if each.kind == Kind.ROOM}

    def _have(self, rooms: Mapping[int, str]) -> None:
        """Have the objects of these rooms, and no others."""
        if self._device is None:
            return
        gone = [number for number, room in self._rooms.items() if rooms.get(number) != room.name]
        for number in gone:
            room = self._rooms.pop(number)
            self._device.delete_object(room.presence)
            self._device.delete_object(room.count)
        for number, name in rooms.items():
            if not _fits(number):
                self.context.refuse(BEYOND, f"{name}: {number}")
            elif number not in self._rooms:
                made = self._rooms[number] = _Room(number, name)
                self._device.add_object(made.presence)
                self._device.add_object(made.count)
        self._identity.databaseRevision = int(self._identity.databaseRevision) + 1

    async def _watch(self) -> None:
        """Say that values are old where nothing is shown for a while."""
        while True:
            self._shown.clear()
            try:
                async with asyncio.timeout(self.settings.stale_s):
                    await self._shown.wait()
            except TimeoutError:
                for room in self._rooms.values():
                    room.trust(is_fresh=False)


def _fits(number: int) -> bool:
    return number <= LAST_INSTANCE


def _require_free(address: IPv4Address) -> None:
    """raises ServiceUnreachable where nothing can listen: the library would try in silence"""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tried:
        try:
            tried.bind(address.addrTuple)
        except OSError as error:
            raise ServiceUnreachable(
                f"{address} cannot be listened to: {error.strerror}.",
                "Give an address of this machine; another program may have its port: 47808 is usual.",
            ) from error
