"""A stretch of the log, taken transaction by transaction: what rules are to take of it, step by step."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import psycopg

from semap.errors import InvalidInput, UntrustedBytes
from semap.intake.backfill import begin_rule
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
from semap.intake.place import Place
from semap.intake.visibility import await_visible
from semap.model.event import Event
from semap.replication.pgoutput import Change, Transaction
from semap.rules.engine.step import Due, MapGone, RuleChanged, Step
from semap.rules.needs import Needs
from semap.rules.row import Row

MOST_UNSEEN = 1000
"""Of so many transactions one makes sure that they are seen; each session can have only one that is not."""


class Stretch:
    """Mutable.

    place  where the stretch ends by now
    """

    def __init__(self, connection: psycopg.Connection, place: Place, now_s: float) -> None:
        self.place = place
        self._connection = connection
        self._unseen: deque[int] = deque(maxlen=MOST_UNSEEN)
        self._idleness = Idleness(place.heard, now_s, IDLE_AFTER_S)

    @staticmethod
    def begins_a_rule(transaction: Transaction) -> bool:
        """Whether a rule may look back over what is stored, so that what was made is to be committed."""
        return any(change.table == "rule" and change.operation != "delete" for change in transaction.changes)

    def steps(self, transaction: Transaction, now_s: float, made: Sequence[Event] = ()) -> Iterator[Step]:
        """Take a transaction; rows are of the map as it leaves it. A step is to be taken before the next.

        made    events that are not stored yet; those of these steps may be added to it meanwhile
        raises  UntrustedBytes if a row lacks a column or holds a value of another type
        """
        place = self.place
        if transaction.xid:
            self._unseen.append(transaction.xid)
        try:
            yield from self._read(transaction, now_s, made)
        except (KeyError, ValueError, InvalidInput) as error:
            raise UntrustedBytes(f"A row of the log is not as expected: {error}") from error
        place.facts.settle()
        place.heard = self._idleness.heard
        place.lsn = transaction.end_lsn
        place.committed_at_us = transaction.committed_at_us
        if any(change.table in MAP_TABLES for change in transaction.changes):
            place.facts_at_us = transaction.committed_at_us
        for due in place.intake.due():
            yield self._looked_up(due)

    def _read(self, transaction: Transaction, now_s: float, made: Sequence[Event]) -> Iterator[Step]:
        facts = self.place.facts
        ended = self._ended_by_the_map(transaction)
        for change in transaction.changes:
            facts.apply(change)
        for instance_id, kind in map_changes(transaction.changes).items():
            yield from self._map_changed(instance_id, kind, transaction.committed_at_us)
        for number, change in enumerate(transaction.changes):
            yield from self._row(change, ended.get(number))
            yield from self._rule(change, made)
        for change in transaction.changes:
            self._take_source(change, transaction.committed_at_us, now_s)
            yield from self._deleted_map(change)

    def silent(self, now_s: float) -> Mapping[int, int]:
        """The sources that are waited for although they are silent, with what they said last [us]."""
        return self._idleness.silent(now_s)

    def _ended_by_the_map(self, transaction: Transaction) -> dict[int, Row]:
        """Rows that an edit of the map ends, by their place in it: of the map as it was while they held."""
        facts = self.place.facts
        return {
            place: READERS[change.table](change.row, facts)
            for place, change in enumerate(transaction.changes)
            if is_ended_by_the_map(change) and _is_to_known(change, facts)
        }

    def _row(self, change: Change, row: Row | None) -> Iterator[Step]:
        read = READERS.get(change.table)
        if read is None or change.operation != "insert":
            return
        row = row or read(change.row, self.place.facts)
        map_id, retracts = integer_of(change.row, "map_id"), change.row.get("retracts")
        if retracts is not None:
            self.place.intake.retract(map_id, retracts, row)
        elif (step := self.place.intake.arrive(map_id, row)) is not None:
            yield step

    def _map_changed(self, instance_id: int, kind: str, committed_at_us: int) -> Iterator[Step]:
        known = self.place.facts.of(instance_id)
        if known is not None and self.place.intake.reads_map(known.map_id):
            row = map_row(instance_id, kind, committed_at_us, self.place.facts)
            step = self.place.intake.arrive(known.map_id, row)
            if step is not None:
                yield step

    def _rule(self, change: Change, made: Sequence[Event]) -> Iterator[RuleChanged]:
        found = rule_change(change)
        if found is not None:
            yield from begin_rule(self._connection, self.place, found, made)

    def _take_source(self, change: Change, at_us: int, now_s: float) -> None:
        gone_id = deleted_source(change)
        if gone_id is not None:
            self._idleness.forget(gone_id)
            self.place.intake.forget_source(gone_id)
        source = source_change(change)
        if source is not None:
            self._idleness.hear(source, at_us, now_s)
            self.place.intake.watermark(
                source.map_id, source.source_id, source.complete_us, source.is_awaited
            )

    def _deleted_map(self, change: Change) -> Iterator[MapGone]:
        map_id = deleted_map(change)
        if map_id is not None:
            self._idleness.forget_map(map_id)
            self.place.intake.delete_map(map_id)
            yield MapGone(map_id)

    def _looked_up(self, due: Due) -> Due:
        needs = self.place.intake.needs(due.map_id)
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
