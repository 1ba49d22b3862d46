"""From a row that came to the rows that a rule takes: with occupants, an actor near enough, for each room."""

from __future__ import annotations

from collections.abc import Sequence

from semap.rules.declaration import Declaration
from semap.rules.engine.needs import OF_ACTOR, properties_read
from semap.rules.engine.partition import in_rooms
from semap.rules.engine.presence import Presence
from semap.rules.row import Row


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
    """Without its actor where that was found further away than this rule looks."""
    distance_m = row.values.get("actor_distance_m")
    if not isinstance(distance_m, int | float) or distance_m <= within_m:
        return row
    values = {name: value for name, value in row.values.items() if name not in OF_ACTOR}
    return Row(row.stamp_us, row.rank, row.uid, row.source, values, row.concepts)
