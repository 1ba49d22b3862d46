"""Changes of relations as CloudEvents 1.0, as those of events are (`semap/store/event/cloud_event`)."""

from __future__ import annotations

from dataclasses import fields
from datetime import datetime
from urllib.parse import quote
from uuid import UUID

from semap.store.event.cloud_event import DIGITS
from semap.store.relation.changes import StoredChange
from semap.timeline.stamp import rfc3339

TYPE = "semap.relation."


def change_cloud_event(change: StoredChange) -> dict[str, object]:
    """A change in its envelope, as a value for JSON."""
    return {
        "specversion": "1.0",
        "id": str(change.uid),
        "source": f"/maps/{quote(change.map, safe='')}",
        "type": TYPE + change.kind,
        "time": rfc3339(change.transition_at),
        "subject": change.object,
        "datacontenttype": "application/json",
        "sequence": f"{change.seq:0{DIGITS}}",
        "data": {each.name: _plain(getattr(change, each.name)) for each in fields(change)},
    }


def _plain(value: object) -> object:
    if isinstance(value, datetime):
        return rfc3339(value)
    return str(value) if isinstance(value, UUID) else value
