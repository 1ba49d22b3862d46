"""What intake gives to the rules of a map, in the order of the log. Nothing else moves the rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from semap.rules.engine.rule import Rule
from semap.rules.row import Row

NEVER_US = -(2**63)


@dataclass(frozen=True, slots=True)
class Due:
    """Rows of a map that may be taken now, in order, and up to where its watermark has come."""

    map_id: int
    until_us: int
    rows: Sequence[Row]


@dataclass(frozen=True, slots=True)
class AsItComes:
    """A row that cannot stand in the order, for rules that need none: of the map, or too late."""

    map_id: int
    row: Row


@dataclass(frozen=True, slots=True)
class RuleChanged:
    """A rule is added, replaced or (None) removed, for what follows.

    rows     it begins with these, in order: of the past, or those that began what holds now; None: it goes on
    from_us  what it finds there that was earlier is not told
    """

    map_id: int
    rule_id: int
    rule: Rule | None
    rows: Sequence[Row] | None = None
    from_us: int = NEVER_US


@dataclass(frozen=True, slots=True)
class MapGone:
    """A map is gone, with its rules and their events."""

    map_id: int


Step: TypeAlias = Due | AsItComes | RuleChanged | MapGone
