"""Real data of others, which lies beside the repository and not in it."""

from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1].parent / "shared" / "data"


def data_set(name: str) -> Path:
    """The file or folder of a data set; skips the test where it is absent."""
    path = FOLDER / name
    if not path.exists():
        pytest.skip(f"there is no {name.partition('/')[0]}: the data sets of others belong in ../shared/data")
    return path
