import os
import ssl
from collections.abc import Iterator
from functools import cache

import pytest
from hypothesis import settings
from left_out import pytest_terminal_summary  # noqa: F401
from server import database_with_slot, fresh_database, make_template, running_cluster
from world import World

from semap.cluster import Cluster

# The same examples in each run, and no clock, so that a change is judged by itself; `./dev test --all` looks for new ones.
settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "steady"))

# Each client of HTTP asks for one, which reads all certificates that the world trusts: half of what it takes to start a
# service for a test and ask it. Nobody changes what is given.
ssl.create_default_context = cache(ssl.create_default_context)


@pytest.fixture(scope="session")
def cluster() -> Iterator[Cluster]:
    """A server of the run's own."""
    with running_cluster() as running:
        yield running


@pytest.fixture
def empty_database(cluster: Cluster) -> Iterator[str]:
    """The DSN of a database in which there is nothing yet."""
    with fresh_database(cluster) as dsn:
        yield dsn


@pytest.fixture(scope="session")
def template(cluster: Cluster) -> str:
    """The name of a migrated database that others are copied from."""
    make_template(cluster, "semap_template")
    return "semap_template"


@pytest.fixture
def database(cluster: Cluster, template: str) -> Iterator[str]:
    """The DSN of a migrated database with its replication slot and nothing in it."""
    with database_with_slot(cluster, template) as dsn:
        yield dsn


@pytest.fixture
def other_database(cluster: Cluster, template: str) -> Iterator[str]:
    """The DSN of another one."""
    with database_with_slot(cluster, template) as dsn:
        yield dsn


@pytest.fixture
def world(database: str) -> Iterator[World]:
    """A map without rooms in a fresh database."""
    made = World(database)
    yield made
    made.close()
