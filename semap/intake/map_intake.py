"""The rows of one map, from the log to the moment at which its rules may take them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import reduce
from operator import or_

from semap.intake.sources import Sources
from semap.rules.engine.changes import Late
from semap.rules.engine.plan import plan_of
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import AsItComes, Due
from semap.rules.engine.waiting import Waiting
from semap.rules.needs import Needs, needs_of
from semap.rules.row import Row


class MapIntake:
    """Mutable.

    late   rows that came too late for some rule, since they were last asked for
    needs  what rows that are due need before they are taken
    """

    def __init__(self, map_id: int) -> None:
        self.map_id = map_id
        self.sources = Sources()
        self.waiting = Waiting()
        self.late: list[Late] = []
        self._rules: dict[int, Rule] = {}
        self._may_have_edits = True
        self._follow({})

    def change_rule(self, rule_id: int, rule: Rule | None) -> None:
        """A rule is added, replaced or (None) removed.

        raises InvalidInput, and changes nothing, if it closes a circle of rules
        """
        others = {known_id: known for known_id, known in self._rules.items() if known_id != rule_id}
        self._follow(others if rule is None else {**others, rule_id: rule})

    def _follow(self, rules: dict[int, Rule]) -> None:
        at_work = {rule_id: rule_id for rule_id, rule in rules.items() if rule.enabled}
        self._plan = plan_of(rules.values(), at_work)
        self._rules = rules
        self._waits, self._ordered = self._plan.waiting(), self._plan.ordered()
        self.needs = reduce(or_, (needs_of(rules[rule_id].declaration) for rule_id in at_work), Needs())

    def reads_map(self) -> bool:
        """Whether rules read the map's changes."""
        return bool(self._plan.names("map"))

    def arrive(self, row: Row) -> AsItComes | None:
        """Take a row off the log; gives what the rules are to take of it now.

        One by an edit of the map stands where the map is, if that has passed it.
        """
        released_us = self.sources.released_us
        name, source = row.values["input"], row.source
        is_late = row.stamp_us <= released_us
        if is_late and _is_edit(row):
            row = replace(row, stamp_us=released_us + 1)
            is_late, self._may_have_edits = False, True
        if is_late and name in self._ordered[source]:
            self.late.append(Late(self.map_id, row, released_us))
        if not is_late and name in self._waits[source]:
            self.waiting.add(row)
        is_now = (is_late or source == "map") and name in self._plan.as_come[source]
        return AsItComes(self.map_id, row) if is_now else None

    def retract(self, uid: str, row: Row) -> None:
        """A row that has come was none: it waits no more. Where rules took it, `row` says so, and is late."""
        if not self.waiting.retract_changes(uid) and row.values["input"] in self._waits[row.source]:
            self.late.append(Late(self.map_id, row, self.sources.released_us))

    def due(self) -> Due | None:
        """What may be taken now, and is waiting no more: rows of an edit of the map at once."""
        released_us, until_us = self.sources.released_us, self.sources.watermark_us()
        if until_us > released_us:
            rows = self.waiting.until(until_us)
            self.waiting.remove_until(until_us)
            self.sources.released_us = until_us
            return Due(self.map_id, until_us, rows)
        if not self._may_have_edits:
            return None
        self._may_have_edits = False
        edits = [row for row in self.waiting.until(released_us + 1) if _is_edit(row)]
        for row in edits:
            self.waiting.retract_changes(row.uid)
        return Due(self.map_id, released_us, edits) if edits else None

    def begin(self, rows: Iterable[Row]) -> list[Row]:
        """Of rows that a rule begins with, those that it is to take by itself; later ones wait.

        Events of rules are among the former, since they wait where they are made. One that waits already, as
        that of an edit of the map may behind its own stamp, is taken there.
        """
        found = []
        for row in rows:
            if row.stamp_us <= self.sources.released_us or row.source == "event":
                if row.uid not in self.waiting:
                    found.append(row)
            elif row.values["input"] in self._waits[row.source]:
                self.waiting.add(row)
        return found


def _is_edit(row: Row) -> bool:
    """Whether a row comes of an edit of the map, which has a place in the log rather than in event time."""
    return row.source == "map" or row.values.get("cause") == "map"
