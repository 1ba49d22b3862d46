"""The log of events, for other tools and for people: entries, and lanes of a timeline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import datetime
from uuid import UUID


@dataclass(frozen=True)
class Entry:
    """An event with the names that it had.

    concept  of the instance, as the map has it now; None where the instance is gone
    verdict  what the batch layer said of it (confirmed, retracted, amended); None where it was not asked
    """

    event_id: UUID
    type: str
    stamp: datetime
    since: datetime
    map: str
    rule: str
    rule_version: int
    track_id: int | None = None
    track: str | None = None
    instance_id: int | None = None
    instance: str | None = None
    concept: str | None = None
    cause: str | None = None
    confidence: float | None = None
    verdict: str | None = None
    key: Mapping[str, object] = field(default_factory=dict)
    measures: Mapping[str, object] = field(default_factory=dict)


ENTRY_TYPES: Mapping[str, str] = {each.name: str(each.type).removesuffix(" | None") for each in fields(Entry)}
"""Of each attribute of an entry, as it is written there, without None."""


@dataclass(frozen=True)
class Stay:
    """Something held from a moment to another: a track was in the room, the door was open.

    end   None: it holds still
    """

    start: datetime
    end: datetime | None
    who: str


@dataclass(frozen=True)
class Mark:
    """An event."""

    stamp: datetime
    text: str


@dataclass(frozen=True)
class Lane:
    """A room or a door, what held there, and the events there."""

    name: str
    is_door: bool
    stays: Sequence[Stay]
    marks: Sequence[Mark]
