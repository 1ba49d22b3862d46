"""A connection to an MQTT broker, version 5, with a password and certificates from files."""

from __future__ import annotations

import asyncio
import logging
import re
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from uuid import uuid4

import aiomqtt
from paho.mqtt.enums import LogLevel
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions
from pydantic import BaseModel, ConfigDict, Field

from semap.errors import ServiceUnreachable
from semap_bridge.context import Context
from semap_bridge.secret import Login, Tls

PORT, TLS_PORT = 1883, 8883
KEEPALIVE_S = 15
TOGETHER = 1000
"""So many messages are taken together at most."""
IN_FLIGHT = 200
WRONG = (
    (
        r"authori|user name|password|banned",
        "refuses the login",
        "Correct login: user and password_file, or the broker's list of users.",
    ),
    (
        r"ssl|certificate",
        "cannot be spoken to over TLS",
        "Correct tls: whom to trust (ca_file), and what this client shows (certificate_file, key_file).",
    ),
    ("", "is away", "See that it runs there, and host, port and tls; semap goes on by itself."),
)
"""What words of the library mean, and what to do."""

library = logging.getLogger(f"{__name__}.paho")
library.addFilter(lambda record: record.levelno < logging.WARNING)
"""What goes wrong is told once, by what is raised."""


class Broker(BaseModel):
    """Where a broker is, and who asks it."""

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True)

    host: str = Field(default="127.0.0.1", description="Its name or address.")
    port: int | None = Field(default=None, ge=1, le=65535, description="[default: 1883, with tls 8883]")
    login: Login | None = Field(default=None, description="user and password_file.")
    tls: Tls | None = Field(default=None, description="Encrypted; {} trusts whom the system trusts.")

    @property
    def address(self) -> str:
        return f"{self.host}:{self.port or (TLS_PORT if self.tls else PORT)}"


@dataclass(frozen=True)
class Outgoing:
    """A message to publish; an empty one that is retained removes what was."""

    topic: str
    payload: bytes
    is_retained: bool = False


def identifier(context: Context) -> str:
    """Of the client of a bridge: a broker keeps what it misses, and lets one of each name connect."""
    if context.only_looks:
        return f"semap-check-{uuid4().hex[:12]}"
    return f"semap-{context.map_name}-{context.name}"


