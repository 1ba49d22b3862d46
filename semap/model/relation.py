"""What changed between a subject and an object, as the database writes it and the log carries it."""

from __future__ import annotations

from typing import Literal

Kind = Literal["began", "ended", "crossed"]
Cause = Literal["moved", "appeared", "disappeared", "map"]
Direction = Literal["left_to_right", "right_to_left"]
"""Seen along a line, in the order of its vertices."""
Amendment = Literal["added", "retracted"]
"""Of the past, since states came late."""
