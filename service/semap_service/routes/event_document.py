"""The document of an event, as lists and the feed give it."""

from __future__ import annotations

from typing import Literal
from uuid import UUID

from pydantic import ConfigDict, Field

from semap.store.events import StoredEvent
from semap_service.document import Document, Stamp


class EventTrack(Document):
    """Who it happened to."""

    id: int
    name: str


class EventInstance(Document):
    """Where it happened."""

    id: int
    name: str


class EventDocument(Document):
    """Something happened: what, when, between whom, by which rule, and the evidence for it."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "seq": 17,
                    "event_id": "0f8e2f6e-4b0b-5c0f-9a3e-0d1b5c1c7d11",
                    "map": "office",
                    "type": "entered",
                    "stamp": "2026-01-31T12:00:00.000000Z",
                    "cause": "moved",
                    "rule": "room_visits",
                    "rule_version": 1,
                    "track": {"id": 3, "name": "person 3"},
                    "instance": {"id": 7, "name": "Room07"},
                    "since": "2026-01-31T12:00:00.000000Z",
                    "evidence": ["6a1d1c5e-3f0e-4f83-a7a5-0f6f0a1f2b3c"],
                }
            ]
        }
    )

    seq: int = Field(description="Its number, which is the cursor. Numbers rise, with gaps.")
    event_id: UUID = Field(description="The same for the same event, however often it is replayed.")
    map: str
    type: str = Field(description="As the rule calls it.")
    stamp: Stamp = Field(description="When it happened.")
    cause: Literal["moved", "appeared", "disappeared", "map"] = Field(
        description="What made it happen: the track moved, was first seen, was lost, or the map was edited."
    )
    rule: str
    rule_version: int
    track: EventTrack
    instance: EventInstance
    since: Stamp = Field(description="When the relation began that began or ended here.")
    evidence: list[UUID] = Field(description="The changes of relations that made it.")


def event_document(event: StoredEvent) -> EventDocument:
    return EventDocument(
        seq=event.seq,
        event_id=event.event_id,
        map=event.map,
        type=event.type,
        stamp=event.stamp,
        cause=event.cause,  # type: ignore[arg-type]  # the database knows no other
        rule=event.rule,
        rule_version=event.rule_version,
        track=EventTrack(id=event.track_id, name=event.track_name),
        instance=EventInstance(id=event.instance_id, name=event.instance_name),
        since=event.since,
        evidence=list(event.evidence),
    )
