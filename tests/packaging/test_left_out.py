"""What a run of the tests says of those that it left out."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from left_out import left_out

TESTS = Path(__file__).parents[1]
EXAMPLE = """
import pytest
from data_sets import data_set

@pytest.mark.parametrize("name", ["nowhere/a", "nowhere/b", "elsewhere"])
def test_data(name): data_set(name)
@pytest.mark.skip(reason="there is no curl: apt-get install curl")
def test_curl(): pass
@pytest.mark.slow
def test_slow(): raise AssertionError
def test_it(): pass
"""


def run(folder: Path, *options: str) -> list[str]:
    (folder / "test_example.py").write_text(EXAMPLE)
    (folder / "conftest.py").write_text("from left_out import pytest_terminal_summary  # noqa: F401\n")
    command = [sys.executable, "-m", "pytest", "-c", "/dev/null", "--rootdir", folder, "-q", "-W", "ignore",
               "-p", "no:cacheprovider", "-p", "xdist", "-o", f"pythonpath={TESTS}", "-o", "markers=slow", *options, folder]  # fmt: skip
    ran = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "passed" in ran.stdout, ran.stdout + ran.stderr
    return [line for line in ran.stdout.splitlines() if line.startswith("left out: ")]


def test_one_line_says_what_was_left_out_and_how_to_have_it(tmp_path: Path) -> None:
    expected = [
        "left out: 1 for want of curl (apt-get install curl); 3 for want of elsewhere, nowhere (the data sets of"
        " others belong in ../shared/data); the slow ones (./dev test --all)"
    ]
    assert run(tmp_path, "-m", "not slow") == expected
    assert run(tmp_path, "-m", "not slow", "-n", "2") == expected


def test_nothing_is_said_when_nothing_was_left_out(tmp_path: Path) -> None:
    assert run(tmp_path, "-k", "test_it") == []
    assert left_out([], "") == ""
