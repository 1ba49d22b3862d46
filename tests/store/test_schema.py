"""Migration: whole or not at all, by several at once, never backwards."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from unittest.mock import patch

import pytest
from alembic.script import ScriptDirectory
from patience import PATIENCE_S

from semap.errors import DatabaseError, ServerUnavailable
from semap.schema_files import schema_folder
from semap.store.database.connection import connect, one_transaction
from semap.store.operate import schema
from semap.store.operate.schema import head_version, is_current, migrate, require_current


def current(dsn: str) -> bool:
    with one_transaction(dsn) as connection:
        return is_current(connection)


def test_several_at_once_make_one_schema(empty_database: str) -> None:
    with ThreadPoolExecutor() as pool:
        done = list(pool.map(migrate, [empty_database] * 3))
    assert sorted(m.version_before or "" for m in done) == ["", head_version(), head_version()]
    assert sum(m.behaviour_changed for m in done) == 1
    assert current(empty_database)
    with connect(empty_database) as connection:
        slots = connection.execute(
            "select count(*) from pg_replication_slots where database = current_database()"
        )
        assert slots.fetchone() == (1,)


def test_an_empty_database_is_told_to_migrate(empty_database: str) -> None:
    with (
        one_transaction(empty_database) as connection,
        pytest.raises(DatabaseError, match="no schema") as told,
    ):
        require_current(connection)
    assert "semap db migrate" in told.value.remedy


def test_a_newer_database_is_left_alone(database: str) -> None:
    with connect(database) as connection:
        connection.execute("update semap.schema_version set version_num = '9999'")
        with pytest.raises(DatabaseError, match="9999"):
            migrate(database)
        assert not current(database)


def test_behaviour_that_was_changed_by_hand_or_by_a_version_is_applied_again(database: str) -> None:
    with connect(database) as connection:
        connection.execute("update semap.behaviour set checksum = 'older'")
        connection.execute(
            "create or replace function semap.rule_slot() returns name language sql as $$ select ''::name $$"
        )
        assert migrate(database).behaviour_changed
        assert connection.execute("select semap.rule_slot()::text like 'semap_rules_%'").fetchone() == (True,)


def test_a_function_of_an_earlier_version_does_not_live_on(database: str) -> None:
    with connect(database) as connection:
        connection.execute(
            "create function semap.change_uid(text) returns uuid language sql as $$ select null::uuid $$"
        )
        connection.execute("create function semap.forgotten() returns int language sql as $$ select 1 $$")
        connection.execute(
            "create view public.mine as select track, semap.rule_slot() as slot from semap.relation_now"
        )
        connection.execute("update semap.behaviour set checksum = 'older'")
        triggers = (
            "select tgname, tgrelid::regclass::text from pg_trigger where not tgisinternal order by 1, 2"
        )
        before = connection.execute(triggers).fetchall()
        migrate(database)
        assert connection.execute("select to_regprocedure('semap.forgotten()')").fetchone() == (None,)
        assert connection.execute("select count(*) from pg_proc where proname = 'change_uid'").fetchone() == (
            1,
        )
        assert connection.execute("select count(*) from public.mine").fetchone() == (0,)
        assert connection.execute(triggers).fetchall() == before
        assert current(database)


def test_tables_in_use_hold_up_a_migration_and_it_nobody(
    database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(schema, "LOCK_S", 0.2)
    monkeypatch.setattr(schema, "PAUSE_S", 0.2)
    with connect(database) as holder, connect(database) as reader, ThreadPoolExecutor() as pool:
        holder.execute("update semap.behaviour set checksum = 'older'")
        holder.execute("begin")
        holder.execute("select count(*) from semap.track")
        with patch.object(schema, "ATTEMPTS", 2), pytest.raises(ServerUnavailable, match="in use") as told:
            migrate(database)
        assert "semap db migrate" in told.value.remedy
        assert not current(database)

        migrating = pool.submit(migrate, database)
        reader.execute("set statement_timeout = '1s'")
        for _ in range(20):
            reader.execute("select count(*) from semap.track")
        assert not migrating.done()
        holder.execute("commit")
        assert migrating.result(timeout=PATIENCE_S).behaviour_changed
        assert current(database)


def test_versions_are_those_of_alembic() -> None:
    scripts = ScriptDirectory(str(schema_folder("migrations")))
    assert scripts.get_current_head() == head_version()
    versions = [script.revision for script in scripts.walk_revisions()]
    assert versions == [f"{number:04}" for number in range(len(versions), 0, -1)]
    assert [script.down_revision for script in scripts.walk_revisions()] == [*versions[1:], None]


def test_every_function_and_view_says_what_it_is(database: str) -> None:
    with connect(database) as connection:
        silent = connection.execute(
            "select proname from pg_proc where pronamespace = 'semap'::regnamespace and obj_description(oid) is null"
            " union all select relname from pg_class where relnamespace = 'semap'::regnamespace and relkind = 'v'"
            " and obj_description(oid, 'pg_class') is null"
        ).fetchall()
    assert silent == []
