"""What changed between a track and an instance, as the database writes it and the log carries it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal
from uuid import UUID

Kind = Literal["began", "ended"]
Cause = Literal["moved", "appeared", "disappeared", "map"]


@dataclass(frozen=True)
class RelationChange:
    """A relation began or ended.

    uid    the same for the same change, however often it is replayed
    stamp  event time of the first state that shows it
    since  when the relation began; equal to `stamp` where it begins
    """

    uid: UUID
    map_id: int
    query_id: int
    track_id: int
    track_name: str
    instance_id: int
    instance_name: str
    kind: Kind
    cause: Cause
    stamp: datetime
    since: datetime
