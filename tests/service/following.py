"""Clients of the feeds, as tests need them: each message once, heartbeats passed over."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import httpx
from jsonschema import Draft202012Validator
from patience import PATIENCE_S
from running import Service
from semap_service.documents.feed import CloudEvents, Events, Failure, Heartbeat, Hello, TooSlow

MODELS = {"hello": Hello, "heartbeat": Heartbeat, "error": Failure, "too_slow": TooSlow, "events": Events}


@cache
def schema(kind: str, in_envelope: bool) -> Draft202012Validator:
    model = CloudEvents if kind == "events" and in_envelope else MODELS[kind]
    return Draft202012Validator(
        model.model_json_schema(mode="serialization"), format_checker=Draft202012Validator.FORMAT_CHECKER
    )


def any_message(feed) -> dict:
    """The next message, which is as it is described; of many events the first are looked at."""
    received = json.loads(feed.recv(timeout=PATIENCE_S))
    in_envelope = received["type"] == "events" and "specversion" in received["events"][0]
    some = {**received, "events": received["events"][:2]} if received["type"] == "events" else received
    schema(received["type"], in_envelope).validate(some)
    return received


def message(feed) -> dict:
    """The next message that is no heartbeat."""
    while (received := any_message(feed))["type"] == "heartbeat":
        pass
    return received


def events(feed, count: int) -> list[dict]:
    """The next events, so many exactly; each batch ends at its cursor or before."""
    found: list[dict] = []
    while len(found) < count:
        batch = message(feed)
        assert batch["type"] == "events", batch
        found += batch["events"]
        assert found[-1].get("seq", 0) <= batch["cursor"]
    assert len(found) == count
    return found


def numbers(found: list[dict]) -> list[int]:
    return [each["seq"] for each in found]


def narrow(service: Service) -> socket.socket:
    """A connection of which the kernel keeps little."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
    made.connect(("127.0.0.1", int(service.url.rsplit(":", 1)[1])))
    return made


def drained(made: socket.socket) -> bytes:
    """All that comes until the end, or until a WebSocket is closed for being too slow."""
    received = b""
    while not received.endswith(b"too slow") and (some := made.recv(1 << 16)):
        received += some
    return received


def deaf(service: Service, query: str, kind: str = "socket") -> socket.socket:
    """A client that has asked to follow, and does not read; for so long as the test does not."""
    made = narrow(service)
    path = f"/events/{'feed' if kind == 'socket' else 'stream'}?{query}"
    upgrade = (
        "Upgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    )
    asked = f"GET {path} HTTP/1.1\r\nHost: localhost\r\n{upgrade if kind == 'socket' else ''}\r\n"
    made.sendall(asked.encode())
    return made


@contextmanager
def stream(service: Service, headers: dict | None = None, **parameters: object) -> Iterator[Iterator[dict]]:
    """Messages of /events/stream as a browser reads them: {"id", "event", "data"}, comments left out."""
    with service.raw.stream("GET", "/events/stream", params=parameters, headers=headers) as response:
        assert response.status_code == 200, response.read()
        yield _messages(response)


def _messages(response: httpx.Response) -> Iterator[dict]:
    last_id, kind, data = "", "message", []
    for line in response.iter_lines():
        if line == "":
            if data:
                yield {"id": last_id, "event": kind, "data": json.loads("\n".join(data))}
            kind, data = "message", []
            continue
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "id":
            last_id = value
        elif name == "event":
            kind = value
        elif name == "data":
            data.append(value)
