"""semap simulate office"""

import json
from pathlib import Path

import pytest
from semap_service.cli.simulate import commands
from typer.testing import CliRunner

from semap.errors import Conflict, InvalidInput

SMALL = ("--duration", "1.5", "--people", "1", "--no-camera")


def test_it_writes_and_says_what(tmp_path: Path) -> None:
    done = CliRunner().invoke(commands(), ["office", str(tmp_path / "office"), *SMALL, "--seed", "3"])
    assert done.exit_code == 0, done.output
    assert f"1.5 s with 1 person written to {tmp_path / 'office' / 'recording.mcap'}" in done.output
    assert "0 enterings and 0 leavings of rooms" in done.output


def test_as_json(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        commands(), ["office", str(tmp_path / "office"), *SMALL, "--json", "--gap", "laser:0:1"]
    )
    document = json.loads(done.output)
    assert document["transitions"] == document["openings"] == document["relations"] == 0
    assert all(Path(document[key]).exists() for key in ("recording", "labels", "map"))
    assert len(json.loads(Path(document["labels"]).read_text())["tracks"]["stamp_us"]) == 8


@pytest.mark.parametrize(
    ("wrong", "error", "says"),
    [
        (["--people", "99"], InvalidInput, "99 people"),
        (["--gap", "lidar:1:1"], InvalidInput, "is no gap"),
        (["--duration", "0"], InvalidInput, "0.0 s"),
    ],
)
def test_wrong_options(tmp_path: Path, wrong: list[str], error: type[Exception], says: str) -> None:
    failed = CliRunner().invoke(commands(), ["office", str(tmp_path / "office"), *SMALL, *wrong])
    assert isinstance(failed.exception, error)
    assert says in str(failed.exception)
    assert not (tmp_path / "office").exists()


def test_a_folder_in_use_is_kept(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    failed = CliRunner().invoke(commands(), ["office", str(tmp_path), *SMALL])
    assert isinstance(failed.exception, Conflict)
