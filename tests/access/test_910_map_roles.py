"""Row-level security: what PostgreSQL itself lets a role do that is restricted to maps."""

from __future__ import annotations

from collections.abc import Iterator

import psycopg
import pytest
from guarded import Building
from psycopg.sql import SQL, Identifier

from semap.schema_files import schema_folder
from semap.store.database.connection import connect

OF_MAPS = ("semap_read_map", "semap_ingest_map", "semap_api_map")
SHARED = {"predicate", "concept", "concept_parent", "concept_iri", "behaviour", "schema_version", "kept_table", "progress",
          "retention"}  # fmt: skip
HIDDEN = {"token", "token_map", "webhook", "webhook_secret", "webhook_dead_letter"}
UNREADABLE = HIDDEN | {
    "job", "login_map", "line_observation", "track_state", "state_chunk", "region_cell", "region_edge", "rule_state", "collected", "pending_row",
    "region_wanted", "query_side", "query_predicate", "side_track", "query_track_wanted",
    "pair_side", "pair_instance_wanted", "pair_track_wanted", "pair_reach", "track_side",
    "stored_state", "unflushed_state", "late_state", "reading_due", "shard",
}  # fmt: skip


@pytest.mark.parametrize(
    "hidden", ["seq from semap.event", "lsn from semap.progress", "event_seq from semap.progress",
               "updated_at from semap.progress", "* from semap.event"]
)  # fmt: skip
@pytest.mark.parametrize("role", OF_MAPS)
def test_what_counts_the_events_of_all_maps_cannot_be_read(
    building: Building, role: str, hidden: str
) -> None:
    with (
        entered(building.service.dsn, role, "{1}") as connection,
        pytest.raises(psycopg.errors.InsufficientPrivilege),
    ):
        connection.execute(f"select {hidden}")


@pytest.fixture
def owner(building: Building) -> Iterator[psycopg.Connection]:
    with connect(building.service.dsn) as connection:
        yield connection


def entered(dsn: str, role: str, maps: str | None) -> psycopg.Connection:
    connection = connect(dsn, role)
    if maps is not None:
        connection.execute("select set_config('semap.maps', %s, false)", [maps])
    return connection


def tables(owner: psycopg.Connection) -> list[str]:
    return [
        name
        for (name,) in owner.execute(
            "select relname::text from pg_class where relnamespace = 'semap'::regnamespace"
            " and relkind in ('r', 'p', 'v') and not relispartition order by 1"
        )
    ]


def rows(connection: psycopg.Connection, table: str) -> int:
    found = connection.execute(SQL("select count(*) from semap.{}").format(Identifier(table))).fetchone()
    assert found is not None
    return found[0]


def map_of(owner: psycopg.Connection, name: str) -> int:
    found = owner.execute("select map_id from semap.map where name = %s", [name]).fetchone()
    assert found is not None
    return found[0]


@pytest.mark.parametrize("role", OF_MAPS)
def test_each_table_is_shared_or_kept_within_the_maps(
    building: Building, owner: psycopg.Connection, role: str
) -> None:
    """Of every table that has rows, half belong to `annex`; a new table has to be put into one of these sets."""
    dsn = building.service.dsn
    annex, office = map_of(owner, "annex"), map_of(owner, "office")
    assert annex != office
    with (
        entered(dsn, role, None) as nowhere,
        entered(dsn, role, f"{{{annex}}}") as one,
        entered(dsn, role, f"{{{office}}}") as other,
        entered(dsn, role, f"{{{annex},{office}}}") as both,
    ):
        for table in tables(owner):
            if table in UNREADABLE:
                with pytest.raises(psycopg.errors.InsufficientPrivilege):
                    rows(one, table)
                continue
            if table in SHARED:
                continue
            assert rows(nowhere, table) == 0, table
            assert rows(one, table) + rows(other, table) == rows(both, table), table
        for table in ("instance", "track", "event", "abstraction", "row_version", "event_evidence"):
            assert rows(one, table) > 0, table
            assert rows(other, table) > 0, table


