"""How far the rule worker has come, and what it knew there: loaded from the database, and committed to it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from itertools import zip_longest
from typing import TypeAlias

import psycopg
from psycopg.types.json import Jsonb

from semap.errors import SlotLost
from semap.intake.idleness import Heard
from semap.intake.inputs import read_rule
from semap.intake.intake import Intake
from semap.intake.place import Place
from semap.intake.stored_facts import load_map_facts
from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.replication.pgoutput import format_lsn, parse_lsn
from semap.rules.engine.changes import Changes
from semap.rules.engine.engine import Engine
from semap.rules.engine.event_document import event_json
from semap.rules.engine.step import NEVER_US, Step
from semap.rules.row_json import RowJson
from semap.store.database.connection import translated
from semap.timeline.stamp import to_datetime, to_us

RowOfMap: TypeAlias = tuple[int, RowJson]
WORKER = "rules"
ROLE = "semap_worker"

LOAD = """
    select lsn::text, rule_state, watermarks, updated_at from semap.progress where worker = %s
"""
COMMIT = """
    select semap.commit_progress(%s, %s::pg_lsn, %s::pg_lsn, %s, %s, %s, %s::jsonb, %s::jsonb,
                                 jsonb_build_object('added', %s::jsonb, 'removed', %s::jsonb), %s::jsonb)
"""
PART_CHARACTERS = 16_000_000
"""About so much JSON is handed over at once: the database takes no array of 256 MiB or more."""


@dataclass
class Progress(Place):
    """Mutable: a place in the log, and what both halves of the engine knew there.

    published_as  the shard's name, where rules run elsewhere, on what is published; they are none here then
    rules_stored  the rules as they were committed last; None where that is not known
    """

    rules: Engine = field(default_factory=Engine)
    published_as: str | None = None
    rules_stored: Mapping[str, object] | None = None

    def take(self, step: Step) -> list[Event]:
        """The events that a step makes."""
        events = self.rules.take(step)
        self._forget_failed()
        return events

    def _forget_failed(self) -> None:
        for rule_id in self.rules.failed():
            self.intake.change_rule(rule_id, None)

    def rules_json(self) -> dict[str, object]:
        """The rules in force as of the place, as `semap.rule_json` gives them."""
        return {
            rule_id: {**document, "seam": self.seams.get(int(rule_id))}  # type: ignore[dict-item]
            for rule_id, document in self.intake.rules_json().items()
        }

    def watermarks_json(self) -> dict[str, object]:
        return {
            "committed_at_us": self.committed_at_us,
            "given_up": self._given_up_json(),
            "facts_at_us": self.facts_at_us,
            "published_as": self.published_as,
            "maps": self.intake.watermarks_json(),
            "heard": {source_id: asdict(each) for source_id, each in self.heard.items()},
        }

    def _given_up_json(self) -> dict[int, object]:
        """As the view semap.rule_given_up reads it."""
        rules = self.rules.rules
        return {
            rule_id: {"version": rules[rule_id].version, **each.as_json()}
            for rule_id, each in self.rules.given_up.items()
        }


@dataclass(frozen=True)
class Made:
    """What a stretch of the log makes: events, and maps that it deletes, whose events go."""

    events: Sequence[Event] = ()
    gone_maps: Sequence[int] = ()


# Whoever writes states of a source may hold its row for long, and one that has spoken since is not idle.
# What follows shares the regions (sql/147), which come before rows: while somebody edits, nothing is noted.
NOTE_IDLE = """
    update semap.source set idle = true
    where source_id in (
      select s.source_id
      from semap.source s
      join unnest(%s::integer[], %s::timestamptz[]) as n (source_id, said) using (source_id)
      where not s.idle and coalesce(s.watermark, s.newest_stamp, '-infinity') = n.said
        and pg_try_advisory_xact_lock_shared(7363, 0)
      for no key update of s skip locked)
