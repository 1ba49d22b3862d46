"""A hub of omlox: locations by its WebSocket, as they are made."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit

from pydantic import Field
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from semap.errors import ServiceUnreachable
from semap.store.motion.bridges import Position
from semap_bridge import adapter
from semap_bridge.adapter import Adapter, Batch, Sight, Source
from semap_bridge.completeness import Completeness
from semap_bridge.config import ConfigPath
from semap_bridge.context import Context
from semap_bridge.messages.omlox import Omlox
from semap_bridge.messages.template import Origin
from semap_bridge.messages.told import Told, Unusable, read_json, read_object
from semap_bridge.placing import Placement, batch_of, placement_of
from semap_bridge.secret import Tls, read_secret

TOPIC = "location_updates"
LARGEST = 1 << 22
QUIET = logging.getLogger("semap_bridge.omlox.socket")
QUIET.setLevel(logging.INFO)  # at DEBUG the library tells all that is sent, and so the token
REMEDY = "See that the hub runs there, and url and tls; semap goes on by itself."


class OmloxSettings(adapter.Settings):
    """A hub, and where its coordinates lie on the map."""

    url: str = Field(
        pattern=r"^wss?://[^/@]+/.*$",
        description="Of the WebSocket, such as ws://127.0.0.1:8081/v2/ws/socket.",
    )
    token_file: ConfigPath | None = Field(
        default=None, description="File with the token, where it wants one."
    )
    tls: Tls | None = Field(default=None, description="Whom to trust, of a wss URL. [default: the system's]")
    params: dict[str, str] = Field(
        default_factory=dict, description="What to subscribe to, such as provider_type: uwb."
    )
    names: dict[str, str] = Field(default_factory=dict, description="Names on the map, by ids; others stay.")
    std_m: float | None = Field(
        default=None, ge=0, description="Standard deviation of positions that come without one [m]."
    )
    settle_s: float = Field(
        default=0.003, ge=0, description="So long others of the newest stamp are waited for [s]."
    )
    frame: str = Field(default="map", description="Frame of the map that local positions are in.")
    origin: Origin = Field(
        default=Origin(), description="Where its origin is in `frame`: x_m, y_m, z_m, yaw_deg."
    )

    def reading(self) -> Omlox:
        """How its locations are read."""
        return Omlox(
            format="omlox",
            topic=TOPIC,
            names=self.names,
            std_m=self.std_m,
            frame=self.frame,
            origin=self.origin,
        )


class OmloxHub(Adapter[OmloxSettings], Source):
    """Mutable: a connection."""

    Settings = OmloxSettings

    def __init__(self, settings: OmloxSettings, context: Context) -> None:
        super().__init__(settings, context)
        self._reading = settings.reading()
        self._placement: Placement | None = None
        self._socket: ClientConnection | None = None

    async def open(self) -> None:
        settings = self.settings
        self._placement = await placement_of(self.context, self._reading)
        tls: dict[str, Any] = (
            {"ssl": (settings.tls or Tls()).context()} if settings.url.startswith("wss") else {}
        )
        params = dict(settings.params)
        if settings.token_file is not None:
            params["token"] = read_secret(settings.token_file)
        asks = {"event": "subscribe", "topic": TOPIC, "params": params}
        try:
            self._socket = await connect(
                settings.url, max_size=LARGEST, compression=None, logger=QUIET, **tls
            )
            await self._socket.send(json.dumps(asks))
        except (WebSocketException, OSError, TimeoutError) as error:
            raise self._lost(error) from error

    async def close(self) -> None:
        if self._socket is not None:
            with suppress(WebSocketException, OSError):
                await self._socket.close()

    async def batches(self, position: Position | None) -> AsyncIterator[Batch]:
        assert self._socket is not None and self._placement is not None  # noqa: S101, PT018  (open came before)
        source: Completeness[tuple[Told, Placement]] = Completeness(None, self.settings.settle_s)
        try:
            while True:
                with suppress(TimeoutError):
                    async with asyncio.timeout(source.due_in_s()):
                        data = await self._socket.recv(decode=False)
                        source.gather(
                            [(told, self._placement) for told in self._read(data, source.arrival_us())]
                        )
                if (ready := source.ready()) is not None:
                    yield source.take(await batch_of(self.context, ready))
        except (WebSocketException, OSError) as error:
            raise self._lost(error) from error

    async def look(self, seconds: float) -> Sequence[Sight]:
        return [Sight(urlsplit(self.settings.url).netloc, "hub of omlox")]

    def _read(self, payload: bytes, came_us: int) -> list[Told]:
        """raises  ServiceUnreachable where the hub refuses the subscription"""
        try:
            said = read_object(read_json(payload))
            if said.get("event") == "error":
                raise ServiceUnreachable(
                    f"The hub refuses: {said.get('code')} {said.get('description') or ''}".rstrip() + ".",
                    "Correct params and the token in token_file.",
                )
            if said.get("event") != "message" or said.get("topic") != TOPIC:
                return []
            return [self._reading.of(said.get("payload"), came_us)]
        except Unusable as error:
            return [Told(unusable=[error])]

    def _lost(self, error: Exception) -> ServiceUnreachable:
        host = urlsplit(self.settings.url).netloc
        return ServiceUnreachable(
            f"The hub {host} is away: {str(error).rstrip('.') or type(error).__name__}.", REMEDY
        )
