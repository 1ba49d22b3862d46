"""Events as CloudEvents 1.0 in the JSON format (CNCF CloudEvents, JSON Event Format 1.0.2).

`id` is the event's own, so that an event that is delivered twice is known again; `source` is the path of its
map; `sequence` is the extension of that name, with the event's number, padded so that texts sort as numbers
do.
"""

from __future__ import annotations

import json
from typing import Literal
from urllib.parse import quote
from uuid import UUID

from pydantic import ConfigDict, Field
from starlette.requests import HTTPConnection

from semap.store.events import StoredEvent
from semap_service.documents.document import Document, Stamp, rfc3339
from semap_service.documents.event import EXAMPLE, EventDocument, event_document

STRUCTURED = "application/cloudevents+json"
BATCH = "application/cloudevents-batch+json"
TYPE = "semap.event."
SCHEMA_PATH = "schemas/event"
DIGITS = 19
"""Of the largest bigint: the extension Sequence wants texts in their order."""


class CloudEventDocument(Document):
    """An event in a CloudEvents 1.0 envelope."""

    model_config = ConfigDict(
        json_schema_serialization_defaults_required=False,
        json_schema_extra={
            "examples": [
                {
                    "specversion": "1.0",
                    "id": EXAMPLE["event_id"],
                    "source": "/maps/office",
                    "type": "semap.event.opened_then_entered",
                    "time": EXAMPLE["stamp"],
                    "subject": "Room07",
                    "datacontenttype": "application/json",
                    "dataschema": "http://127.0.0.1:8000/schemas/event",
                    "sequence": "0000000000000000017",
                    "data": EXAMPLE,
                }
            ]
        },
    )

    specversion: Literal["1.0"]
    id: UUID = Field(description="`event_id` of the event.")
    source: str = Field(description="The path of the event's map.")
    type: str = Field(description="semap.event. and the type of the event.", pattern="^semap[.]event[.]")
    time: Stamp = Field(description="When it happened.")
    subject: str = Field(
        default="",
        description="The name of the instance, else of the track; left out where there is neither.",
    )
    datacontenttype: Literal["application/json"]
    dataschema: str = Field(description="The JSON Schema of `data`.")
    sequence: str = Field(description="The number of the event, in 19 digits.", pattern="^[0-9]{19}$")
    data: EventDocument


def cloud_event(event: StoredEvent, schema_url: str | None = None) -> dict[str, object]:
    """An event in its envelope, as a value for JSON.

    schema_url  where the JSON Schema of `data` is, if the receiver can be told
    """
    return {**_attributes(event, schema_url), "data": event_document(event).model_dump(mode="json")}


def cloud_event_json(event: StoredEvent, document: bytes, schema_url: str) -> bytes:
    """The same as JSON in UTF-8, of an event whose document is written already."""
    envelope = json.dumps(_attributes(event, schema_url), separators=(",", ":")).encode()
    return envelope[:-1] + b',"data":' + document + b"}"


def _attributes(event: StoredEvent, schema_url: str | None) -> dict[str, object]:
    attributes = {
        "specversion": "1.0",
        "id": str(event.event_id),
        "source": f"/maps/{quote(event.map, safe='')}",
        "type": TYPE + event.type,
        "time": rfc3339(event.stamp),
        "subject": event.instance_name or event.track_name,
        "datacontenttype": "application/json",
        "dataschema": schema_url,
        "sequence": f"{event.seq:0{DIGITS}}",
    }
    return {name: value for name, value in attributes.items() if value}


def schema_url(connection: HTTPConnection) -> str:
    """Where a client finds the JSON Schema of an event's document."""
    base = connection.base_url
    scheme = {"ws": "http", "wss": "https"}.get(base.scheme, base.scheme)
    return str(base.replace(scheme=scheme)) + SCHEMA_PATH
