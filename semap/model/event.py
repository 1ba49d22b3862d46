"""What a rule made of what it read.

Values, though not declared frozen: that makes them four times as dear, and they are made by the thousand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal
from uuid import UUID


@dataclass(slots=True)
class Evidence:
    """A row that an event rests on.

    variable  that the row is bound to; empty in a rule without a pattern
    source    what the row is: the change of a relation, a state of an object, a change of the map, an event
    """

    uid: UUID
    variable: str
    source: Literal["relation", "object_state", "map", "event"]
    stamp: datetime


@dataclass(frozen=True, slots=True)
class Named:
    """Something that another thing refers to."""

    id: int
    name: str | None


class TrackAndInstance:
    """Whom an event is about, of which it has ids and names; None of each that it is not about."""

    __slots__ = ()
    track_id: int | None
    track_name: str | None
    instance_id: int | None
    instance_name: str | None

    @property
    def track(self) -> Named | None:
        return None if self.track_id is None else Named(self.track_id, self.track_name or "")

    @property
    def instance(self) -> Named | None:
        return None if self.instance_id is None else Named(self.instance_id, self.instance_name or "")


@dataclass(slots=True)
class Event(TrackAndInstance):
    """Something happened: what, when, between whom, by which rule, and the evidence for it.

    stamp       event time
    since       when the relation began that began or ended here; of a pattern: its first row
    cause       what made the relation begin or end; None in an event of a pattern
    key         what the rule's partition is about, by the names in `partition_by`
    measures    what the rule measures, JSON
    confidence  0 to 1, where the rule says how it falls
    """

    event_id: UUID
    map_id: int
    rule_name: str
    rule_version: int
    type: str
    stamp: datetime
    since: datetime
    cause: str | None = None
    track_id: int | None = None
    track_name: str | None = None
    instance_id: int | None = None
    instance_name: str | None = None
    key: Mapping[str, object] = field(default_factory=dict)
    measures: Mapping[str, object] = field(default_factory=dict)
    confidence: float | None = None
    evidence: tuple[Evidence, ...] = ()
