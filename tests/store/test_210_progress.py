"""What the worker commits: all of it or nothing, numbered without gaps, and forgotten with its map."""

from __future__ import annotations

import json
from uuid import UUID

import psycopg
import pytest
from psycopg.types.json import Jsonb
from world import World

from semap.store.database.connection import connect, one_transaction
from semap.store.event.late_rows import count_late_rows
from semap.timeline.stamp import to_datetime

STAMP = "2026-01-31T12:00:00+00:00"


@pytest.fixture
def worker(world: World):
    with connect(world.dsn, "semap_worker") as connection:
        yield connection


def event(world: World, number: int, **more: object) -> dict:
    return {
        "event_id": str(UUID(int=number)), "map_id": world.map_id, "rule_name": "r", "rule_version": 1,
        "type": "t", "stamp": STAMP, "since": STAMP, **more,
        "evidence": [{"uid": str(UUID(int=99)), "variable": "A", "source": "map", "stamp": STAMP}],
    }  # fmt: skip


def commit(worker: psycopg.Connection, **made: object) -> int:
    """As the worker does, in place."""
    row = worker.execute(
        "select semap.commit_progress('rules', lsn, lsn, %s, null, %s, %s, %s, %s, %s) from semap.progress",
        [
            Jsonb(made["rules"]) if "rules" in made else None,
            made.get("gone_maps", []),
            *(
                Jsonb(made.get(name, empty))
                for name, empty in (("events", []), ("states", []), ("pending", {}), ("late", []))
            ),
        ],
    ).fetchone()
    assert row is not None
    return row[0]


def test_events_are_numbered_in_order_and_known_ones_passed_over(
    world: World, worker: psycopg.Connection
) -> None:
    assert commit(worker, events=[event(world, 1), event(world, 2), event(world, 1)]) == 2
    assert commit(worker, events=[event(world, 2), event(world, 3)]) == 3
    (added,) = worker.execute(
        "select semap.add_events('rules', %s)",
        [Jsonb([event(world, 3), event(world, 4, by_batch=True, confidence=0.5)])],
    ).fetchone()
    assert added == 1
    assert commit(worker, events=[event(world, 5)]) == 5
    assert world.rows("select seq, event_id, by_batch, confidence from semap.event order by seq") == [
        (number, UUID(int=number), number == 4, 0.5 if number == 4 else None) for number in range(1, 6)
    ]
    assert world.rows("select count(*), min(place), max(place) from semap.event_evidence") == [(5, 1, 1)]


def test_events_that_are_known_are_found_by_their_keys_though_planned_when_there_were_none(
    world: World, worker: psycopg.Connection
) -> None:
    with worker.transaction():
        for number in range(1, 11):
            commit(worker, events=[event(world, number)])
        commit(worker, events=[event(world, number) for number in range(11, 1011)])

        def rows_read() -> int:
            return worker.execute(
                "select sum(seq_tup_read) from pg_stat_xact_user_tables where relname in ('event', 'event_evidence')"
            ).fetchone()[0]

        before = rows_read()
        commit(worker, events=[event(world, number) for number in (5, 1011)])
        assert rows_read() == before


def test_states_come_and_go_and_follow_their_rule(world: World, worker: psycopg.Connection) -> None:
    def states() -> list[tuple]:
        return world.rows("select rule_id, key, state from semap.rule_state order by 1, 2")

    rules = {"1": {}, "2": {}}
    first = [{"rule_id": rule, "key": key, "state": [rule, key]} for rule in (1, 2) for key in ("[1]", "[2]")]
    commit(worker, rules=rules, states=first)
    assert states() == [(s["rule_id"], s["key"], s["state"]) for s in first]
    commit(
        worker, states=[{"rule_id": 1, "key": "[1]", "state": None}, {"rule_id": 1, "key": "[2]", "state": 5}]
    )
    assert states() == [(1, "[2]", 5), (2, "[1]", [2, "[1]"]), (2, "[2]", [2, "[2]"])]
    commit(worker, rules={"1": {}})
    assert states() == [(1, "[2]", 5)]


def test_rows_wait_are_late_and_go_with_their_map(world: World, worker: psycopg.Connection) -> None:
    def pending() -> list[tuple]:
        return world.rows("select map_id, uid, row from semap.pending_row order by uid")

    rows = [{"map_id": world.map_id, "uid": uid, "row": [uid]} for uid in "abc"]
    late = [{**row, "input": "door", "stamp": STAMP, "watermark": STAMP} for row in rows[:2]]
    commit(worker, events=[event(world, 1)], pending={"added": rows}, late=late)
    commit(worker, pending={"added": [], "removed": [{"map_id": world.map_id, "uid": "b"}]}, late=late)
    assert pending() == [(world.map_id, uid, [uid]) for uid in "ac"]
    worker.execute("update semap.late_row set replayed_at = now() where uid = 'a'")
    with one_transaction(world.dsn, "semap_read") as connection:
        (counted,) = count_late_rows(connection, map_name="world")
        assert count_late_rows(connection, map_name="nowhere") == ()
    noon = to_datetime(1_769_860_800_000_000)
    assert (counted.input, counted.rows, counted.replayed, counted.first, counted.last) == (
        "door",
        2,
        1,
        noon,
        noon,
    )
    world.run(
        "with run as (insert into semap.recompute_run (map_id, from_stamp, to_stamp) values (%s, now(), now()) returning run_id)"
        " insert into semap.event_amendment (event_id, verdict, run_id) select %s, 'confirmed', run_id from run",
        world.map_id, UUID(int=1),
    )  # fmt: skip
    assert commit(worker, gone_maps=[world.map_id]) == 1
    for table in ("event", "event_evidence", "event_amendment", "recompute_run", "pending_row", "late_row"):
        assert world.one(f"select count(*) from semap.{table}") == 0


def test_of_two_workers_one_goes_on_and_the_other_writes_nothing(
    world: World, worker: psycopg.Connection
) -> None:
    with pytest.raises(Exception, match="moved the progress"):
        worker.execute(
            "select semap.commit_progress('rules', '0/1', '0/2', null, null, '{}', %s)",
            [json.dumps([event(world, 1)])],
        )
    assert world.one("select count(*) from semap.event") == 0
