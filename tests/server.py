"""A PostGIS server for the tests: one cluster for the whole run, one database for a test."""

import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from semap.cluster import Cluster, lease

# The tests kill processes, never the machine, so only the synchronisation to the disk is left out:
# synchronous_commit stays on, because what a client may rely on after its commit is under test.
SETTINGS = {"fsync": "off", "shared_buffers": "64MB"}


@contextmanager
def reachable_folder() -> Iterator[Path]:
    """An empty folder that the server's user may pass, as pytest's own tmp_path is not; gone at the end."""
    # Short, so that the socket fits in; resolved, since macOS has its temporary folder behind a link.
    folder = Path(tempfile.mkdtemp(prefix="semap-test-")).resolve()
    folder.chmod(0o711)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def running_cluster() -> Iterator[Cluster]:
    with reachable_folder() as folder, lease(folder, SETTINGS) as cluster:
        yield cluster


@contextmanager
def fresh_database(cluster: Cluster, template: str | None = None) -> Iterator[str]:
    """The DSN of a new database, which is dropped at the end with whatever sessions it still has."""
    name = f"test_{secrets.token_hex(6)}"
    cluster.create_database(name, template)
    try:
        yield cluster.dsn(name)
    finally:
        cluster.drop_database(name)
