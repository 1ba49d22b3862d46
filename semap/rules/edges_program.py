"""Edges: each row by itself is a match, if its type has an event."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from semap.rules.finish import Finish, finished
from semap.rules.program import Match, State
from semap.rules.row import Row


@dataclass(frozen=True)
class EdgesProgram:
    """It has no state.

    emit  the event of each type of row
    """

    emit: Mapping[str, str]
    finish: Finish

    def step(self, state: State | None, row: Row) -> tuple[State | None, tuple[Match, ...]]:
        match_type = self.emit.get(str(row.values.get("type")))
        return None, finished(match_type, (("", row),), row.own_stamp_us, self.finish)

    def advance(self, state: State | None, watermark_us: int) -> tuple[State | None, tuple[Match, ...]]:
        return None, ()

    def deadline_us(self, state: State | None) -> int | None:
        return None

    def dump(self, state: State) -> object:
        return None

    def load(self, document: object) -> State:
        return None
