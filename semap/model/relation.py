"""What changed between a subject and an object, as the database writes it and the log carries it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

Kind = Literal["began", "ended", "crossed"]
Cause = Literal["moved", "appeared", "disappeared", "map"]
Direction = Literal["left_to_right", "right_to_left"]
"""Seen along a line, in the order of its vertices."""
Amendment = Literal["added", "retracted"]
"""Of the past, since states came late."""


@dataclass(frozen=True)
class Occupant:
    """A track that is in a room, and since when."""

    track_id: int
    name: str
    since: datetime
