"""Intake: rows off the log in, steps for the rules out; no I/O and no clock of its own.

Rows arrive in the order of the log and wait, by map, until the watermark has passed them (`sources`). So the
rules are given the same, in whatever order rows arrive within the lateness of their sources, and wherever
intake is stored and restored:

- a row that comes later is given out as late, and only to rules that need no order;
- a row that is taken back while it waits has never been; later, that it was taken back is given out as late;
- what an edit did where event time has passed is due at once, as if it were done where the map is; since no
  source says up to when a map was edited, rules that make an event of each of its changes wait for none.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from semap.intake.map_intake import MapIntake
from semap.intake.sources import Sources
from semap.rules.engine.changes import Changes, Late
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import AsItComes, Due
from semap.rules.needs import Needs
from semap.rules.row import Row
from semap.rules.row_json import RowJson, dump_row, load_row


class Intake:
    """Mutable: what waits of all maps, and the rules that are to be given it."""

    def __init__(self) -> None:
        self._maps: dict[int, MapIntake] = {}
        self._rules: dict[int, Rule] = {}
        self._gone: list[MapIntake] = []

    @property
    def rules(self) -> Mapping[int, Rule]:
        """All rules, by id, enabled or not."""
        return self._rules

    def change_rule(self, rule_id: int, rule: Rule | None) -> None:
        """A rule is added, replaced or (None) removed, for what follows.

        raises InvalidInput, and changes nothing, if it closes a circle of rules
        """
        known = self._rules.get(rule_id)
        if rule is not None:
            self._on(rule.map_id).change_rule(rule_id, rule)
            self._rules[rule_id] = rule
        elif known is not None:
            self._on(known.map_id).change_rule(rule_id, None)
            del self._rules[rule_id]

    def delete_map(self, map_id: int) -> None:
        """A map is gone, with its rules and all that waits."""
        gone = self._maps.pop(map_id, None)
        if gone is None:
            return
        self._rules = {rule_id: rule for rule_id, rule in self._rules.items() if rule.map_id != map_id}
        gone.waiting.clear()
        gone.late.clear()
        self._gone.append(gone)

    def reads_map(self, map_id: int) -> bool:
        """Whether rules of a map read its changes."""
        return map_id in self._maps and self._maps[map_id].reads_map()

    def needs(self, map_id: int) -> Needs:
        """What rows that are due need before they are taken."""
        return self._on(map_id).needs

    def released_us(self, map_id: int) -> int:
        """Up to which stamp the rows of a map have been given out."""
        return self._on(map_id).sources.released_us

    def arrive(self, map_id: int, row: Row) -> AsItComes | None:
        """Take a row off the log; gives what rules are to take although it is too late, or of the map."""
        on_map = self._maps.get(map_id)
        return None if on_map is None else on_map.arrive(row)

    def retract(self, map_id: int, uid: str, row: Row) -> None:
        """A row that has come was none. It is taken out where it waits; where it was due, this is late.

        uid  of that row
        row  says so, with an identity of its own
        """
        on_map = self._maps.get(map_id)
        if on_map is not None:
            on_map.retract(uid, row)

    def watermark(self, map_id: int, source_id: int, complete_us: int, is_awaited: bool = True) -> None:
        """All rows of a source up to here have come; where it is not awaited, no more are to be expected."""
        self._on(map_id).sources.watermark(source_id, complete_us, is_awaited)

    def forget_source(self, source_id: int) -> None:
        """A source is gone, and nothing is to be expected of it."""
        for on_map in self._maps.values():
            on_map.sources.leave_out(source_id)

    def due(self) -> list[Due]:
        """What may be taken now, which waits no more."""
        return [due for on_map in self._maps.values() if (due := on_map.due()) is not None]

    def begin(self, map_id: int, rows: Iterable[Row]) -> list[Row]:
        """Of rows that a rule begins with, those that it is to take by itself; later ones wait."""
        return self._on(map_id).begin(rows)

    def changes(self) -> Changes:
        """What is to be stored since the last call."""
        added: list[tuple[int, str, RowJson]] = []
        removed: list[tuple[int, str]] = []
        late: list[Late] = []
        for on_map in (*self._gone, *self._maps.values()):
            new, gone = on_map.waiting.changes()
            added += [(on_map.map_id, row.uid, dump_row(row)) for row in new]
            removed += [(on_map.map_id, uid) for uid in gone]
            late += on_map.late
            on_map.late = []
        self._gone = []
        return Changes({}, added, removed, late)

    def rules_json(self) -> dict[str, object]:
        return {str(rule_id): rule.as_json() for rule_id, rule in self._rules.items()}

    def watermarks_json(self) -> dict[str, object]:
        return {str(map_id): on_map.sources.as_json() for map_id, on_map in self._maps.items()}

    @staticmethod
    def restore(
        rules: Iterable[Rule],
        watermarks: Mapping[str, Mapping[str, object]],
        pending: Iterable[tuple[int, object]],
    ) -> Intake:
        """That of which this was stored: rules, watermarks, (map, row)."""
        intake = Intake()
        for rule in rules:
            intake.change_rule(rule.rule_id, rule)
        for map_id, document in watermarks.items():
            intake._on(int(map_id)).sources = Sources.from_json(document)
        for on_map_id, row in pending:
            intake._on(on_map_id).waiting.load(load_row(row))
        return intake

    def _on(self, map_id: int) -> MapIntake:
        if map_id not in self._maps:
            self._maps[map_id] = MapIntake(map_id)
        return self._maps[map_id]
