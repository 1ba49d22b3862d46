"""Makes a lost replication slot again, and catches up from the tables what went past it.

Everything since shortly before the worker's last commit is given to the rules once more; an event
that exists keeps its id and is passed over.
"""

from __future__ import annotations

import psycopg

from semap.errors import Conflict
from semap.model.event import Event
from semap.replication.pgoutput import Change, parse_lsn
from semap.rules.engine import RuleSet
from semap.store.database import connect, translated
from semap.worker.inputs import rule_input
from semap.worker.rule_worker import ROLE, WORKER, Made, Progress, commit_progress

SINCE = """
    select to_jsonb(c) from semap.relation_change c, semap.progress p
    where p.worker = %s and c.received_at > p.updated_at - interval '10 minutes'
    order by c.change_id
"""


def resync(dsn: str) -> int:
    """Give the worker a new slot and a place in it; returns how many events were caught up.

    raises Conflict while a worker runs
    """
    with connect(dsn, application="semap resync") as connection, translated():
        if _is_active(connection):
            raise Conflict("A rule worker is running.", "Stop it first.")
        # from here until the events are caught up, no worker may begin in the new slot
        connection.execute("update semap.progress set lsn = '0/0' where worker = %s", [WORKER])
        connection.execute("select semap.replace_rule_slot()")
    with connect(dsn, ROLE, application="semap resync", autocommit=False) as connection, translated():
        connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        return _catch_up(connection)


def _is_active(connection: psycopg.Connection) -> bool:
    row = connection.execute(
        "select active from pg_replication_slots where slot_name = semap.rule_slot()"
    ).fetchone()
    return row is not None and bool(row[0])


def _catch_up(connection: psycopg.Connection) -> int:
    row = connection.execute(
        "select p.lsn::text, p.event_seq, s.confirmed_flush_lsn::text,"
        " coalesce((select jsonb_object_agg(r.rule_id, semap.rule_json(r)) from semap.rule r), '{}'),"
        " p.watermarks"
        " from semap.progress p, pg_replication_slots s"
        " where p.worker = %s and s.slot_name = semap.rule_slot()",
        [WORKER],
    ).fetchone()
    if row is None:
        return 0
    before, event_seq, lsn, rule_state, watermarks = row
    rules = RuleSet.from_json(rule_state)
    events: list[Event] = []
    for (document,) in connection.execute(SINCE, [WORKER]).fetchall():
        change = Change("relation_change", "insert", {key: str(value) for key, value in document.items()})
        item = rule_input(change)
        if item is not None:
            rules, made = rules.step(item)
            events.extend(made)
    after = Progress(parse_lsn(lsn), rules, watermarks)
    made_in_all = commit_progress(connection, parse_lsn(before), after, Made(tuple(events)))
    connection.commit()
    return made_in_all - int(event_seq)
