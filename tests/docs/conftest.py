"""A reader of the documentation: an empty database, a free port, an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from semap_service.processes.port import free_port
from transcript import Session, environment


@pytest.fixture
def reader(database: str, tmp_path: Path) -> Session:
    port = free_port()
    told = environment(SEMAP_DSN=database, SEMAP_URL=f"http://127.0.0.1:{port}", SEMAP_PORT=str(port))
    return Session(tmp_path, port, told)
