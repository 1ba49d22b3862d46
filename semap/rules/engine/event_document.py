"""An event as the functions of the database take it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from datetime import datetime
from uuid import UUID

from semap.model.event import Event, Evidence


def event_json(event: Event) -> dict[str, object]:
    """JSON of an event."""
    return _named(event)


def _named(value: Event | Evidence) -> dict[str, object]:
    return {each.name: _plain(getattr(value, each.name)) for each in fields(value)}


def _plain(value: object) -> object:
    match value:
        case UUID():
            return str(value)
        case datetime():
            return value.isoformat()
        case Mapping():
            return dict(value)
        case tuple():
            return [_named(each) for each in value]
    return value
