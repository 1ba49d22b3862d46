"""Intervals of rows: what holds from one row to another, half-open [begin, end).

A row is about a subject. A relation's `began` and an object's new state begin an interval of each variable
whose condition is true of that row; the next row of the same subject ends it, be it the relation's `ended` or
the object's next state. Rows that are no change of a subject (of the map, events, lines that are crossed)
begin and end nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from semap.rules.bound import Bound, Condition
from semap.rules.row import Row, Value

Subject: TypeAlias = tuple[Value, ...]
"""Input, track_id, instance_id, and the ids of sides of other kinds; an object's state has no track."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A variable holds from the row `begin` to the row `end`; without one it is open at the watermark."""

    variable: str
    begin: Row
    end: Row | None = None

    @property
    def start_us(self) -> int:
        return self.begin.stamp_us

    @property
    def end_us(self) -> int | None:
        """None: after everything that is known."""
        return None if self.end is None else self.end.stamp_us

    @property
    def subject(self) -> Subject | None:
        return subject_of(self.begin)


def subject_of(row: Row) -> Subject | None:
    """Whom the row is about; None where it is no change of one."""
    values = row.values
    if row.source == "relation" and values.get("type") != "crossed":
        subject = values.get("input"), values.get("track_id"), values.get("instance_id")
        others = values.get("subject_id"), values.get("other_id")
        return subject if others == (None, None) else (*subject, *others)
    if row.source == "object_state":
        return values.get("input"), None, values.get("instance_id")
    return None


def begins(row: Row) -> bool:
    """Whether something holds from this row on."""
    return row.source == "object_state" or (row.source == "relation" and row.values.get("type") == "began")


def begun(row: Row, variables: Mapping[str, Condition | None]) -> tuple[str, ...]:
    """The variables of which the row begins an interval."""
    if not begins(row):
        return ()
    return tuple(name for name, condition in variables.items() if satisfies(row, name, condition))


def satisfies(row: Row, variable: str, condition: Condition | None) -> bool:
    """Whether the row may be bound to the variable; one without a condition takes any."""
    if condition is None:
        return True
    if condition.test is not None:
        return condition.test(row)
    return condition.test_bound(row, Bound(variable, row))
