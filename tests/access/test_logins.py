"""A login that was granted a role for some maps, and sets none: another map is to it as if it did not exist.

What it can find out is compared between two databases: one with both maps, and a copy from which the other map was
deleted. Tables, views and functions come from the catalog, so that a new one is asked as well.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import psycopg
import pytest
from guarded import furnish
from psycopg.conninfo import make_conninfo
from server import fresh_database

from semap.cluster import Cluster
from semap.store.database.connection import connect

OF_MAPS = ("semap_read_map", "semap_ingest_map", "semap_api_map")
FORGED = ("", "{1,2}", "{2}", "{NULL}", "{1,NULL}")
"""What such a login might say that its maps are; 1 is `annex`, which it has, and 2 the office."""
SCHEMAS = ["semap", "semap_query", "semap_result"]

SAME_NUMBERS = "select setval(oid::regclass, 100000) from pg_class where relkind = 'S' and relnamespace = 'semap'::regnamespace"
"""What is written next gets the same number, whether the office was deleted or not."""

Outcome = list[str] | str


@dataclass
class Town:
    """A database with `annex` and the office, a copy of it without the office, and what the office had."""

    both: str
    alone: str
    ids: dict[str, int]


@pytest.fixture(scope="module")
def town(cluster: Cluster, template: str) -> Iterator[Town]:
    with fresh_database(cluster, template) as both:
        ids = furnish(both)
        for name in ("annex", "office"):
            enrich(both, name)
        with connect(both) as owner:
            assert owner.execute("select name from semap.map order by map_id").fetchall() == [
                ("annex",),
                ("office",),
            ]
        with fresh_database(cluster, psycopg.conninfo.conninfo_to_dict(both)["dbname"]) as alone:
            with connect(alone) as owner:
                owner.execute("delete from semap.map where name = 'office'")
            for dsn in (both, alone):
                with connect(dsn) as owner:
                    owner.execute(SAME_NUMBERS)
            yield Town(both, alone, ids)


def enrich(dsn: str, name: str) -> None:
    """What `furnish` leaves out: pairs, frames, requests and states that are packed."""
    with connect(dsn) as owner:
        (map_id, source_id) = owner.execute(
            "select map_id, source_id from semap.map join semap.source using (map_id) where semap.map.name = %s", [name]
        ).fetchone() or (0, 0)  # fmt: skip
        owner.execute(
            "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, distance_m)"
            " values (%s, 'near', 'within_distance', 'track', 'track', 3)", [map_id],
        )  # fmt: skip
        owner.execute(
            "insert into semap.progress (worker, lsn) values ('rules', '0/0') on conflict do nothing"
        )
        owner.execute(
            "update semap.progress p set watermarks = jsonb_build_object('given_up', coalesce(p.watermarks -> 'given_up', '{}') ||"
            " jsonb_build_object(r.rule_id, jsonb_build_object('version', r.version, 'attempts', 3, 'first', now())))"
            " from semap.rule r where r.map_id = %s", [map_id],
        )  # fmt: skip
        owner.execute("insert into semap.job (kind, map, file, state, created_by)"
                      " values ('instance_import', %s, '', 'running', 'test')", [name])  # fmt: skip
        owner.execute(
            "insert into semap.query_request (map_id, name, sql) values (%s, 'asked', 'select')", [map_id]
        )
        tracks = [
            owner.execute(
                "insert into semap.track (uid, source_id, map_id, name) values (gen_random_uuid(), %s, %s, %s)"
                " returning track_id", [source_id, map_id, f"{name} {each}"],
            ).fetchone()[0]  # type: ignore[index]
            for each in ("first", "second")
        ]  # fmt: skip
        for stamp in range(20, 24):
            owner.execute(
                "select semap.add_states(%s, to_timestamp(%s), %s, %s::float8[], '{1,2}')",
                [source_id, stamp, tracks, [stamp - 19, 2]],
            )  # fmt: skip


@contextmanager
def login(cluster_dsn: str, *grants: str, attributes: str = "") -> Iterator[str]:
    """A login of the server and a group, of which the name says nothing; both are dropped at the end."""
    name = f"login_{secrets.token_hex(4)}"
    group = f"{name}_map"
    with connect(cluster_dsn) as owner:
        owner.execute(f"create role {name} login {attributes}".encode())
        owner.execute(f"create role {group}".encode())
        try:
            for grant in grants:
                owner.execute(grant.format(login=name, group=group).encode())
            yield name
        finally:
            owner.execute(f"drop role {name}, {group}".encode())


@contextmanager
def of_annex(town: Town, role: str, way: str = "grant {role} to {login}") -> Iterator[str]:
    """A login that is granted a role for some maps, and may see the one map."""
    with login(town.both, *way.replace("{role}", role).split("; ")) as name:
        for dsn in (town.both, town.alone):
            with connect(dsn) as owner:
                owner.execute(
                    "insert into semap.login_map select %s::regrole, map_id from semap.map where name = 'annex'",
                    [name],
                )
        yield name
        for dsn in (town.both, town.alone):
            with connect(dsn) as owner:
                owner.execute("delete from semap.login_map where login = %s::regrole", [name])


def enter(dsn: str, name: str, maps: str | None = None) -> psycopg.Connection:
    connection = connect(make_conninfo(dsn, user=name))
    if maps is not None:
        connection.execute("select set_config('semap.maps', %s, false)", [maps])
    return connection


def outcome(connection: psycopg.Connection, statement: str) -> Outcome:
    """The rows of a statement, or how it was refused; nothing of it stays."""
    try:
        with connection.transaction(force_rollback=True):
            return sorted(str(row) for row in connection.execute(statement.encode()).fetchall())
    except psycopg.Error as error:
        return f"{error.sqlstate} {error.diag.message_primary}"


def relations(connection: psycopg.Connection) -> list[str]:
    return [
        name
        for (name,) in connection.execute(
            "select oid::regclass::text from pg_class where relnamespace = any (%s::regnamespace[])"
            " and relkind in ('r', 'p', 'v', 'm', 'S') order by 1",
            [SCHEMAS],
        )
    ]


WAYS = (
    "grant {role} to {login}",
    "grant {role} to {group}; grant {group} to {login}",
    "grant {role} to {group}; alter role {group} noinherit; grant {group}, {role} to {login}",
)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("role", OF_MAPS)
def test_another_map_is_in_no_table_and_in_no_view(town: Town, role: str, way: str) -> None:
    with (
        connect(town.alone) as owner,
        of_annex(town, role, way) as name,
        enter(town.both, name) as beside,
        enter(town.alone, name) as alone,
    ):
        shown = 0
        for each in relations(owner):
            statement = f"select t::text from {each} t"
            seen = outcome(alone, statement)
            assert outcome(beside, statement) == seen, each
            if isinstance(seen, list):
                shown += len(seen)
        assert shown > 100
        for each in ("semap.track", "semap.track_place", "semap_query.instance"):
            statement = f"select t::text from {each} t"
            assert outcome(alone, statement) == outcome(owner, statement) != []


ANNEX, BOTH = [1], None


@pytest.mark.parametrize(
    ("grants", "attributes", "role", "told", "sees"),
    [
        ((), "", None, None, ANNEX),  # of no role at all: it has no rights, and no maps but its own
        (("grant semap_read_map to {login}",), "", None, None, ANNEX),
        (("grant semap_read_map to {login}",), "", "semap_read_map", None, ANNEX),
        (("grant semap_read_map to {login}",), "", "semap_read_map", "{1,2}", ANNEX),
        (("grant semap_read_map to {login}",), "noinherit", "semap_read_map", "{2}", []),
        (("grant semap_read to {group}", "grant {group} to {login}"), "", "{login}_map", None, BOTH),
        (("grant semap_read to {login}",), "", None, None, BOTH),
        (("grant semap_read, semap_read_map to {login}",), "", None, None, BOTH),
        (("grant semap_read, semap_read_map to {login}",), "", "semap_read_map", None, []),
        (("grant semap_read, semap_read_map to {login}",), "", "semap_read_map", "{2}", [2]),
        # has the rights of neither until it sets one
        (("grant semap_read, semap_read_map to {login}",), "noinherit", None, None, []),
        (("grant semap_read, semap_read_map to {login}",), "noinherit", "semap_read", None, BOTH),
        (("grant semap_read to {group}", "grant {group} to {login}"), "", None, None, BOTH),
        ((), "superuser", None, None, BOTH),
        ((), "superuser", "semap_api_map", None, []),
        ((), "superuser", "semap_api_map", "{1}", [1]),
        ((), "superuser", "semap_read", "{1}", [1]),  # the service, for what needs every row of one map
    ],
)  # fmt: skip
def test_what_counts_is_the_role_that_was_set_else_the_login(
    town: Town,
    grants: tuple[str, ...],
    attributes: str,
    role: str | None,
    told: str | None,
    sees: list[int] | None,
) -> None:
    """Within a function that acts for its owner as without one; each login here may see the annex, if not more."""
    with login(town.both, *grants, attributes=attributes) as name, connect(town.both) as owner:
        owner.execute("insert into semap.login_map values (%s::regrole, 1)", [name])
        owner.execute("grant usage on schema semap to public")
        owner.execute("grant execute on function semap.visible_maps to public")
        try:
            with enter(town.both, name, told) as connection:
                connection.execute(f"set role {role or 'none'}".format(login=name).encode())
                assert connection.execute("select semap.visible_maps()").fetchone() == (sees,)
        finally:
            owner.execute("revoke usage on schema semap from public")
            owner.execute("revoke execute on function semap.visible_maps from public")
            owner.execute("delete from semap.login_map")


@pytest.mark.parametrize("maps", FORGED)
def test_a_login_cannot_say_itself_which_maps_it_sees(town: Town, maps: str) -> None:
    """It may narrow what it sees, and no more."""
    with (
        connect(town.alone) as owner,
        of_annex(town, "semap_read_map") as name,
        enter(town.both, name, maps) as beside,
        enter(town.alone, name, maps) as alone,
    ):
        for each in relations(owner):
            assert outcome(beside, f"select t::text from {each} t") == outcome(
                alone, f"select t::text from {each} t"
            )
        tracks = "select distinct map_id from semap.track"
        assert outcome(beside, tracks) == (["(1,)"] if "1" in maps or maps == "" else [])


def test_no_function_tells_of_another_map(town: Town) -> None:
    """Each is called with what the office had, in every argument that may take it."""
    grants = [f"grant {role} to {{login}}" for role in OF_MAPS]
    with (
        connect(town.both) as owner,
        of_annex(town, "semap_read_map", "; ".join(grants)) as name,
        enter(town.both, name) as beside,
        enter(town.alone, name) as alone,
    ):
        called = answered = 0
        for call in calls(owner, office_keys(owner)):
            seen = outcome(alone, call)
            assert outcome(beside, call) == seen, call
            called += 1
            answered += isinstance(seen, list)
        assert called > answered > 1000


def office_keys(owner: psycopg.Connection) -> dict[str, int]:
    """The greatest value of each column of whole numbers in each table, of those rows that are the office's."""
    keys = {}
    for table, column in owner.execute(
        "select a.attrelid::regclass::text, a.attname::text from pg_attribute a join pg_class c on c.oid = a.attrelid"
        " where c.relnamespace = 'semap'::regnamespace and c.relkind in ('r', 'p') and not c.relispartition"
        " and a.attnum > 0 and not a.attisdropped and a.atttypid = any ('{int4,int8}'::regtype[])"
        " and a.attname ~ '(_id|^seq)$' and exists (select from pg_attribute m where m.attrelid = a.attrelid"
        " and m.attname = 'map_id' and not m.attisdropped)"
    ).fetchall():
        query = f"select max({column}) from {table} where map_id = (select map_id from semap.map where name = 'office')"
        (value,) = owner.execute(query.encode()).fetchone() or (None,)
        if value is not None:
            keys[column] = value
    return keys


