"""Events as the store gives them, for tests without a database."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any
from uuid import UUID

from semap.model.event import Evidence
from semap.store.event.events import StoredEvent

STAMP = datetime(2026, 1, 31, 12, tzinfo=UTC)


def stored(seq: int, **given: Any) -> StoredEvent:
    """An event of which some things are as given."""
    usual = {
        "seq": seq,
        "event_id": UUID(int=seq),
        "map": "office",
        "type": "entered",
        "stamp": STAMP,
        "cause": "moved",
        "rule": "room_visits",
        "rule_version": 1,
        "track_id": 3,
        "track_name": "person",
        "instance_id": 7,
        "instance_name": "Room07",
        "since": STAMP,
        "key": {},
        "measures": {},
        "confidence": None,
        "by_batch": False,
        "verdict": None,
        "amended_by": None,
        "created_at": STAMP,
        "place": None,
        "evidence": (Evidence(UUID(int=9), "E", "relation", STAMP),),
    }
    return StoredEvent(**{**usual, **given})
