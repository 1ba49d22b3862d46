"""A controller of a building sees each room over BACnet/IP: read, and told of changes, over the loopback."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import pytest
from bacpypes3.apdu import ErrorRejectAbortNack
from bacpypes3.app import Application
from bacpypes3.local.device import DeviceObject
from bacpypes3.local.networkport import NetworkPortObject
from bacpypes3.pdu import Address, IPv4Address
from bacpypes3.primitivedata import ObjectIdentifier
from bridging import config, report, running
from furnished import furnish
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from patience import PATIENCE_S, moment, until
from semap_bridge.adapters.bacnet import Bacnet, BacnetSettings
from semap_bridge.checking import check_bridge
from semap_bridge.config import Entry, read_config
from semap_bridge.context import Context
from semap_bridge.running import close_context, open_context
from sqlalchemy import create_engine
from world import SECOND_US, World

from semap.errors import InvalidInput
from semap.store.motion.live import live_map

FIRST_US = 1_700_000_000 * SECOND_US
DEVICE = 4711
READ_NAME = bytes.fromhex("810a0011 0104 0005010c 0c02001267 194d")
"""BVLC to one, NPDU that wants an answer, ReadProperty: of the device 4711 its object-name."""
WRITE = bytes.fromhex("810a0017 0104 0005020f 0c02001267 194d 3e7500613f")
SUBSCRIBE = bytes.fromhex("810a0015 0104 00050305 0900 1c00000001 2901 3905")
WHO_IS = bytes.fromhex("810b0008 0100 1008")


def broken(packet: bytes) -> st.SearchStrategy[bytes]:
    """A packet of which some bytes are others, or that is cut or goes on."""
    spot = st.tuples(st.integers(4, len(packet) - 1), st.integers(0, 255))

    def made(spots: list[tuple[int, int]], cut: int, more: bytes) -> bytes:
        changed = bytearray(packet)
        for place, byte in spots:
            changed[place] = byte
        changed = changed[:cut] + more
        changed[2:4] = len(changed).to_bytes(2, "big")
        return bytes(changed)

    return st.builds(made, st.lists(spot, max_size=4), st.integers(5, len(packet)), st.binary(max_size=8))


HOSTILE = st.binary(max_size=60) | st.sampled_from([READ_NAME, WRITE, SUBSCRIBE, WHO_IS]).flatmap(broken)


udp = partial(socket.socket, socket.AF_INET, socket.SOCK_DGRAM)


def free_udp() -> int:
    with udp() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def serving(folder: Path, port: int, **more: object) -> Entry:
    said = {"device": DEVICE, "address": f"127.0.0.1:{port}", "rate_hz": 20, **more}
    written = "".join(f"    {name}: {json.dumps(value)}\n" for name, value in said.items())
    return read_config(config(folder, f"  - name: bms\n    kind: bacnet\n{written}")).bridges[0]


@contextmanager
def controller() -> Iterator[Application]:
    """In the running loop."""
    made = Application.from_object_list([
        DeviceObject(objectIdentifier=("device", 1), objectName="controller", vendorIdentifier=999),
        NetworkPortObject(
            IPv4Address(f"127.0.0.1:{free_udp()}"), objectIdentifier=("network-port", 1), objectName="port"
        ),
    ])  # fmt: skip
    try:
        yield made
    finally:
        made.close()


def with_controller(ask: Callable[[Application], Awaitable[None]]) -> None:
    async def run() -> None:
        with controller() as made:
            async with asyncio.timeout(PATIENCE_S):
                await ask(made)

    asyncio.run(run())


async def value(asking: Application, port: int, of: str, number: int, name: str = "present-value") -> object:
    """Of a property, as soon as there is one."""
    while True:
        try:
            return await asking.read_property(
                Address(f"127.0.0.1:{port}"), ObjectIdentifier((of, number)), name
            )
        except ErrorRejectAbortNack:
            await asyncio.to_thread(moment)


def test_a_controller_reads_rooms_and_is_told_who_comes_and_goes(world: World, tmp_path: Path) -> None:
    furnish(world)
    kitchen, hall = (
        world.one("select instance_id from semap.instance where name = %s", each)
        for each in ("kitchen", "hall")
    )
    cat, dog = world.add_track("cat"), world.add_track("dog")
    port = free_udp()

    async def ask(asking: Application) -> None:
        names = {
            number: str(await value(asking, port, "binary-input", number, "object-name"))
            for number in (kitchen, hall)
        }
        assert names == {kitchen: "kitchen presence", hall: "hall presence"}
        there = Address(f"127.0.0.1:{port}")
        while "fault" in str(await value(asking, port, "analog-input", kitchen, "status-flags")):
            await asyncio.to_thread(moment)
        told: list[float] = []
        async with asking.change_of_value(
            there, ObjectIdentifier(("analog-input", kitchen)), 1, True, 60
        ) as changes:

            async def await_count(count: float) -> None:
                while not told or told[-1] != count:
                    name, said = await changes.get_value()
                    if str(name) == "present-value":
                        told.append(said)

            await await_count(0)
            await asyncio.to_thread(world.add_states, [(cat, FIRST_US, 1.0, 1.0, 1.0)])
            await await_count(1)
            await asyncio.to_thread(world.add_states, [(dog, FIRST_US, 2.0, 1.0, 1.0)])
            await await_count(2)
            assert str(await value(asking, port, "binary-input", kitchen)) == "active"
            assert str(await value(asking, port, "binary-input", hall)) == "inactive"
            await asyncio.to_thread(world.add_states, [(dog, FIRST_US + SECOND_US, 7.0, 1.0, 1.0)])
            await await_count(1)
        assert told == [0, 1, 2, 1]
        with pytest.raises(ErrorRejectAbortNack, match="write-access-denied"):
            await asking.write_property(
                there, ObjectIdentifier(("analog-input", kitchen)), "present-value", 9.0
            )
        assert await value(asking, port, "analog-input", kitchen) == 1
        world.run("delete from semap.instance where name = 'hall'")
        while ObjectIdentifier(("binary-input", hall)) in await value(
            asking, port, "device", DEVICE, "object-list"
        ):
            await asyncio.to_thread(moment)

    with running(world, serving(tmp_path, port)):
        with_controller(ask)


def test_values_that_are_old_are_a_fault(world: World, tmp_path: Path) -> None:
    """As where the database is away: nothing is shown any more."""
    furnish(world)
    kitchen = world.one("select instance_id from semap.instance where name = 'kitchen'")
    port = free_udp()
    entry = serving(tmp_path, port, stale_s=0.2)

    async def ask(asking: Application) -> None:
        context = open_context(world.dsn, entry)
        bridge = entry.adapter(context)
        await bridge.open()
        present = await context.ask(lambda c: live_map(c, world.map_id))

        async def flags() -> str:
            return str(await value(asking, port, "binary-input", kitchen, "status-flags"))

        await bridge.show(present)
        while "fault" in await flags():
            await bridge.show(present)
        while "fault" not in await flags():
            await asyncio.to_thread(moment)
        await bridge.show(present)
        await bridge.close()
        close_context(context)

    with_controller(ask)


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(said=st.lists(HOSTILE, min_size=1, max_size=10))
def test_whatever_comes_the_device_answers_who_asks_rightly(device: int, said: list[bytes]) -> None:
    """Asked in bytes that were written by hand after the standard (Annex F, Annex J)."""
    with udp() as hostile, udp() as asking:
        for each in said:
            hostile.sendto(each, ("127.0.0.1", device))

        def is_answered() -> bool:
            asking.sendto(READ_NAME, ("127.0.0.1", device))
            with suppress(TimeoutError):
                return b"semap map bms" in asking.recv(2000)
            return False

        asking.settimeout(0.5)
        until(is_answered)


@pytest.fixture(scope="module")
def device() -> Iterator[int]:
    """The port of a device without rooms, in a loop of its own."""
    port, loop = free_udp(), asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    context = Context("map", "bms", "bms", create_engine("sqlite://"), ThreadPoolExecutor(1))
    bridge = Bacnet(
        BacnetSettings(name="bms", kind="bacnet", device=DEVICE, address=f"127.0.0.1:{port}"), context
    )
    asyncio.run_coroutine_threadsafe(bridge.open(), loop).result()
    yield port
    asyncio.run_coroutine_threadsafe(bridge.close(), loop).result()
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def test_a_port_that_is_taken_is_waited_for(world: World, tmp_path: Path) -> None:
    furnish(world)
    with udp() as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with running(world, serving(tmp_path, port)):
            until(lambda: "cannot be listened to" in str(report(world, "bms").get("trouble")))
            other.close()
            until(lambda: report(world, "bms")["state"] == "connected")


def test_a_check_names_the_objects_of_each_room(world: World, tmp_path: Path) -> None:
    furnish(world)
    sights = check_bridge(world.dsn, serving(tmp_path, free_udp()), 0.1)
    number = world.one("select instance_id from semap.instance where name = 'kitchen'")
    assert ("kitchen", f"binary-input and analog-input {number}") in {
        (each.what, each.is_a) for each in sights
    }
    assert not any(each.trouble for each in sights)


@pytest.mark.parametrize("address", ["here", "1.2.3", "127.0.0.1:port", ""])
def test_an_address_that_is_none_is_refused_at_its_line(tmp_path: Path, address: str) -> None:
    with pytest.raises(InvalidInput, match=r":6.*address"):
        read_config(
            config(tmp_path, f"  - name: a\n    kind: bacnet\n    device: 1\n    address: '{address}'\n")
        )
