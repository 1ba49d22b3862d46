"""An owner who is no superuser, with the rights that docs/operations.md gives, has all of semap."""

from __future__ import annotations

from collections.abc import Iterator

import psycopg
import pytest
from psycopg.conninfo import make_conninfo
from server import SETTINGS, reachable_folder
from shapely import box

from semap.cluster import lease
from semap.store.database.connection import connect, one_transaction
from semap.store.operate.preflight import ROLES, examine
from semap.store.operate.schema import is_current, migrate


@pytest.fixture(scope="module")
def owned() -> Iterator[str]:
    """The DSN of such an owner, on a server of its own, since roles belong to a whole server."""
    with reachable_folder() as folder, lease(folder, SETTINGS) as cluster:
        cluster.create_database("owned")
        with psycopg.connect(cluster.dsn("owned"), autocommit=True) as superuser:
            superuser.execute("create role ada login createrole replication")
            superuser.execute("alter database owned owner to ada")
            superuser.execute("create extension postgis")
        dsn = make_conninfo(cluster.dsn("owned"), user="ada")
        migrate(dsn)
        yield dsn


def test_nothing_is_missing_and_migrating_again_changes_nothing(owned: str) -> None:
    with one_transaction(owned) as connection:
        assert examine(connection) == []
        assert is_current(connection)
    assert not migrate(owned).behaviour_changed


@pytest.mark.parametrize("role", ROLES)
def test_it_may_act_as_each_role(owned: str, role: str) -> None:
    with connect(owned, role) as connection:
        assert connection.execute("select current_user").fetchone() == (role,)


def test_a_map_without_an_anchor_lies_on_the_globe(owned: str) -> None:
    """Where the equator meets the prime meridian, by a projection that is PostGIS's own."""
    with connect(owned, "semap_read") as connection:
        asked = "select st_asewkb(semap.from_globe(semap.on_globe(%s::public.geometry, null, null, 4326), null, null))"
        (there_and_back,) = connection.execute(asked, [box(1, 2, 300, 400).wkb_hex]).fetchone() or (None,)
        same = "select st_hausdorffdistance(%s::public.geometry, %s::public.geometry) < 1e-6"
        assert connection.execute(same, [there_and_back.hex(), box(1, 2, 300, 400).wkb_hex]).fetchone() == (
            True,
        )