@pytest.mark.parametrize("role", ["semap_read", "semap_ingest", "semap_worker", "semap_api", "semap_admin"])
def test_all_others_see_every_row(building: Building, owner: psycopg.Connection, role: str) -> None:
    with connect(building.service.dsn, role) as connection:
        for table in tables(owner):
            if table not in HIDDEN or role == "semap_admin":
                assert rows(connection, table) == rows(owner, table), table


REFUSED = {
    "semap_read_map": [
        "update semap.instance set alias = 'x'", "delete from semap.map", "insert into semap.source (map_id, name)"
        " values (%(annex)s, 'x')",
    ],
    "semap_ingest_map": [
        "insert into semap.source (map_id, name) values (%(office)s, 'x')", "delete from semap.source",
        "update semap.instance set alias = 'x'",
        "insert into semap.track_state (track_id, stamp, x_m, y_m) values (1, now(), 0, 0)",
    ],
    "semap_api_map": [
        "insert into semap.frame (map_id, name) values (%(office)s, 'x')",
        "insert into semap.map (name, uid) values ('x', gen_random_uuid())",
        "insert into semap.concept (name) values ('x')", "update semap.concept set comment = 'x'",
        "update semap.instance set map_id = %(office)s",
        "insert into semap.token (name, hash, hint, scopes, all_maps, created_by) values ('x', '', '', '{}', true, '')",
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("role", "statement"), [(role, each) for role, statements in REFUSED.items() for each in statements]
)
def test_a_write_beyond_the_maps_is_refused(
    building: Building, owner: psycopg.Connection, role: str, statement: str
) -> None:
    ids = {name: map_of(owner, name) for name in ("annex", "office")}
    with (
        entered(building.service.dsn, role, f"{{{ids['annex']}}}") as connection,
        pytest.raises(psycopg.errors.InsufficientPrivilege),
        connection.transaction(),
    ):
        connection.execute(statement, ids)


def test_a_write_without_a_where_stays_within_the_maps(building: Building, owner: psycopg.Connection) -> None:
    annex = map_of(owner, "annex")
    with entered(building.service.dsn, "semap_api_map", f"{{{annex}}}") as connection:
        with connection.transaction(force_rollback=True):
            changed = connection.execute("update semap.instance set alias = 'x' returning map_id").fetchall()
            assert set(changed) == {(annex,)}
        with connection.transaction(force_rollback=True):
            assert connection.execute("delete from semap.map returning map_id").fetchall() == [(annex,)]


def test_a_change_of_another_map_cannot_be_undone(building: Building, owner: psycopg.Connection) -> None:
    """The function acts for its owner, who sees every row."""
    annex = map_of(owner, "annex")
    with (
        entered(building.service.dsn, "semap_api_map", f"{{{annex}}}") as connection,
        pytest.raises(psycopg.errors.NoDataFound),
    ):
        connection.execute("select semap.undo_change_set(%s)", [building.ids["change"]])


def test_functions_that_act_for_their_owner_are_called_by_those_they_are_for(
    owner: psycopg.Connection,
) -> None:
    """Roles for some maps may call these only, which look at the maps themselves, or at nothing of a map."""
    open_to = {
        name
        for (name,) in owner.execute(
            "select p.proname::text from pg_proc p, unnest(%s::text[]) role"
            " where p.pronamespace = 'semap'::regnamespace and p.prosecdef"
            " and has_function_privilege(role, p.oid, 'execute')",
            [list(OF_MAPS)],
        )
    }
    assert open_to <= {"undo_change_set", "finish_job", "concepts_as_of", "visible_maps", *STATES}


STATES = {
    "states": "semap.states(array[%(track)s], '-infinity', 'infinity')",
    "states_around": "semap.states_around(%(track)s, 'infinity', 1, 0)",
    "states_of_map": "semap.states_of_map(%(map)s, '-infinity', 'infinity')",
    "first_state_of_map": "(select semap.first_state_of_map(%(map)s) as stamp) f where stamp is not null",
}


@pytest.mark.parametrize("function", STATES)
@pytest.mark.parametrize(("maps", "is_there"), [(None, False), ("annex", False), ("office", True)])
def test_states_are_told_to_whom_their_map_is_open(
    building: Building, owner: psycopg.Connection, function: str, maps: str | None, is_there: bool
) -> None:
    told = None if maps is None else f"{{{map_of(owner, maps)}}}"
    with entered(building.service.dsn, "semap_read_map", told) as connection:
        found = connection.execute(f"select * from {STATES[function]}", building.ids).fetchall()
    assert bool(found) is is_there


def test_compacted_states_are_told_to_whom_their_map_is_open(
    building: Building, owner: psycopg.Connection
) -> None:
    """The same functions, over states that are compacted."""
    annex, office = map_of(owner, "annex"), map_of(owner, "office")
    with owner.transaction(force_rollback=True):
        owner.execute("select semap.compact_all(array(select source_id from semap.source))")
        seen = {}
        for maps in (annex, office):
            owner.execute("set local role semap_read_map")
            owner.execute("select set_config('semap.maps', %s, true)", [f"{{{maps}}}"])
            told = {name: bool(owner.execute(f"select * from {each}", building.ids | {"map": office}).fetchall())
                    for name, each in STATES.items()}  # fmt: skip
            seen[maps] = told
            owner.execute("reset role")
        assert seen[annex] == dict.fromkeys(STATES, False)
        assert seen[office] == dict.fromkeys(STATES, True)


def test_no_view_shows_what_its_reader_may_not_see(owner: psycopg.Connection) -> None:
    """A view has its owner's rights unless it says otherwise: roles for some maps may read these only."""
    readable = {
        name
        for (name,) in owner.execute(
            "select c.relname::text from pg_class c, unnest(%s::text[]) role"
            " where c.relnamespace = 'semap'::regnamespace and c.relkind in ('v', 'm')"
            " and has_table_privilege(role, c.oid, 'select')"
            " and not coalesce('security_invoker=true' = any (c.reloptions), false)",
            [list(OF_MAPS)],
        )
    }
    assert readable == {"kept_table", "rule_given_up", "track_place"}


PLANNED = (
    "select * from semap.instance where instance_id = 1",
    "select * from semap.abstraction where type = 'Footprint' and instance_id is not null"
    " and geometry && 'POLYGON((0 0,1 0,1 1,0 1,0 0))'",
    "select * from semap.event where seq > 5 order by seq limit 10",
    "select * from semap.track t join semap.track_now n using (track_id) where t.map_id = 1 and t.name = 'x'",
)


@pytest.mark.parametrize("statement", PLANNED)
def test_a_policy_for_every_map_leaves_the_plan_as_it_is(
    building: Building, owner: psycopg.Connection, statement: str
) -> None:
    def plan(connection: psycopg.Connection) -> list[tuple[str]]:
        connection.execute("set enable_seqscan = off")
        return connection.execute(f"explain (costs off) {statement}").fetchall()

    with connect(building.service.dsn, "semap_read") as connection:
        assert plan(connection) == plan(owner)


def test_policies_that_are_there_already_are_left_alone(
    building: Building, owner: psycopg.Connection
) -> None:
    """To alter a table is to wait for all who read it, and they may wait for one another."""
    behaviour = schema_folder("sql") / "910_access.sql"
    with (
        connect(building.service.dsn) as reader,
        reader.transaction(),
        owner.transaction(force_rollback=True),
    ):
        reader.execute("select count(*) from semap.event")
        owner.execute("set local lock_timeout = '2s'")
        owner.execute(behaviour.read_text().encode())
