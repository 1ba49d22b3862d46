"""A stretch of the log, taken transaction by transaction: rows for the engine, events out of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import replace

import psycopg

from semap.errors import InvalidInput, UntrustedBytes
from semap.intake.enrichment import enriched
from semap.intake.former_state import changes_only
from semap.intake.idleness import IDLE_AFTER_S, Idleness
from semap.intake.input_row import READERS, integer_of, map_row
from semap.intake.inputs import (
    deleted_map,
    deleted_source,
    is_ended_by_the_map,
    map_changes,
    rule_change,
    source_change,
)
from semap.intake.map_facts import TABLES as MAP_TABLES
from semap.intake.map_facts import MapFacts
from semap.intake.visibility import await_visible
from semap.model.event import Event
from semap.replication.pgoutput import Change, Transaction
from semap.rules.engine.engine import Due
from semap.rules.needs import Needs
from semap.rules.row import Row
from semap.worker.backfill import begin_rule
from semap.worker.progress import Made, Progress

MOST_UNSEEN = 1000
"""Of so many transactions one makes sure that they are seen; each session can have only one that is not."""


class Stretch:
    """Mutable: what the log has brought since the last commit.

    progress  where the stretch ends by now
    made      what it has made
    """

    def __init__(self, connection: psycopg.Connection, progress: Progress, now_s: float) -> None:
        self.progress = progress
        self._connection = connection
        self._events: list[Event] = []
        self._gone_maps: list[int] = []
        self._unseen: deque[int] = deque(maxlen=MOST_UNSEEN)
        self._idleness = Idleness(progress.heard, now_s, IDLE_AFTER_S)

    @property
    def made(self) -> Made:
        return Made(tuple(self._events), tuple(self._gone_maps))

    def begin(self) -> None:
        """What was made is committed; another stretch begins."""
        self._events, self._gone_maps = [], []

    @staticmethod
    def begins_a_rule(transaction: Transaction) -> bool:
        """Whether a rule may look back over what is stored, so that what was made is to be committed."""
        return any(change.table == "rule" and change.operation != "delete" for change in transaction.changes)

    def take(self, transaction: Transaction, now_s: float) -> None:
        """Take a transaction; rows are made of the map as it leaves it.

        raises UntrustedBytes if a row lacks a column or holds a value of another type
        """
        facts = self.progress.facts
        if transaction.xid:
            self._unseen.append(transaction.xid)
        try:
            ended = self._ended_by_the_map(transaction)
            for change in transaction.changes:
                facts.apply(change)
            for instance_id, kind in map_changes(transaction.changes).items():
                self._map_changed(instance_id, kind, transaction.committed_at_us)
            for place, change in enumerate(transaction.changes):
                self._take_row(change, ended.get(place))
                self._take_rule(change)
            for change in transaction.changes:
                self._take_source(change, transaction.committed_at_us, now_s)
                self._take_deleted_map(change)
        except (KeyError, ValueError, InvalidInput) as error:
            raise UntrustedBytes(f"A row of the log is not as expected: {error}") from error
        facts.settle()
        self.progress.heard = self._idleness.heard
        self.progress.lsn = transaction.end_lsn
        self.progress.committed_at_us = transaction.committed_at_us
        if any(change.table in MAP_TABLES for change in transaction.changes):
            self.progress.facts_at_us = transaction.committed_at_us
        self._release()

    def silent(self, now_s: float) -> Mapping[int, int]:
        """The sources that are waited for although they are silent, with what they said last [us]."""
        return self._idleness.silent(now_s)

    def _ended_by_the_map(self, transaction: Transaction) -> dict[int, Row]:
        """Rows that an edit of the map ends, by their place in it: of the map as it was while they held."""
        facts = self.progress.facts
        return {
            place: READERS[change.table](change.row, facts)
            for place, change in enumerate(transaction.changes)
            if is_ended_by_the_map(change) and _is_to_known(change, facts)
        }

    def _take_row(self, change: Change, row: Row | None) -> None:
        read = READERS.get(change.table)
        if read is None or change.operation != "insert":
            return
        row = row or read(change.row, self.progress.facts)
        map_id, retracts = integer_of(change.row, "map_id"), change.row.get("retracts")
        if retracts is not None:
            self.progress.engine.retract(map_id, retracts, row)
        else:
            self._events += self.progress.engine.arrive(map_id, row)

    def _map_changed(self, instance_id: int, kind: str, committed_at_us: int) -> None:
        known = self.progress.facts.of(instance_id)
        if known is not None and self.progress.engine.reads_map(known.map_id):
            row = map_row(instance_id, kind, committed_at_us, self.progress.facts)
            self._events += self.progress.engine.arrive(known.map_id, row)

    def _take_rule(self, change: Change) -> None:
        found = rule_change(change)
        if found is not None:
            self._events += begin_rule(self._connection, self.progress, found, self._events)

    def _take_source(self, change: Change, at_us: int, now_s: float) -> None:
        gone_id = deleted_source(change)
        if gone_id is not None:
            self._idleness.forget(gone_id)
            self.progress.engine.forget_source(gone_id)
        source = source_change(change)
        if source is not None:
            self._idleness.hear(source, at_us, now_s)
            self.progress.engine.watermark(
                source.map_id, source.source_id, source.complete_us, source.is_awaited
            )

    def _take_deleted_map(self, change: Change) -> None:
        map_id = deleted_map(change)
        if map_id is not None:
            self._gone_maps.append(map_id)
            self._events = [event for event in self._events if event.map_id != map_id]
            self._idleness.forget_map(map_id)
            self.progress.engine.delete_map(map_id)

    def _release(self) -> None:
        """Give the rules what the watermarks let through."""
        engine = self.progress.engine
        self._events += engine.take([self._looked_up(due) for due in engine.due()])

    def _looked_up(self, due: Due) -> Due:
        needs = self.progress.engine.needs(due.map_id)
        if not due.rows or (needs == Needs() and all(row.source != "object_state" for row in due.rows)):
            return due
        await_visible(self._connection, self._unseen)
        self._unseen.clear()
        rows = changes_only(self._connection, due.rows)
        return replace(due, rows=enriched(self._connection, due.map_id, rows, needs))


def _is_to_known(change: Change, facts: MapFacts) -> bool:
    """Whether it is related to an instance of which something is known."""
    instance_id = change.row["instance_id"]
    return instance_id is not None and facts.of(int(instance_id)) is not None
