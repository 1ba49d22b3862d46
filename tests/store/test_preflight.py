from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import cast

import psycopg
import pytest
from psycopg.conninfo import make_conninfo
from psycopg.sql import SQL, Identifier
from server import SETTINGS, fresh_database, reachable_folder
from sqlalchemy import Connection

from semap.cluster import Cluster, lease
from semap.errors import ServerUnfit
from semap.store.database.connection import one_transaction
from semap.store.operate.preflight import ROLES, examine, require_fit


@pytest.fixture(scope="module")
def users_server() -> Iterator[Cluster]:
    """A server of its own, since roles belong to a whole server and other tests make those of semap."""
    with reachable_folder() as folder, lease(folder, SETTINGS) as running:
        yield running


@pytest.fixture
def database(users_server: Cluster) -> Iterator[str]:
    with fresh_database(users_server) as dsn:
        yield dsn


@contextmanager
def superuser(dsn: str, *statements: str) -> Iterator[psycopg.Connection]:
    with psycopg.connect(dsn, autocommit=True) as session:
        for statement in statements:
            session.execute(SQL(statement))
        yield session


@contextmanager
def roles(dsn: str, **attributes: str) -> Iterator[None]:
    """Roles for the length of a test, by name with their attributes."""
    with superuser(
        dsn, *(f'create role "{name}" login {options}' for name, options in attributes.items())
    ) as session:
        try:
            yield
        finally:
            for name in attributes:
                session.execute(SQL("drop owned by {0} cascade").format(Identifier(name)))
            for name in attributes:
                session.execute(SQL("drop role {}").format(Identifier(name)))


def found(dsn: str, role: str = "postgres") -> list[tuple[str, str]]:
    with one_transaction(make_conninfo(dsn, user=role)) as connection:
        return examine(connection)


def name_of(dsn: str) -> str:
    with superuser(dsn) as session:
        return session.info.dbname


def test_a_superuser_lacks_nothing(database: str) -> None:
    assert found(database) == []
    with one_transaction(database) as connection:
        require_fit(connection)


def test_everything_a_plain_role_lacks_is_said_at_once(database: str) -> None:
    name = name_of(database)
    with roles(database, **{"Ada L.": ""}):
        expected = [
            ('the right of "Ada L." to replicate', 'ALTER ROLE "Ada L." REPLICATION;'),
            (
                f'PostGIS in the database {name}, where "Ada L." may not install it',
                f"As a superuser, in the database {name}: CREATE EXTENSION postgis SCHEMA public;",
            ),
            (
                f'the right of "Ada L." to create a schema in {name}',
                f'GRANT CREATE ON DATABASE {name} TO "Ada L.";',
            ),
            (
                f'the roles {", ".join(ROLES)}, which "Ada L." may not create',
                f'ALTER ROLE "Ada L." CREATEROLE; or {" ".join(f"CREATE ROLE {role};" for role in ROLES)} '
                f'GRANT {", ".join(ROLES)} TO "Ada L.";',
            ),
        ]
        assert found(database, "Ada L.") == expected
        with (
            one_transaction(make_conninfo(database, user="Ada L.")) as connection,
            pytest.raises(ServerUnfit) as unfit,
        ):
            require_fit(connection)
        assert unfit.value.findings == tuple(expected)


def test_the_remedies_help(database: str) -> None:
    with roles(database, ada=""):
        for lack, remedy in found(database, "ada"):
            statements = remedy.removeprefix(f"As a superuser, in the database {name_of(database)}: ")
            with superuser(database, statements.split(" or ")[0]):
                assert lack not in [remaining for remaining, _ in found(database, "ada")]
        assert found(database, "ada") == []


def test_roles_that_somebody_else_made(database: str) -> None:
    names = ", ".join(sorted(ROLES))
    with (
        roles(database, ada="replication", **dict.fromkeys(ROLES, "")),
        superuser(
            database, "create extension postgis", f"grant create on database {name_of(database)} to ada"
        ) as admin,
    ):
        [(lack, remedy)] = found(database, "ada")
        assert lack.startswith("membership of ada in ")
        assert ", ".join(sorted(lack.removeprefix("membership of ada in ").split(", "))) == names
        admin.execute(SQL(remedy))
        assert found(database, "ada") == []


def test_a_right_to_make_roles_is_enough(database: str) -> None:
    with (
        roles(database, ada="replication createrole"),
        superuser(
            database, "create extension postgis", f"grant create on database {name_of(database)} to ada"
        ),
    ):
        assert found(database, "ada") == []


def test_postgis_in_another_schema(database: str) -> None:
    with superuser(database, "create schema gis", "create extension postgis schema gis"):
        assert found(database) == [
            (
                "PostGIS in the schema public (it is in gis)",
                "PostGIS cannot be moved. In another database: CREATE EXTENSION postgis SCHEMA public;",
            )
        ]


def test_a_schema_that_belongs_to_somebody_else(database: str) -> None:
    with (
        roles(database, ada="replication createrole", bob=""),
        superuser(
            database,
            "create extension postgis",
            f"grant create on database {name_of(database)} to ada",
            "create schema semap authorization bob",
        ) as admin,
    ):
        assert found(database, "ada") == [
            ("ownership of the schema semap (it belongs to bob)", "Connect as bob, or GRANT bob TO ada;")
        ]
        admin.execute("grant bob to ada")
        assert found(database, "ada") == []


def test_a_database_that_is_not_in_utf8(users_server: Cluster) -> None:
    ascii_only = "create database ascii_only template template0 encoding 'SQL_ASCII' locale 'C'"
    with superuser(users_server.dsn("postgres"), ascii_only):
        [(lack, _)] = found(users_server.dsn("ascii_only"))
    users_server.drop_database("ascii_only")
    assert lack == "a database in UTF8 (this one is in SQL_ASCII)"


def test_settings_that_need_a_restart() -> None:
    settings = {"wal_level": "replica", "max_wal_senders": "0", "max_replication_slots": "1"}
    with reachable_folder() as folder, lease(folder, {**SETTINGS, **settings}) as cluster:
        dsn = cluster.dsn("postgres")
        wal_level = (
            "wal_level = logical (it is replica)",
            "ALTER SYSTEM SET wal_level = logical; and restart the server.",
        )
        senders = (
            "max_wal_senders above 0",
            "ALTER SYSTEM SET max_wal_senders = 10; and restart the server.",
        )
        slot = (
            "a free replication slot (all 1 are taken)",
            "ALTER SYSTEM SET max_replication_slots = 9; and restart the server, or drop an unread slot.",
        )
        assert found(dsn) == [wal_level, senders]
        with superuser(dsn, "select pg_create_physical_replication_slot('standby')"):
            assert found(dsn) == [wal_level, slot, senders]


def test_semaps_own_slot_is_no_obstacle() -> None:
    with reachable_folder() as folder, lease(folder, {**SETTINGS, "max_replication_slots": "1"}) as cluster:
        dsn = cluster.dsn("postgres")
        cluster.create_database("other")
        with superuser(dsn, "select pg_create_logical_replication_slot('semap_rule', 'pgoutput')"):
            assert found(dsn) == []
            assert [lack for lack, _ in found(cluster.dsn("other"))] == [
                "a free replication slot (all 1 are taken)"
            ]


def test_an_old_server_is_not_asked_for_the_rest() -> None:
    old = SimpleNamespace(dialect=SimpleNamespace(server_version_info=(14, 11)))
    assert examine(cast(Connection, old)) == [
        (
            "PostgreSQL 15 or newer (this is 14)",
            "Upgrade the server to PostgreSQL 15 or newer.",
        )
    ]
