"""A PostGIS server for the tests: one cluster for the whole run, one database for a test."""

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg
from psycopg.conninfo import make_conninfo
from psycopg.sql import SQL, Identifier

from semap.cluster import Cluster, lease
from semap.cluster.cluster import SUPERUSER
from semap.store.database.connection import connect
from semap.store.operate.rule_slot import ensure_slot
from semap.store.operate.schema import migrate

# The tests kill processes, never the machine, so only the synchronisation to the disk is left out:
# synchronous_commit stays on, because what a client may rely on after its commit is under test.
# The log is kept small, since it lies in memory; PostGIS is loaded once, which each session would take 10 ms for.
SETTINGS = {
    "fsync": "off",
    "shared_buffers": "64MB",
    "max_wal_size": "512MB",
    "shared_preload_libraries": "postgis-3",
}

OWNER = os.environ.get("SEMAP_TEST_OWNER", SUPERUSER)
"""Who owns the databases. Another name is that of a role made with the rights that docs/operations.md gives."""

# Linux's file system in memory. A database of the tests lives for a second and has 700 files: on a disk, making
# and dropping it takes the processor five times as long.
MEMORY = Path("/dev/shm")
ROOM_OF_A_CLUSTER = 2 << 30


def _roomy_memory() -> Path | None:
    """Where folders of the server are made instead of on the disk; None where there is too little of it."""
    clusters = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if (
        not os.access(MEMORY, os.W_OK | os.X_OK)
        or shutil.disk_usage(MEMORY).free < clusters * ROOM_OF_A_CLUSTER
    ):
        return None
    return MEMORY


@contextmanager
def reachable_folder() -> Iterator[Path]:
    """An empty folder that the server's user may pass, as pytest's own tmp_path is not; gone at the end."""
    # Short, so that the socket fits in; resolved, since macOS has its temporary folder behind a link.
    folder = Path(tempfile.mkdtemp(prefix="semap-test-", dir=_roomy_memory())).resolve()
    folder.chmod(0o711)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def running_cluster() -> Iterator[Cluster]:
    with reachable_folder() as folder, lease(folder, SETTINGS) as cluster:
        yield cluster


def make_template(cluster: Cluster, name: str) -> None:
    """A migrated database to copy."""
    cluster.create_database(name)
    if OWNER != SUPERUSER:
        with psycopg.connect(cluster.dsn(name), autocommit=True) as superuser:
            superuser.execute(SQL("create role {} login createrole replication").format(Identifier(OWNER)))
            superuser.execute(
                SQL("alter database {} owner to {}").format(Identifier(name), Identifier(OWNER))
            )
            superuser.execute("create extension postgis")
            # for tests that write past the triggers
            superuser.execute(
                SQL("grant set on parameter session_replication_role to {}").format(Identifier(OWNER))
            )
    migrate(make_conninfo(cluster.dsn(name), user=OWNER), slot=False)


@contextmanager
def fresh_database(cluster: Cluster, template: str | None = None) -> Iterator[str]:
    """The DSN of a new database, which is dropped at the end with whatever sessions it still has.

    A copy belongs to OWNER, as what it is a copy of, and the DSN is theirs; an empty one is the superuser's.
    """
    name = f"test_{secrets.token_hex(6)}"
    cluster.create_database(name, template)
    try:
        if template is None or OWNER == SUPERUSER:
            yield cluster.dsn(name)
        else:
            with psycopg.connect(cluster.dsn("postgres"), autocommit=True) as superuser:
                superuser.execute(
                    SQL("alter database {} owner to {}").format(Identifier(name), Identifier(OWNER))
                )
            yield make_conninfo(cluster.dsn(name), user=OWNER)
    finally:
        cluster.drop_database(name)


@contextmanager
def database_with_slot(cluster: Cluster, template: str) -> Iterator[str]:
    """The same, with the replication slot that a worker reads."""
    with fresh_database(cluster, template) as dsn:
        with connect(dsn) as connection:
            ensure_slot(connection)
        yield dsn


def ask_in_parallel(connection: psycopg.Connection) -> None:
    """Until the transaction ends, plans are parallel wherever they may be."""
    since_16 = connection.info.server_version >= 160_000
    connection.execute(
        SQL("set local {} = on").format(
            Identifier("debug_parallel_query" if since_16 else "force_parallel_mode")
        )
    )
