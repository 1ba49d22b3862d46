"""Makes a lost replication slot again, and catches up from the tables what went past it.

Everything since shortly before the worker's last commit is given to the rules once more, as if the log
brought it; an event that exists keeps its id and is passed over. Rows that rules had taken in order are not
given to them again.
"""

from __future__ import annotations

import time

import psycopg
from psycopg.rows import dict_row

from semap.errors import Conflict
from semap.intake.input_row import READERS, RELATION_COLUMNS
from semap.intake.stored_facts import load_map_facts
from semap.intake.stretch import Stretch
from semap.replication.pgoutput import Change, Transaction, parse_lsn
from semap.store.database.connection import connect, translated
from semap.timeline.stamp import to_us
from semap.worker.making import Making
from semap.worker.progress import ROLE, WORKER, Progress, load_progress

SINCE = {
    "relation_change": f"""
        select map_id::text, {RELATION_COLUMNS},
               retracts::text,
               case when c.received_at > p.updated_at then 't' else 'f' end as is_new
        from semap.relation_change c, semap.progress p
        where p.worker = %(worker)s and c.received_at > p.updated_at - interval '10 minutes'
          and not exists (select from semap.relation_change d where d.retracts = c.uid)
        order by c.change_id
    """,  # noqa: S608  (a constant)
    "object_state": """
        select map_id::text, uid::text, property, value, previous, instance_id::text, instance_name,
               stamp::text, since::text, attributes::text,
               case when o.received_at > p.updated_at then 't' else 'f' end as is_new
        from semap.object_state o, semap.progress p
        where p.worker = %(worker)s and o.received_at > p.updated_at - interval '10 minutes'
        order by o.object_state_id
    """,
}
NOW = {
    "rule": """
        select rule_id::text, map_id::text, name, version::text, declaration::text, queries::text,
               case when enabled then 't' else 'f' end as enabled, backfill_from::text, seam::text
        from semap.rule order by rule_id
    """,
    "source": """
        select source_id::text, map_id::text, watermark::text, newest_stamp::text, lateness::text,
               late_from::text,
               case when newest_is_whole then 't' else 'f' end as newest_is_whole,
               case when ended then 't' else 'f' end as ended, case when idle then 't' else 'f' end as idle
        from semap.source order by source_id
    """,
}


GONE = {
    "source": """
        select k.source_id::text
        from semap.progress p, jsonb_each(p.watermarks -> 'maps') m,
             jsonb_object_keys(m.value -> 'sources') as k (source_id)
        where p.worker = %(worker)s
          and not exists (select from semap.source s where s.source_id = k.source_id::integer)
    """,
    "map": """
        select k.map_id::text
        from (select jsonb_object_keys(p.watermarks -> 'maps')::integer
              from semap.progress p where p.worker = %(worker)s
              union select distinct map_id from semap.event
              union select map_id from semap.pending_row
              union select map_id from semap.late_row) as k (map_id)
        where not exists (select from semap.map m where m.map_id = k.map_id)
    """,
}


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
        "select p.event_seq, s.confirmed_flush_lsn::text, clock_timestamp()"
        " from semap.progress p, pg_replication_slots s"
        " where p.worker = %s and s.slot_name = semap.rule_slot()",
        [WORKER],
    ).fetchone()
    if row is None:
        return 0
    event_seq, lsn, now = row
    progress = load_progress(connection)
    progress.facts = load_map_facts(connection)
    known_rules = list(progress.intake.rules)
    missed = _missed_rows(connection, progress)
    rules = _changes(connection, "rule", NOW["rule"])
    there = {int(change.row["rule_id"] or 0) for change in rules}
    gone = [
        Change("rule", "delete", {"rule_id": str(rule_id)}) for rule_id in known_rules if rule_id not in there
    ]
    changes = (*gone, *rules, *missed, *_changes(connection, "source", NOW["source"]), *_gone(connection))
    now_s = time.monotonic()
    making = Making(connection, Stretch(connection, progress, now_s), progress)
    making.take(Transaction(parse_lsn(lsn), changes, to_us(now)), now_s)
    newest = making.commit(connection, 0)
    connection.commit()
    return newest - int(event_seq)


def _gone(connection: psycopg.Connection) -> list[Change]:
    """Sources and maps that are not there any more."""
    return [
        Change(table, "delete", found.row)
        for table, statement in GONE.items()
        for found in _changes(connection, table, statement)
    ]


def _missed_rows(connection: psycopg.Connection, progress: Progress) -> list[Change]:
    """Rows that the rules may not have taken."""
    return [
        change
        for table, statement in SINCE.items()
        for change in _changes(connection, table, statement)
        if change.row["is_new"] == "t"
        or READERS[table](change.row, progress.facts).stamp_us
        > progress.intake.released_us(int(change.row["map_id"] or 0))
    ]


def _changes(connection: psycopg.Connection, table: str, statement: str) -> list[Change]:
    """Rows as the log would bring them."""
    with connection.cursor(row_factory=dict_row) as cursor:
        cursor.execute(statement, {"worker": WORKER})
        return [Change(table, "insert", row) for row in cursor]
