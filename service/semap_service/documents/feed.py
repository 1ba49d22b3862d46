"""What clients of the feeds are sent, beside the events themselves."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from semap_service.documents.cloud_event import CloudEventDocument
from semap_service.documents.document import Document
from semap_service.documents.event import EventDocument

Resumed = Literal["nothing_missed", "replayed", "no_longer_kept"]

Cursor = Annotated[int, Field(description="The number up to which the client has now been told everything.")]


class Hello(Document):
    """The first message: where the feed begins, and what resuming gave.

    nothing_missed: nothing happened since the cursor. replayed: what happened since follows now.
    no_longer_kept: events between the cursor and `oldest` were deleted; what is kept follows now.
    """

    type: Literal["hello"] = "hello"
    cursor: int = Field(description="Everything with a higher number follows.")
    head: int = Field(description="The number of the newest event.")
    oldest: int | None = Field(description="The number of the oldest event that is kept; null where none is.")
    resumed: Resumed


class Events(Document):
    """Events in the order of their numbers."""

    type: Literal["events"] = "events"
    cursor: Cursor
    events: list[EventDocument] = Field(min_length=1)


class CloudEvents(Document):
    """The same with `envelope=cloudevents`."""

    type: Literal["events"] = "events"
    cursor: Cursor
    events: list[CloudEventDocument] = Field(min_length=1)


class Heartbeat(Document):
    """Nothing that was selected has happened for a while; the connection is alive."""

    type: Literal["heartbeat"] = "heartbeat"
    cursor: Cursor


class Failure(Document):
    """Why the feed ends here; the connection is closed after it."""

    type: Literal["error"] = "error"
    detail: str
    remedy: str


class TooSlow(Document):
    """The client did not take what it was sent; the connection is closed after this (WebSocket: 4408)."""

    type: Literal["too_slow"] = "too_slow"
    cursor: Cursor
    detail: str
    remedy: str = "Connect again with `after` at this cursor; read faster, or select less."


SocketMessage = Hello | Events | Heartbeat | TooSlow | Failure
