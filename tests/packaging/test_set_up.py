"""The first run of `./dev`, killed, doubled and moved. It fetches what the demo needs, and so needs a network."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]
PARTS = (
    "dev",
    "pyproject.toml",
    "README.md",
    "LICENSE",
    "locks",
    "semap",
    "ingest",
    "service/semap_service",
    "sql",
    "migrations",
)
KNOWN = {
    name: value
    for name, value in os.environ.items()
    if not name.startswith(("PYTHON", "SEMAP", "VIRTUAL_ENV"))
}
WITHOUT_NETWORK = {"UV_OFFLINE": "1", "PIP_NO_INDEX": "1"}

pytestmark = pytest.mark.slow


def start(folder: Path, **variables: str) -> subprocess.Popen[str]:
    """Sets up what the demo needs, and says how the demo is used."""
    return subprocess.Popen([folder / "dev", "demo", "--help"], env=KNOWN | variables, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)  # fmt: skip


def ends_well(started: subprocess.Popen[str]) -> str:
    """What it said of the set-up."""
    out, told = started.communicate()
    assert started.returncode == 0, told
    assert "--stay" in out
    return told


def test_a_set_up_may_be_killed_doubled_and_moved(tmp_path: Path) -> None:
    folder = tmp_path / "checkout"
    for part in PARTS:
        (folder / part).parent.mkdir(parents=True, exist_ok=True)
        if (CHECKOUT / part).is_dir():
            shutil.copytree(CHECKOUT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(CHECKOUT / part, folder / part)
    for last_words in ("fetching uv", "making .venv", "installing the"):
        killed = start(folder)
        assert killed.stderr is not None
        assert any(last_words in line for line in killed.stderr)
        os.killpg(killed.pid, signal.SIGKILL)
        killed.communicate()
        assert not (folder / ".venv" / "complete").exists()
    first, second = start(folder), start(folder)
    told = ends_well(first) + ends_well(second)
    assert told.count("making .venv") == 1
    assert "making" not in ends_well(start(folder, **WITHOUT_NETWORK))
    moved = tmp_path / "elsewhere"
    folder.rename(moved)
    assert "making .venv" in ends_well(start(moved, **WITHOUT_NETWORK))
    programs = [
        path for path in (moved / ".venv" / "bin").iterdir() if path.is_file() and not path.is_symlink()
    ]
    assert moved / ".venv" / "bin" / "semap" in programs
    assert [path.name for path in programs if str(folder).encode() in path.read_bytes()] == []
