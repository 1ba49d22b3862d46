from collections.abc import Iterator

import pytest
from killable import Serving


@pytest.fixture
def serving(database: str) -> Iterator[Serving]:
    """The service over a fresh database."""
    made = Serving(database)
    made.start()
    yield made
    made.kill()
