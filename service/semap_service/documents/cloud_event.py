"""What a CloudEvent of semap looks like, as `semap/store/event/cloud_event` writes it."""

from __future__ import annotations

from typing import Literal
from uuid import UUID

from pydantic import ConfigDict, Field
from starlette.requests import HTTPConnection

from semap_service.documents.document import Document, Stamp
from semap_service.documents.event import EXAMPLE, EventDocument

SCHEMA_PATH = "schemas/event"


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


def schema_url(connection: HTTPConnection) -> str:
    """Where a client finds the JSON Schema of an event's document."""
    base = connection.base_url
    scheme = {"ws": "http", "wss": "https"}.get(base.scheme, base.scheme)
    return str(base.replace(scheme=scheme)) + SCHEMA_PATH
