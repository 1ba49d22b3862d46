"""The bytes that clients are sent, made once for all that want the same.

A WebSocket frame from a server is not masked (RFC 6455, 5.1) and, without compression, says nothing of its
connection, so that all clients of a selection are sent the very same bytes. An event stream (WHATWG HTML,
9.2) has a message for each event.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import BaseModel

from semap.store.event.cloud_event import cloud_event_json
from semap_service.documents.feed import Heartbeat, Hello
from semap_service.feed.ring import Entry
from semap_service.http.websocket import text_frame

RETRY_MS = 1000


@dataclass(frozen=True)
class Envelope:
    """How an event is written: bare, or as a CloudEvent where `schema_url` is given."""

    schema_url: str | None = None

    def written(self, entry: Entry) -> bytes:
        if self.schema_url is None:
            return entry.document
        return cloud_event_json(entry.event, entry.document, self.schema_url)


@dataclass(frozen=True)
class SocketEncoding:
    """Text frames, each with one JSON message."""

    envelope: Envelope

    def hello(self, hello: Hello) -> bytes:
        return self.message(hello)

    def events(self, entries: Sequence[Entry], cursor: int) -> bytes:
        events = b",".join(self.envelope.written(entry) for entry in entries)
        return text_frame(b'{"type":"events","cursor":%d,"events":[%b]}' % (cursor, events))

    def heartbeat(self, cursor: int) -> bytes:
        return self.message(Heartbeat(cursor=cursor))

    def message(self, message: BaseModel) -> bytes:
        return text_frame(message.model_dump_json().encode())


@dataclass(frozen=True)
class StreamEncoding:
    """Messages of an event stream; those that are no event are named by their type."""

    envelope: Envelope

    def hello(self, hello: Hello) -> bytes:
        return b"retry: %d\nid: %d\n" % (RETRY_MS, hello.cursor) + self.message(hello)

    def events(self, entries: Sequence[Entry], cursor: int) -> bytes:
        return b"".join(
            b"id: %d\ndata: %b\n\n" % (entry.event.seq, self.envelope.written(entry)) for entry in entries
        )

    def heartbeat(self, cursor: int) -> bytes:
        """A comment, with the place at which a client that comes back goes on."""
        return b": heartbeat\nid: %d\n\n" % cursor

    def message(self, message: BaseModel) -> bytes:
        kind: str = message.type  # type: ignore[attr-defined]  # each has one
        return b"event: %b\ndata: %b\n\n" % (kind.encode(), message.model_dump_json().encode())
