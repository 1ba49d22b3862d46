"""From a row that came to the rows that a rule takes: with occupants, an actor near enough, for each room."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from semap.rules.declaration import Declaration
from semap.rules.engine.partition import in_rooms
from semap.rules.engine.presence import Presence
from semap.rules.needs import OF_ACTOR, properties_read
from semap.rules.row import Row

ACTOR_NEARER = "actor_nearer"
"""Of a row, no property that a rule can name: actors within shorter distances, by the distance as text."""


class Preparation:
    """Of one rule; rows are given in order.

    presence   where the rule reads `occupants`
    is_needed  whether any row is not taken as it came
    """

    def __init__(self, declaration: Declaration) -> None:
        read = properties_read(declaration)
        self.presence = Presence() if "occupants" in read else None
        self._by_room = "room" in declaration.partition_by
        self._actor_within_m = (
            {item.name: item.actor_within_m or 0.0 for item in declaration.inputs} if read & OF_ACTOR else {}
        )
        self.is_needed = self.presence is not None or self._by_room or bool(self._actor_within_m)

    def rows(self, row: Row) -> Sequence[Row]:
        """The rows that a row is to the rule."""
        if self.presence is not None:
            row = self.presence.after(row)
        if self._actor_within_m:
            row = _with_actor_within(row, self._actor_within_m.get(str(row.values.get("input")), 0.0))
        return in_rooms(row) if self._by_room else (row,)


def _with_actor_within(row: Row, within_m: float) -> Row:
    """With the actor as this rule looks for it, or without one where that is further away."""
    values = row.values
    nearer = values.get(ACTOR_NEARER)
    distance_m = values.get("actor_distance_m")
    if isinstance(nearer, Mapping) and repr(within_m) in nearer:
        actor = nearer[repr(within_m)]
    elif isinstance(distance_m, int | float) and distance_m > within_m:
        actor = {}
    elif nearer is None:
        return row
    else:
        actor = {name: values[name] for name in OF_ACTOR if name in values}
    known = {name: value for name, value in values.items() if name not in OF_ACTOR and name != ACTOR_NEARER}
    return row.saying({**known, **actor})
