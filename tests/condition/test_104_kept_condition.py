"""Who may say what SQL triggers run for a condition, and how long it is kept."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import psycopg
import pytest
from psycopg.conninfo import make_conninfo
from psycopg.sql import SQL, Identifier
from sqlalchemy import text
from world import World

from semap.errors import InvalidInput, NotPermitted
from semap.model.continuous_query import Declaration, Side
from semap.store.database.connection import connect, one_transaction
from semap.store.operate.schema import migrate
from semap.store.relation.conditions import keep_condition
from semap.store.relation.queries import add_query, change_query, delete_query

WRITERS = ("semap_api", "semap_admin", "semap_api_map")
NAMED = {"op": "like", "args": [{"property": "name"}, "x%"]}
OTHER = {"op": "=", "args": [{"property": "attributes.kind"}, "it's"]}
ASKED = Declaration("asked", "contains", Side("track", where=NAMED), Side("instance", "Room", where=OTHER))
KEPT = "select kind, condition from semap.condition order by kind desc"
FUNCTIONS = r"select count(*) from pg_proc where proname ~ '^condition_[0-9]+$'"


def kept(world: World) -> list[tuple]:
    found = world.rows(KEPT)
    assert world.one(FUNCTIONS) == len(found)
    return found


@contextmanager
def login(world: World, *roles: str) -> Iterator[psycopg.Connection]:
    """One of its own, which sees the map."""
    name = f"writer_{world.map_id}"
    world.run(f"create role {name} login")
    try:
        for role in roles:
            world.run(f"grant {role} to {name}")
        world.run("insert into semap.login_map values (%s::regrole, %s)", name, world.map_id)
        with psycopg.connect(make_conninfo(world.dsn, user=name), autocommit=True) as connection:
            yield connection
    finally:
        world.run("delete from semap.login_map")
        world.run(f"drop role {name}")


def insert(connection: psycopg.Connection, world: World, **columns: object) -> None:
    names = SQL(", ").join(map(Identifier, columns))
    connection.execute(
        SQL("insert into semap.continuous_query (map_id, name, {}) values (%s, 'mine'{})").format(
            names, SQL(", %s") * len(columns)
        ),
        [world.map_id, *columns.values()],
    )


@pytest.mark.parametrize("role", WRITERS)
def test_a_plain_statement_cannot_have_a_condition_that_was_not_compiled(world: World, role: str) -> None:
    update = "update semap.continuous_query set object_where = %s"
    with login(world, role) as writer:
        for asking in (
            lambda: insert(writer, world, subject_where=json.dumps(NAMED)),
            lambda: writer.execute(update, [json.dumps(NAMED)]),
        ):
            with pytest.raises(psycopg.errors.InvalidParameterValue, match="has not been compiled") as told:
                asking()
            assert "semap query add" in (told.value.diag.message_hint or "")
        with one_transaction(world.dsn) as service:
            add_query(service, world.name, ASKED)
        insert(
            writer, world, subject_where=json.dumps(NAMED), subject_condition_id=-1, object_condition_id=-1
        )
    mine = "select subject_condition_id, object_condition_id from semap.continuous_query where name = 'mine'"
    number = world.one("select condition_id from semap.condition where kind = 'track'")
    assert world.rows(mine) == [(number, None)]


SMUGGLED = [
    "select semap.keep_condition(1, 'track', '{}', 'pg_read_file(''/etc/passwd'') is null', '{}')",
    "insert into semap.condition (map_id, kind, condition, said) values (1, 'track', '{}', '{}')",
    "update semap.condition set said = '{}'",
    "delete from semap.condition",
    "set role semap_compile",
    "create function semap.condition_1(text, text, jsonb, text[]) returns boolean language sql as 'select true'",
    "create trigger mine before insert on semap.condition for each row execute function semap.query_refers()",
]


@pytest.mark.parametrize("statement", SMUGGLED)
@pytest.mark.parametrize("role", [*WRITERS, "semap_worker", "semap_ingest", "semap_read"])
def test_nobody_but_the_compiler_says_what_is_run(world: World, role: str, statement: str) -> None:
    with login(world, role) as writer:
        for act in (SQL("reset role"), SQL("set role {}").format(Identifier(role))):
            writer.execute(act)
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                writer.execute(statement.encode())


def test_a_program_of_a_login_of_its_own_is_told_what_it_lacks(world: World) -> None:
    with (
        login(world, "semap_api") as writer,
        pytest.raises(NotPermitted) as told,
        one_transaction(make_conninfo(world.dsn, user=writer.info.user)) as connection,
    ):
        add_query(connection, world.name, ASKED)
    assert "grant semap_compile" in told.value.remedy


def test_who_stores_a_query_acts_on_as_before(world: World) -> None:
    """A token for one map, and no other."""
    with one_transaction(world.dsn) as service:
        service.execute(text("set local role semap_api_map"))
        service.execute(text(f"set local semap.maps = '{{{world.map_id}}}'"))
        query = add_query(service, world.name, ASKED)
        assert service.scalar(text("select current_user")) == "semap_api_map"
        assert query.declaration == ASKED
    assert world.one("select session_user = current_user")


def test_what_another_map_asks_is_not_known_by_what_is_refused(world: World) -> None:
    other = World(world.dsn, "other")
    with one_transaction(world.dsn) as service:
        add_query(service, "other", ASKED)
    for where in (NAMED, OTHER):
        with login(world, "semap_api_map") as writer, pytest.raises(psycopg.errors.InvalidParameterValue):
            insert(writer, world, subject_where=json.dumps(where))
    with login(world, "semap_read_map") as reader:
        assert reader.execute(KEPT).fetchall() == []
    other.close()


def test_a_condition_is_kept_as_long_as_a_query_asks_for_it(world: World) -> None:
    with one_transaction(world.dsn) as service:
        first = add_query(service, world.name, ASKED).query_id
        second = add_query(
            service, world.name, replace(ASKED, name="again", object=Side("instance"))
        ).query_id
    assert kept(world) == [("track", NAMED), ("instance", OTHER)]
    with one_transaction(world.dsn) as service:
        delete_query(service, first)
    assert kept(world) == [("track", NAMED)]
    with one_transaction(world.dsn) as service:
        change_query(service, second, replace(ASKED, name="again", subject=Side("track", where=OTHER)))
    assert kept(world) == [("track", OTHER), ("instance", OTHER)]
    world.run("delete from semap.map where map_id = %s", world.map_id)
    assert kept(world) == []


def test_what_is_refused_leaves_nothing(world: World) -> None:
    wrong = replace(ASKED, object=Side("instance", where={"op": "isA", "args": ["Room"]}))
    with pytest.raises(InvalidInput, match="cannot ask for isA"), one_transaction(world.dsn) as service:
        add_query(service, world.name, wrong)
    assert kept(world) == []


def test_another_version_compiles_again_what_is_kept(world: World) -> None:
    with one_transaction(world.dsn) as service:
        keep_condition(service, world.map_id, "track", NAMED)
    number = world.one("select condition_id from semap.condition")
    older = (
        f"create or replace function semap.condition_{number}(p_name text, p_also text, p_attributes jsonb,"
    )
    world.run(older + " p_said text[]) returns boolean language sql as 'select null::boolean'")
    asked = "select semap.condition_holds(condition_id, said, 'xenia', null, '{}') from semap.condition"
    assert world.one(asked) is False
    world.run("update semap.behaviour set checksum = 'older'")
    migrate(world.dsn, slot=False)
    with connect(world.dsn) as connection:
        assert connection.execute(asked).fetchone() == (True,)
    assert kept(world) == [("track", NAMED)]
