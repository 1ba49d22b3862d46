from collections.abc import Iterator

import pytest
from sqlalchemy import Engine

from semap.store.database.connection import open_engine


@pytest.fixture
def engine(database: str) -> Iterator[Engine]:
    """Connections with the rights of the service."""
    engine = open_engine(database, "semap_api")
    yield engine
    engine.dispose()
