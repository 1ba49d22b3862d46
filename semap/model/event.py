"""What a rule made of changes."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from uuid import UUID

from semap.model.relation import Cause


@dataclass(frozen=True)
class Event:
    """Something happened: what, when, between whom, by which rule, and the evidence for it.

    stamp     event time
    since     when the relation began that began or ended here
    evidence  uids of the relation changes that made it
    """

    event_id: UUID
    map_id: int
    rule_name: str
    rule_version: int
    type: str
    stamp: datetime
    cause: Cause
    track_id: int
    track_name: str
    instance_id: int
    instance_name: str
    since: datetime
    evidence: tuple[UUID, ...]