NAMES_THE_DATABASE = {"semap.rule_slot"}


def calls(owner: psycopg.Connection, keys: dict[str, int]) -> Iterator[str]:
    """Each function that is no trigger's, with the office's keys by the names of its arguments, and each key everywhere."""
    for name, kind, types, names in owner.execute(
        "select oid::regproc::text, prokind::text, array(select t::regtype::text from unnest(proargtypes) t),"
        " coalesce(proargnames, '{}') from pg_proc where pronamespace = any (%s::regnamespace[])"
        " and prorettype <> 'trigger'::regtype and not 'internal'::regtype = any (proargtypes) order by 1, 3",
        [SCHEMAS],
    ).fetchall():
        if name in NAMES_THE_DATABASE:
            continue
        said = list(zip(types, [*names, *[""] * len(types)], strict=False))
        for everywhere in [None, *sorted(set(keys.values()))] if said else [None]:
            arguments = ", ".join(value(owner, type_, word, keys, everywhere) for type_, word in said)
            if kind == "p":
                yield f"call {name}({arguments})"
            else:
                yield f"select {name}({arguments})::text"


def value(
    owner: psycopg.Connection, type_: str, word: str, keys: dict[str, int], everywhere: int | None
) -> str:
    """An argument: what belongs to the office where the type has room for it."""
    element = type_.removesuffix("[]")
    ids = {key: id_ if everywhere is None else everywhere for key, id_ in keys.items()}
    if element in ("integer", "bigint", "smallint"):
        named = word.removeprefix("p_").removesuffix("s")
        one = f"{ids.get(named, ids['instance_id'])}::{element}"
    elif element in ("text", "name"):
        one = f"{TEXTS.get(word, 'office')!r}::{element}"
    elif element == "timestamp with time zone":
        is_begin = any(each in word for each in ("from", "since", "after", "before"))
        one = "'-infinity'::timestamptz" if is_begin else "'infinity'::timestamptz"
    elif element in VALUES:
        one = f"{VALUES[element]}::{element}"
    elif element.startswith("semap."):
        fields = ", ".join(f"'{key}', {id_}" for key, id_ in ids.items())
        one = f"jsonb_populate_record(null::{element}, jsonb_build_object({fields}))"
    else:
        one = f"null::{element}"
    return f"array[{one}]" if type_ != element else one


