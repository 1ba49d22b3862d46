"""Rows: what a rule reads, one by one, in the order of event time.

Every input becomes rows of one form: a change of a relation, a new state of an object, a change of the map,
an event of another rule. What a row says is a mapping of properties (`PROPERTIES` names them all); a property
that a row lacks is null. Stamps are whole microseconds since 1970 in UTC, in rows and in their properties.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from semap.cql2 import Kind

Source = Literal["relation", "object_state", "map", "event"]

RANKS: Mapping[Source, int] = {"map": 0, "object_state": 1, "relation": 2, "event": 5}
"""Which of two rows at one stamp is first.

A relation that begins adds 1, one that its track ends adds 2; what crosses a line stands with what ends.
"""

PROPERTIES: Mapping[str, Kind] = {
    "input": "text",  # name of the query, of the object's property, of the rule; 'map'
    "type": "text",  # began, ended, crossed; the new state; added, changed, removed; the event's type
    "stamp": "instant",
    "since": "instant",  # when the relation or the former state began; an event: the first row of its match
    "duration_s": "number",  # stamp - since
    "confirmed": "instant",  # when it was known, where that was later than it was: of a debounced relation
    "cause": "text",
    "track": "text",  # the subject of a relation, where it is a track
    "track_id": "number",
    "subject": "text",  # the subject, where it is an instance
    "subject_id": "number",
    "other": "text",  # the object, where it is a track
    "other_id": "number",
    "instance": "text",  # the object, where it is an instance
    "instance_id": "number",
    "room": "text",  # the room itself, or each of the rooms that a door joins (then one row for each)
    "room_id": "number",
    "room_uid": "text",  # the same in whatever database the map is
    "concept": "text",
    "attributes": "any",
    "neighbours": "array",  # names of the rooms that doors join to the row's room, ascending
    "occupants": "number",  # subjects related to the instance by this query, after this row
    "x_m": "number",  # where the boundary or the line was crossed
    "y_m": "number",
    "direction": "text",  # left_to_right or right_to_left, of what crossed a line
    "door": "text",  # by which it came in or went out, where that is known
    "door_id": "number",
    "edge": "number",  # of the outline, which it came in or went out by
    "previous": "text",  # the object's former state
    "actor": "text",  # the track that most likely caused it
    "actor_id": "number",
    "actor_likelihood": "number",
    "actor_distance_m": "number",
    "position": "shape",  # of the track, or of the instance where there is no track
    "footprint": "shape",  # of the instance
    "confidence": "number",
    "measures": "any",
}

Value = object
"""None, bool, int, float, str, a list of these, a mapping (attributes), or a shapely geometry.

An instant is an int [us]."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row.

    stamp_us  where it stands in event time; rows are given to a rule in ascending (stamp_us, rank, uid)
    uid       of the relation change, object state, map change or event that it is
    values    by the names of PROPERTIES; `isA` asks `concepts`, a tuple of the concept and all above it
    """

    stamp_us: int
    rank: int
    uid: str
    source: Source
    values: Mapping[str, Value]
    concepts: tuple[str, ...] = ()

    def saying(self, values: Mapping[str, Value]) -> Row:
        """The same row with these values."""
        return Row(self.stamp_us, self.rank, self.uid, self.source, values, self.concepts)

    @property
    def order(self) -> tuple[int, int, str]:
        return self.stamp_us, self.rank, self.uid

    @property
    def own_stamp_us(self) -> int:
        """When what it says was: before where it stands, if it was known later."""
        stamp = self.values.get("stamp")
        return stamp if isinstance(stamp, int) else self.stamp_us
