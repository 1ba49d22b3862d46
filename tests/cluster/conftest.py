from collections.abc import Iterator
from pathlib import Path

import pytest
from server import reachable_folder

from semap.cluster import stop_keeping


@pytest.fixture
def home() -> Iterator[Path]:
    """A home that does not exist yet; a server that a failed test left in it is stopped."""
    with reachable_folder() as folder:
        yield folder / "home"
        stop_keeping(folder / "home", force=True)
