"""The first half of the engine alone: steps of the log out as records, for rules that run elsewhere.

Records are sent before their place in the log is committed. Killed between the two, the publisher sends them
again, with the same places, and whoever reads them passes them over (`semap/rules/engine/record.py`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import psycopg

from semap.errors import Conflict
from semap.intake.stretch import Stretch
from semap.replication.pgoutput import Transaction
from semap.rules.engine.record import Handed, dump_record
from semap.rules.engine.step import MapGone, Step
from semap.worker.progress import Made, Progress, commit_progress, halves, read_states, read_waiting

Sent: TypeAlias = tuple[str, str]
"""A record with its key, the map's uid: those of one key stay in order."""


class Publishing:
    """Mutable: what a stretch of the log has brought since the last commit.

    The first time, the rules are handed over as they stand, with all that they have under way.

    send    returns once the records are where they are kept
    raises  Conflict where the database is published under another name
    """

    def __init__(
        self,
        connection: psycopg.Connection,
        stretch: Stretch,
        progress: Progress,
        shard: str,
        send: Callable[[Sequence[Sent]], None],
    ) -> None:
        if progress.published_as not in (None, shard):
            raise Conflict(
                f"This database is published as {progress.published_as}, not as {shard}.",
                "Keep the name: whoever reads what is published knows its place by it.",
            )
        self.progress = progress
        self._stretch, self._shard, self._send = stretch, shard, send
        self._records: list[Sent] = []
        self._gone_maps: list[int] = []
        if progress.published_as is None:
            self._hand_over(connection)

    def has_made(self) -> bool:
        """Whether somebody waits for what was made."""
        return bool(self._records or self._gone_maps)

    def take(self, transaction: Transaction, now_s: float) -> None:
        """raises as `Stretch.steps`"""
        by_map: dict[int, list[Step]] = {}
        for step in self._stretch.steps(transaction, now_s):
            by_map.setdefault(step.map_id, []).append(step)
            if isinstance(step, MapGone):
                self._gone_maps.append(step.map_id)
        for map_id, steps in by_map.items():
            self._record(map_id, transaction.end_lsn, steps)

    def commit(self, connection: psycopg.Connection, before_lsn: int) -> int:
        """Send it, then write how far the log was read."""
        self._send(self._records)
        newest = commit_progress(connection, before_lsn, self.progress, Made((), self._gone_maps))
        self._records, self._gone_maps = [], []
        return newest

    def _record(self, map_id: int, lsn: int, steps: Sequence[Step | Handed]) -> None:
        uid = self.progress.facts.map_uid(map_id)
        self._records += [(uid, text) for text in dump_record(uid, self._shard, lsn, steps)]

    def _hand_over(self, connection: psycopg.Connection) -> None:
        """What the rules of each map stand at; here nothing is kept of it."""
        progress = self.progress
        for map_id, entries in _standing(connection, progress).items():
            self._record(map_id, progress.lsn, [Handed(map_id, entries)])
            progress.rules.delete_map(map_id)
        progress.published_as = self._shard


def _standing(connection: psycopg.Connection, progress: Progress) -> Mapping[int, Mapping[str, str]]:
    """By map, what `MapRules` is made of."""
    entries: dict[int, dict[str, str]] = {
        int(map_id): {"map": json.dumps([int(map_id), progress.intake.released_us(int(map_id))])}
        for map_id in progress.intake.watermarks_json()
    }
    rules = progress.rules.rules
    for rule_id, rule in rules.items():
        entries[rule.map_id][f"rule/{rule_id}"] = json.dumps(rule.as_json())
    for rule_id, each in progress.rules.given_up.items():
        entries[rules[rule_id].map_id][f"given_up/{rule_id}"] = json.dumps(each.as_json())
    for rule_id, key, state in read_states(connection):
        if rule_id in rules:
            entries[rules[rule_id].map_id][f"state/{rule_id}/{key}"] = json.dumps(state)
    for map_id, row in halves(read_waiting(connection))[1]:
        entries[map_id][f"row/{row[2]}"] = json.dumps(row)
    return entries
