"""PostgreSQL refuses a write that skips a stage."""

from __future__ import annotations

import psycopg
import pytest
import shapely
from world import SECOND_US, World

from semap.store.database.connection import connect

STATE = "insert into semap.track_state (track_id, stamp, x_m, y_m) values (1, now(), 0, 0)"
REFUSED = {
    "semap_ingest": [
        "delete from semap.instance", "update semap.abstraction set z_min_m = 0", "delete from semap.relation",
        "insert into semap.relation (query_id, map_id, confirmed, pending, raw) values (1, 1, false, true, true)", "update semap.track_now set live = true",
        "delete from semap.relation_change", "delete from semap.event", "update semap.progress set event_seq = 9",
        "delete from semap.track_state", "update semap.rule set enabled = false",
        "update semap.track set source_id = 1", "update semap.source set map_id = 1",
        "delete from semap.object_state", "update semap.source set idle = true", "update semap.object_state set value = ''",
        "select semap.commit_progress('rules', '0/0', '0/0', '{}', '{}', '{}', '[]')",
    ],
    "semap_worker": [
        STATE, "delete from semap.instance", "update semap.rule set enabled = false", "delete from semap.relation",
        "delete from semap.event", "update semap.event set type = 'x'", "delete from semap.relation_change",
        "delete from semap.object_state", "update semap.source set watermark = now()", "delete from semap.late_row",
    ],
    "semap_api": [
        STATE, "delete from semap.event", "delete from semap.relation_change", "update semap.progress set event_seq = 9",
        "delete from semap.object_state", "delete from semap.rule_version", "delete from semap.rule_query",
        "delete from semap.rule_state", "select semap.add_events('rules', '[]')",
        "select semap.collect_events('rules', 't', 0, 0, 1, '[]', '[]')",
        "delete from semap.relation", "update semap.track_now set live = true", "update semap.region set z_min_m = 0",
        "update semap.map set cell_m = 1", "select semap.ensure_partitions(array[current_date])",
        "select semap.commit_progress('rules', '0/0', '0/0', '{}', '{}', '{}', '[]')",
    ],
    "semap_read": [
        STATE, "delete from semap.instance", "delete from semap.event", "update semap.rule set enabled = false",
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("role", "statement"), [(r, s) for r, statements in REFUSED.items() for s in statements]
)
def test_a_write_of_another_stage_is_refused(world: World, role: str, statement: str) -> None:
    with connect(world.dsn, role) as connection, pytest.raises(psycopg.errors.InsufficientPrivilege):
        connection.execute(statement)


@pytest.mark.parametrize(
    "function", ["track_deleted", "map_deleted", "track_state_inserted", "instance_changed"]
)
def test_a_function_that_acts_for_its_owner_cannot_be_borrowed(world: World, function: str) -> None:
    with connect(world.dsn, "semap_read") as connection:
        connection.execute("create temp table mine (track_id bigint)")
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            connection.execute(
                "create trigger borrowed after delete on mine referencing old table as old_track"
                f" for each statement execute function semap.{function}()"
            )


@pytest.mark.parametrize("role", REFUSED)
def test_all_may_read_all_but_secrets(world: World, role: str) -> None:
    with connect(world.dsn, role) as connection:
        for (table,) in connection.execute(
            "select c.oid::regclass::text from pg_class c where relnamespace = 'semap'::regnamespace"
            " and relkind in ('r', 'p', 'v') and relname !~ '^(token|webhook)'"
        ).fetchall():
            connection.execute(psycopg.sql.SQL("select from {}").format(psycopg.sql.SQL(table)))


def test_states_written_by_the_ingest_role_keep_relations_true(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    track = world.add_track("t")
    with connect(world.dsn, "semap_ingest") as connection:
        connection.execute("insert into semap.track_state (track_id, stamp, x_m, y_m)"
                           " values (%s, to_timestamp(1), 2, 2)", [track])  # fmt: skip
    assert world.relations() == {("t", "room", SECOND_US)}
    with connect(world.dsn, "semap_api") as connection:
        connection.execute("delete from semap.instance where name = 'room'")
    assert world.relations() == set()
