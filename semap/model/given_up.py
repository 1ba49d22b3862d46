"""What a rule gave up because too much was under way in one of its keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

MOST_UNDER_WAY = 10_000
"""So many runs of a pattern, or moments at which a formula is asked, are under way in a key at most."""

REMEDY = "Give it a window (within), a finer partition_by, or an after_match that skips more."


@dataclass(frozen=True)
class GivenUp:
    """What came to nothing since a version of a rule is in force.

    attempts  how many
    first     stamp of the row that the earliest of them began with; what begins from there on may be missing
    key       of that one, by the names in `partition_by`
    """

    attempts: int
    first: datetime
    key: Mapping[str, object]

    def __add__(self, other: GivenUp) -> GivenUp:
        earlier = min(self, other, key=lambda each: (each.first, sorted(map(str, each.key.items()))))
        return GivenUp(self.attempts + other.attempts, earlier.first, earlier.key)

    def as_text(self) -> str:
        """For the author of the rule: what may be missing, and what to do."""
        loss = self.loss()
        return f"{loss[0].upper()}{loss[1:]}. {REMEDY}"

    def loss(self) -> str:
        """What may be missing."""
        count = f"{self.attempts} attempt{'s' * (self.attempts != 1)}"
        since = self.first.isoformat().replace("+00:00", "Z")
        of_key = ", ".join(f"{name} {value}" for name, value in self.key.items())
        return (
            f"it gave up {count}, as more than {MOST_UNDER_WAY:,} were under way in one key; events that"
            f" begin at {since} or later may be missing" + (f" (first of {of_key})" if of_key else "")
        )

    @staticmethod
    def from_json(document: Mapping[str, Any]) -> GivenUp:
        return GivenUp(document["attempts"], datetime.fromisoformat(document["first"]), document["key"])

    def as_json(self) -> dict[str, object]:
        return {"attempts": self.attempts, "first": self.first.isoformat(), "key": dict(self.key)}
