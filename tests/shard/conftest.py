from collections.abc import Iterator

import pytest
from server import fresh_database

from semap.cluster import Cluster
from semap.store.operate.shards import add_shard


@pytest.fixture
def north(cluster: Cluster, template: str, database: str) -> Iterator[str]:
    """The DSN of a shard of the database."""
    with fresh_database(cluster, template) as dsn:
        add_shard(database, "north", dsn)
        yield dsn