TEXTS = {"p_table": "instance", "p_name": "track_in_room", "p_query": "track_in_room", "p_abstraction": "Footprint",
         "p_sql": "select t.id from semap_query.track t, semap_query.room r where semap_query.is_in(t, r)"}  # fmt: skip
VALUES = {
    "double precision": "1", "real": "1", "boolean": "true", "jsonb": "'{}'", "interval": "'1 s'", "date": "'1970-01-01'",
    "geometry": "public.st_makeenvelope(-100, -100, 100, 100)", "record": "(select t from semap_query.track t limit 1)",
}  # fmt: skip


@pytest.mark.parametrize(
    "statement",
    [
        "select * from semap.instance",
        "select * from semap.track_place",
        "select * from semap_query.track",
        "select * from semap.event_evidence",
    ],
)
def test_which_maps_there_are_is_asked_once_for_a_statement(town: Town, statement: str) -> None:
    """Not for each row: whatever asks is an InitPlan."""
    with of_annex(town, "semap_read_map") as name, enter(town.both, name) as connection:
        (plan,) = connection.execute(f"explain (verbose, format json) {statement}".encode()).fetchone() or (
            [],
        )
    nodes = [plan[0]["Plan"]]
    asking = []
    for node in nodes:
        nodes += node.get("Plans", [])
        said = {key: value for key, value in node.items() if key != "Plans"}
        if "visible_maps()" in str(said):
            asking.append(said["Parent Relationship"])
    assert set(asking) == {"InitPlan"}
