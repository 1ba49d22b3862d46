"""States of objects, such as doors that open and close."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any
from uuid import UUID


@dataclass(frozen=True)
class NewObjectState:
    """A property of an instance, by its name, has this value from the stamp on."""

    instance: str
    property: str
    value: str
    stamp: datetime
    attributes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ObjectState:
    """A property of an instance has a value from a stamp on.

    previous, since  the value before and when it began, as they were known when this one arrived
    """

    id: int
    uid: UUID
    map: str
    source: str
    instance_id: int
    instance: str
    property: str
    value: str
    previous: str | None
    stamp: datetime
    since: datetime | None
    attributes: Mapping[str, Any]
