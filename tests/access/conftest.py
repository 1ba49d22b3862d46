from collections.abc import Iterator

import pytest
from guarded import Building, furnish, give_tokens, guarded
from server import fresh_database

from semap.cluster import Cluster
from semap.store.database.connection import connect
from semap.store.operate.rule_slot import ensure_slot


@pytest.fixture(scope="module")
def building(cluster: Cluster, template: str) -> Iterator[Building]:
    """One for all tests of a module, which leave it as it was."""
    with fresh_database(cluster, template) as dsn:
        with connect(dsn) as connection:
            ensure_slot(connection)
        ids = furnish(dsn)
        with guarded(dsn) as service:
            give_tokens(service)
            yield Building(service, ids)
