"""A PostGIS server with a migrated database in it, in a folder that is gone afterwards."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def temporary_server(name: str) -> Iterator[str]:
    """Gives the DSN of the database `name`; the user's own server and maps are not touched."""
    from semap.cluster import lease  # noqa: PLC0415
    from semap.store.schema import migrate  # noqa: PLC0415

    folder = Path(tempfile.mkdtemp(prefix=f"semap-{name}-"))
    folder.chmod(0o711)
    try:
        with lease(folder) as cluster:
            cluster.create_database(name)
            migrate(cluster.dsn(name))
            yield cluster.dsn(name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
