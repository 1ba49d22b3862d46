"""A hub of omlox: its WebSocket, spoken by a server of the test's own, and locations that come through it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Queue
from threading import Thread

import pytest
from bridging import config, report, running, stored
from patience import until
from semap_bridge.checking import check_bridge
from semap_bridge.config import Entry, read_config
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import Server, ServerConnection, serve
from world import SECOND_US, World

from semap.timeline.stamp import rfc3339, to_datetime

FIRST_US = 1_700_000_000 * SECOND_US


class Hub:
    """What subscribers asked for, and what they are sent; `token` is the one that is right."""

    def __init__(self, token: str | None) -> None:
        self.token, self.asked, self.to_send = token, Queue(), Queue()
        self.connections: list[ServerConnection] = []

    def serve(self, connection: ServerConnection) -> None:
        asked = json.loads(connection.recv())
        self.asked.put(asked)
        self.connections.append(connection)
        if asked["params"].get("token") != self.token:
            connection.send(json.dumps({"event": "error", "code": 10004, "description": "not authorized"}))
            return
        connection.send(json.dumps({"event": "subscribed", "topic": asked["topic"], "subscription_id": 1}))
        try:
            while (said := self.to_send.get()) is not None:
                connection.send(said)
        except ConnectionClosed:
            return

    def locate(self, *locations: object) -> None:
        self.to_send.put(json.dumps({"event": "message", "topic": "location_updates", "payload": locations}))


@contextmanager
def hub(token: str | None = None, port: int = 0) -> Iterator[tuple[Hub, int]]:
    made = Hub(token)
    server: Server = serve(made.serve, "127.0.0.1", port)
    thread = Thread(target=server.serve_forever)
    thread.start()
    try:
        yield made, server.socket.getsockname()[1]
    finally:
        made.to_send.put(None)
        for each in made.connections:
            each.close()
        server.shutdown()
        thread.join()


def entry(folder: Path, port: int, **settings: object) -> Entry:
    given = {"url": f"ws://127.0.0.1:{port}/v2/ws/socket", **settings}
    written = "".join(f"    {name}: {json.dumps(value)}\n" for name, value in given.items())
    return read_config(config(folder, f"  - name: lines\n    kind: omlox\n{written}")).bridges[0]


def location(provider: str, x: float, y: float, stamp_us: int, **more: object) -> dict[str, object]:
    at = rfc3339(to_datetime(stamp_us))
    return {"position": {"type": "Point", "coordinates": [x, y]}, "source": "zone", "provider_type": "uwb",
            "provider_id": provider, "timestamp_generated": at, **more}  # fmt: skip


def test_locations_come_in_and_a_hub_that_goes_is_waited_for(world: World, tmp_path: Path) -> None:
    with hub() as (first, port):
        one = entry(
            tmp_path, port, params={"provider_type": "uwb"}, names={"t1": "anna"}, origin={"yaw_deg": 180}
        )
        with running(world, one):
            first.locate(
                location("t1", 1, 2, FIRST_US),
                {"position": "?"},
                location("t2", 3, 4, FIRST_US, crs="EPSG:1"),
            )
            until(lambda: len(stored(world)) == 1)
            assert first.asked.get()["params"] == {"provider_type": "uwb"}
            first.to_send.put("{")
            first.to_send.put(None)
            first.connections[0].close()
            until(lambda: "is away" in report(world)["trouble"] or first.asked.qsize())
            first.locate(location("x", 5, 6, FIRST_US, trackables=["some-uuid"]))
            until(lambda: len(stored(world)) == 2)
    assert stored(world)[0] == ("anna", FIRST_US, pytest.approx(-1), pytest.approx(-2))
    assert stored(world)[1][0] == "some-uuid"
    assert {"position is no object": 1, "unknown crs": 1}.items() <= report(world)["refusals"].items()
    assert report(world)["reconnects"] >= 1


def test_a_token_from_a_file_is_never_told(
    world: World, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("DEBUG")
    secret = tmp_path / "token"
    secret.write_text("hunter-zwei")
    with hub("hunter-drei") as (made, port):
        one = entry(tmp_path, port, token_file="token")
        assert "10004 not authorized" in " ".join(each.trouble for each in check_bridge(world.dsn, one, 5.0))
        with running(world, one):
            until(lambda: "not authorized" in str(world.rows("select trouble from semap.bridge")))
            secret.write_text("hunter-drei")
            made.locate(location("t1", 1, 2, FIRST_US))
            until(lambda: len(stored(world)) == 1)
    ours = [each for each in caplog.records if not each.name.startswith("websockets.server")]
    assert "hunter" not in " ".join(each.getMessage() for each in ours) + json.dumps(
        report(world), default=str
    )