class Link:
    """Mutable: a connection, open until it is closed or lost. After a loss another one is made."""

    def __init__(
        self, broker: Broker, identifier: str, *, keep_s: int = 0, will: Outgoing | None = None
    ) -> None:
        """identifier: of the client, one connection each; keep_s: so long the broker keeps what is missed"""
        self._broker, self._identifier = broker, identifier
        self._keep_s, self._will = keep_s, will
        self._client: aiomqtt.Client | None = None
        self._refused: str | None = None
        self._wrong: str | None = None

    async def open(self) -> None:
        """raises  ServiceUnreachable"""
        broker = self._broker
        properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        properties.SessionExpiryInterval = self._keep_s
        will = self._will
        client = aiomqtt.Client(
            broker.host,
            int(broker.address.rpartition(":")[2]),
            username=broker.login.user if broker.login else None,
            password=broker.login.password() if broker.login else None,
            tls_context=broker.tls.context() if broker.tls else None,
            identifier=self._identifier,
            protocol=aiomqtt.ProtocolVersion.V5,
            clean_start=self._keep_s == 0,
            properties=properties,
            keepalive=KEEPALIVE_S,
            will=aiomqtt.Will(will.topic, will.payload, 1, will.is_retained) if will else None,
            max_inflight_messages=IN_FLIGHT,
            socket_options=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
            logger=library,
        )
        client.pending_calls_threshold = TOGETHER
        self._hear_refusals(client)
        unreachable: ServiceUnreachable | None = None
        try:
            await client.__aenter__()
        except aiomqtt.MqttError as error:
            unreachable = self._unreachable(error)
        if unreachable is not None:
            raise unreachable  # not from the error, which holds the socket of a handshake that failed
        self._client = client

    async def close(self) -> None:
        """Let go of it."""
        client, self._client = self._client, None
        if client is not None:
            with suppress(aiomqtt.MqttError):
                await client.__aexit__(None, None, None)

    async def subscribe(self, topic: str, qos: int) -> None:
        """raises  ServiceUnreachable"""
        try:
            codes = await self._opened.subscribe(topic, options=SubscribeOptions(qos=qos))
        except aiomqtt.MqttError as error:
            raise self._unreachable(error) from error
        for code in codes:
            if isinstance(code, ReasonCode) and code.is_failure:
                raise ServiceUnreachable(
                    f"The broker {self._broker.address} refuses the topic {topic}: {code}.",
                    "Let this user read it (mosquitto: acl_file), or correct `topic`.",
                )

    async def publish(self, messages: Sequence[Outgoing]) -> None:
        """Publish in this order; returns when the broker has them all. raises  ServiceUnreachable"""
        for start in range(0, len(messages), IN_FLIGHT):
            part = messages[start : start + IN_FLIGHT]
            tasks = [
                asyncio.create_task(
                    self._opened.publish(each.topic, each.payload, qos=1, retain=each.is_retained)
                )
                for each in part
            ]
            try:
                await asyncio.gather(*tasks)
            except aiomqtt.MqttError as error:
                raise self._unreachable(error) from error
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
        if self._refused is not None:
            raise ServiceUnreachable(
                f"The broker {self._broker.address} refuses what is published: {self._refused}.",
                "Let this user write it (mosquitto: acl_file).",
            )

    async def messages(
        self, idle_s: Callable[[], float | None] = lambda: None
    ) -> AsyncIterator[list[aiomqtt.Message]]:
        """What comes, as many together as are there; raises ServiceUnreachable when the broker is lost.

        idle_s  after so long without any, none is given
        """
        coming = self._opened.messages
        first: asyncio.Task[aiomqtt.Message] | None = None  # kept: one that is cancelled may lose a message
        try:
            while True:
                first = first or asyncio.create_task(_next(coming))
                done, _ = await asyncio.wait({first}, timeout=idle_s())
                if not done:
                    yield []
                    continue
                taken, first = [first.result()], None
                waiting = min(len(coming), TOGETHER - 1)
                yield taken + [await anext(coming) for _ in range(waiting)]
        except aiomqtt.MqttError as error:
            raise self._unreachable(error) from error
        finally:
            if first is not None:
                first.cancel()

    @property
    def _opened(self) -> aiomqtt.Client:
        if self._client is None:
            raise self._unreachable(aiomqtt.MqttError("not connected"))
        return self._client

    def _hear_refusals(self, client: aiomqtt.Client) -> None:
        """The library counts what a broker refuses as published, and only logs why it was hung up on."""
        inner = client._client
        told = inner.on_publish

        def on_log(paho: Any, data: Any, level: int, text: str) -> None:
            if level == LogLevel.MQTT_LOG_ERR:
                self._wrong = text

        def on_publish(paho: Any, data: Any, mid: int, code: ReasonCode, properties: Any) -> None:
            if code.is_failure:
                self._refused = str(code)
            told(paho, data, mid, code, properties)  # type: ignore[misc, call-arg]

        inner.on_publish = on_publish
        inner.on_log = on_log

    def _unreachable(self, error: aiomqtt.MqttError) -> ServiceUnreachable:
        why = f"{error.__cause__ or self._wrong or error}".rstrip(".")
        said, remedy = next(
            (said, remedy) for pattern, said, remedy in WRONG if re.search(pattern, why, re.IGNORECASE)
        )
        return ServiceUnreachable(f"The broker {self._broker.address} {said}: {why}.", remedy)


async def _next(coming: AsyncIterator[aiomqtt.Message]) -> aiomqtt.Message:
    return await anext(coming)


def payload_of(message: aiomqtt.Message) -> bytes:
    """The bytes of a message."""
    return message.payload if isinstance(message.payload, bytes) else b""
