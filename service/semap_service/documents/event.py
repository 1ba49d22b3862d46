"""The document of an event, as lists and the feed give it."""

from __future__ import annotations

from typing import Any, Literal
from uuid import UUID

from pydantic import ConfigDict, Field
from pydantic.config import JsonDict

from semap.store.event.events import StoredEvent
from semap_service.documents.document import Document, Stamp

EXAMPLE: JsonDict = {
    "seq": 17,
    "event_id": "0f8e2f6e-4b0b-5c0f-9a3e-0d1b5c1c7d11",
    "map": "office",
    "type": "opened_then_entered",
    "stamp": "2026-01-31T12:00:04.000000Z",
    "cause": None,
    "rule": "entered_after_opening",
    "rule_version": 1,
    "track": {"id": 3, "name": "person 3"},
    "instance": {"id": 7, "name": "Room07"},
    "since": "2026-01-31T12:00:00.000000Z",
    "key": {"room": "Room07"},
    "measures": {"gap_s": 4.0},
    "confidence": 0.83,
    "by_batch": False,
    "verdict": "confirmed",
    "amended_by": None,
    "evidence": [
        {
            "uid": "6a1d1c5e-3f0e-4f83-a7a5-0f6f0a1f2b3c",
            "variable": "O",
            "source": "object_state",
            "stamp": "2026-01-31T12:00:00.000000Z",
        },
        {
            "uid": "d7a0bb3c-95d4-4f0c-8f3e-2f9d6a3b1c22",
            "variable": "E",
            "source": "relation",
            "stamp": "2026-01-31T12:00:04.000000Z",
        },
    ],
}


class EventTrack(Document):
    """The track of the event."""

    id: int
    name: str


class EventInstance(Document):
    """Where it happened."""

    id: int
    name: str


class EvidenceDocument(Document):
    """A row that an event rests on."""

    uid: UUID = Field(description="Of the relation change, object state, map change or event.")
    variable: str = Field(description="Of the rule's pattern; empty in a rule without one.")
    source: Literal["relation", "object_state", "map", "event"]
    stamp: Stamp


class EventDocument(Document):
    """Something happened: what, when, between whom, by which rule, and the evidence for it."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    seq: int = Field(description="Its number, which is the cursor. Numbers rise, with gaps.")
    event_id: UUID = Field(description="The same for the same event, however often it is replayed.")
    map: str
    type: str = Field(description="As the rule calls it.")
    stamp: Stamp = Field(description="When it happened; of an absence: when it was certain.")
    cause: Literal["moved", "appeared", "disappeared", "map"] | None = Field(
        description="What made a relation begin or end: the track moved, was first seen, was lost, or the map"
        " was edited. Null in an event of a pattern, or of an object's state."
    )
    rule: str
    rule_version: int
    track: EventTrack | None = Field(description="The track of the last row that has one.")
    instance: EventInstance | None = Field(description="The instance of the last row that has one.")
    since: Stamp = Field(
        description="When the relation began that began or ended here; of a pattern: its first row."
    )
    key: dict[str, Any] = Field(description="The key of the rule's partition, by `partition_by`.")
    measures: dict[str, Any] = Field(description="The measures of the rule.")
    confidence: float | None = Field(description="0 to 1, where the rule has a `confidence`.", ge=0, le=1)
    by_batch: bool = Field(description="Whether the batch layer made it, from stored states.")
    verdict: Literal["confirmed", "retracted", "amended"] | None = Field(
        description="The verdict of the batch layer when the event was read; null without one."
    )
    amended_by: UUID | None = Field(description="The event that stands in its place.")
    evidence: list[EvidenceDocument] = Field(description="The rows that made it, in their order.")


def event_document(event: StoredEvent) -> EventDocument:
    return EventDocument.model_validate(event)
