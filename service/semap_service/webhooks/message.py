"""What is sent of an event: a CloudEvents 1.0 document (JSON, structured mode), under the event's own id."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from uuid import uuid4

from semap.store.event.cloud_event import cloud_event
from semap.store.event.events import StoredEvent

PING = "org.semap.ping"


def message_id(event: StoredEvent) -> str:
    """The same at each attempt, so that receivers know what they have already."""
    return str(event.event_id)


def message_of(event: StoredEvent) -> str:
    return _text(cloud_event(event))


def ping() -> tuple[str, str]:
    """The id and the body of a message that only tries whether messages arrive."""
    id_ = str(uuid4())
    return id_, _text(
        {
            "specversion": "1.0",
            "id": id_,
            "source": "/webhooks",
            "type": PING,
            "time": datetime.now(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z"),
            "datacontenttype": "application/json",
            "data": {},
        }
    )


def _text(document: Mapping[str, object]) -> str:
    return json.dumps(document, ensure_ascii=False, separators=(",", ":"))