"""


def load_progress(connection: psycopg.Connection) -> Progress:
    """The progress that was committed last; its place is 0 where a resync was begun and did not end.

    raises SlotLost where there is none
    """
    with translated():
        row = connection.execute(LOAD, [WORKER]).fetchone()
    if row is None:
        raise SlotLost("The rule worker has no place in the log.", "Run `semap db migrate`.")
    lsn, documents, watermarks, updated_at = row
    committed_at_us = watermarks.get("committed_at_us", to_us(updated_at))
    facts_at_us = watermarks.get("facts_at_us", committed_at_us)
    read = (read_rule(int(rule_id), document) for rule_id, document in documents.items())
    rules = [rule for rule in read if rule is not None]
    marks = watermarks.get("maps", {})
    published_as = watermarks.get("published_as")
    intake_rows, rule_rows = halves(read_waiting(connection))
    progress = Progress(
        lsn=parse_lsn(lsn),
        committed_at_us=committed_at_us,
        intake=Intake.restore(rules, marks, intake_rows),
        facts=load_map_facts(connection, to_datetime(facts_at_us)),
        facts_at_us=facts_at_us,
        seams={int(rule_id): document["seam"] for rule_id, document in documents.items() if document["seam"]},
        heard={int(source_id): Heard(**each) for source_id, each in watermarks.get("heard", {}).items()},
        published_as=published_as,
        rules=Engine()
        if published_as
        else Engine.restore(
            rules,
            {int(map_id): mark["released_us"] for map_id, mark in marks.items()},
            read_states(connection),
            rule_rows,
            {
                int(rule_id): GivenUp.from_json(each)
                for rule_id, each in watermarks.get("given_up", {}).items()
            },
        ),
    )
    progress._forget_failed()
    return progress


def read_states(connection: psycopg.Connection) -> list[tuple[int, str, object]]:
    """What rules have under way: rule, key, state."""
    with translated():
        return connection.execute(
            "select rule_id, key, state from semap.rule_state where worker = %s", [WORKER]
        ).fetchall()


def read_waiting(connection: psycopg.Connection) -> list[RowOfMap]:
    """The rows that wait, of both halves."""
    with translated():
        return connection.execute(
            "select map_id, row from semap.pending_row where worker = %s", [WORKER]
        ).fetchall()


def halves(pending: Iterable[RowOfMap]) -> tuple[list[RowOfMap], list[RowOfMap]]:
    """Rows that wait, of either half: events of rules wait where they are made."""
    of_intake: list[RowOfMap] = []
    of_rules: list[RowOfMap] = []
    for map_id, row in pending:
        (of_rules if row[3] == "event" else of_intake).append((map_id, row))
    return of_intake, of_rules


def commit_progress(connection: psycopg.Connection, before_lsn: int, after: Progress, made: Made) -> int:
    """Write what was made and the progress in one transaction, if the place in the log is still `before_lsn`.

    returns  the number of the last event there is
    raises   ServerUnavailable where another worker has moved on
    """
    changes = after.intake.changes() + after.rules.changes()
    rules = after.rules_json()
    before = format_lsn(before_lsn)
    *parts, last = _in_parts(
        (event_json(event) for event in made.events),
        _states_json(changes),
        ({"map_id": map_id, "uid": uid, "row": row} for map_id, uid, row in changes.pending_added),
        ({"map_id": map_id, "uid": uid} for map_id, uid in changes.pending_removed),
        (late.as_json() for late in changes.late),
    )
    gone_maps = list(made.gone_maps)
    # what is one statement needs no transaction around it
    with translated(), connection.transaction() if parts else nullcontext():
        for part in parts:
            connection.execute(COMMIT, [WORKER, before, before, None, None, gone_maps, *part])
            gone_maps = []
        said = None if rules == after.rules_stored else Jsonb(rules)
        row = connection.execute(
            COMMIT,
            [WORKER, before, format_lsn(after.lsn), said, Jsonb(after.watermarks_json()), gone_maps, *last],
        ).fetchone()
    after.rules_stored = rules
    return int(row[0]) if row else 0


def _in_parts(*lists: Iterable[object]) -> list[tuple[str, ...]]:
    """These lists as JSON, in as many parts as the longest needs; one at least."""
    return list(zip_longest(*map(_parts, lists), fillvalue="[]")) or [("[]",) * len(lists)]


def _parts(items: Iterable[object]) -> Iterator[str]:
    """JSON arrays of these, none much longer than what may be handed over at once."""
    texts: list[str] = []
    characters = 0
    for item in items:
        text = json.dumps(item)
        if characters + len(text) > PART_CHARACTERS and texts:
            yield f"[{','.join(texts)}]"
            texts, characters = [], 0
        texts.append(text)
        characters += len(text)
    if texts:
        yield f"[{','.join(texts)}]"


def note_idle(connection: psycopg.Connection, silent: Mapping[int, int]) -> None:
    """Note that sources are idle which said these stamps [us] last; the log brings that back."""
    said = ["-infinity" if us == NEVER_US else to_datetime(us).isoformat() for us in silent.values()]
    with translated():
        connection.execute(NOTE_IDLE, [list(silent), said])


def say_alive(connection: psycopg.Connection) -> None:
    """Write that the worker is at work; readiness asks for it."""
    with translated():
        connection.execute(
            "update semap.progress set alive_at = clock_timestamp() where worker = %s", [WORKER]
        )


def _states_json(changes: Changes) -> Iterator[dict[str, object]]:
    for (rule_id, key), state in changes.states.items():
        yield {"rule_id": rule_id, "key": key, "state": state}
