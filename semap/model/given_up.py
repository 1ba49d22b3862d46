"""What a rule did not tell because too much was under way in one of its keys, or ended there at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

MOST_UNDER_WAY = 10_000
"""So many attempts at a pattern, or moments at which a formula is asked, are under way in a key at most."""

MOST_COUNTED = 10**15
"""Of matches, of which there may be more than a number is written for."""

REMEDY = "Give it a window (within), a finer partition_by, or an after_match that skips more."
REMEDY_UNTOLD = (
    "Say how many are wanted: after_match: no skip, at most 100000; or use an after_match that skips."
)


@dataclass(frozen=True)
class GivenUp:
    """What came to nothing since a version of a rule is in force.

    attempts  how many
    first     stamp of the row that the earliest of them began with; what begins from there on may be missing
    key       of that one, by the names in `partition_by`
    matches   how many were found and not told, as more ended at one row than `after_match` allows
    """

    attempts: int
    first: datetime
    key: Mapping[str, object]
    matches: int = 0

    def __add__(self, other: GivenUp) -> GivenUp:
        earlier = min(self, other, key=lambda each: (each.first, sorted(map(str, each.key.items()))))
        matches = min(self.matches + other.matches, MOST_COUNTED)
        return GivenUp(self.attempts + other.attempts, earlier.first, earlier.key, matches)

    @property
    def remedy(self) -> str:
        """What to do."""
        said = ((self.attempts, REMEDY), (self.matches, REMEDY_UNTOLD))
        return " ".join(remedy for count, remedy in said if count)

    def as_text(self) -> str:
        """For the author of the rule: what may be missing, and what to do."""
        loss = self.loss()
        return f"{loss[0].upper()}{loss[1:]}. {self.remedy}"

    def loss(self) -> str:
        """What may be missing."""
        lost = []
        if self.attempts:
            count = f"{self.attempts} attempt{'s' * (self.attempts != 1)}"
            lost.append(f"it gave up {count}, as more than {MOST_UNDER_WAY:,} were under way in one key")
        if self.matches:
            least = "at least " if self.matches == MOST_COUNTED else ""
            count = f"{least}{self.matches:,} match{'es' * (self.matches != 1)}"
            lost.append(f"it found {count} more than after_match tells of those that end at one row")
        since = self.first.isoformat().replace("+00:00", "Z")
        of_key = ", ".join(f"{name} {value}" for name, value in self.key.items())
        return (
            " and ".join(lost)
            + f"; events that begin at {since} or later may be missing"
            + (f" (first of {of_key})" if of_key else "")
        )

    @staticmethod
    def from_json(document: Mapping[str, Any]) -> GivenUp:
        first = datetime.fromisoformat(document["first"])
        return GivenUp(document["attempts"], first, document["key"], document.get("matches", 0))

    def as_json(self) -> dict[str, object]:
        return {
            "attempts": self.attempts,
            "first": self.first.isoformat(),
            "key": dict(self.key),
            "matches": self.matches,
        }
