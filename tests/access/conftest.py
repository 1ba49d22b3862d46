from collections.abc import Iterator

import pytest
from guarded import Building, furnish, give_tokens, guarded
from server import database_with_slot

from semap.cluster import Cluster


@pytest.fixture(scope="module")
def building(cluster: Cluster, template: str) -> Iterator[Building]:
    """One for all tests of a module, which leave it as it was."""
    with database_with_slot(cluster, template) as dsn:
        ids = furnish(dsn)
        with guarded(dsn) as service:
            give_tokens(service)
            yield Building(service, ids)
