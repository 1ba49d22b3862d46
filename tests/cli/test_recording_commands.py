"""Simulate, look at, bring in: recordings on the command line."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import psycopg
import pytest
from semap_service.cli import commands
from typer.testing import CliRunner

from semap.errors import InvalidInput


def done(*arguments: str | Path) -> str:
    ran = CliRunner().invoke(commands(), [str(each) for each in arguments])
    assert ran.exit_code == 0, (ran.output, ran.exception)
    return ran.stdout


@pytest.fixture(scope="module")
def office(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of three people, without images."""
    folder = tmp_path_factory.mktemp("simulated") / "office"
    said = done("simulate", "office", folder, "--duration", "6", "--people", "3", "--no-camera")
    assert said.startswith("6 s with 3 persons written to")
    return folder


def test_what_a_recording_holds(office: Path) -> None:
    document = json.loads(done("recording", "info", office / "recording.mcap", "--json"))
    parts = {row["topic"]: (row["part"], row["messages"]) for row in document["topics"]}
    stamps = json.loads((office / "labels.json").read_text())["tracks"]["stamp_us"]
    assert parts["/scan"] == ("scan", len(stamps))
    assert parts["/tf"][0] == parts["/tf_static"][0] == "transforms"
    assert "/camera/image/compressed" not in parts
    first, *topics = done("recording", "info", office / "recording.mcap").splitlines()
    assert first == "2026-01-05 09:14:59 to 2026-01-05 09:15:06, 6.2 s"
    assert [line.split()[0] for line in topics] == list(parts)


def test_from_a_simulated_recording_to_tracks(office: Path, database: str) -> None:
    done("map", "import", office / "map", "--dsn", database)
    ingest = (
        "ingest",
        "recording",
        office / "recording.mcap",
        "--map",
        "office",
        "--dsn",
        database,
        "--json",
    )
    first = json.loads(done(*ingest))
    with psycopg.connect(database) as session:
        for again in (False, True):
            [written] = session.execute(
                "select (select count(*) from semap.stored_state), (select count(*) from semap.track),"
                " (select count(*) from semap.line_observation)"
            )
            assert written == (first["states"], first["tracks"], first["lines"])
            session.commit()
            if not again:
                assert json.loads(done(*ingest))["resumed_at"] > 0
    assert first["states"] > 0 < first["lines"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nonsense"], "there is no part nonsense"),
        (["scans"], "--data FOLDER"),
        (["scans", "--data", "/nowhere"], "--data FOLDER"),
        (["detection", "--out", "/dev/null/figures"], "--out FOLDER"),
    ],
)
def test_a_wrong_evaluation_ends_before_anything_is_measured(arguments: list[str], says: str) -> None:
    failed = CliRunner().invoke(commands(), ["evaluate", "office", *arguments])
    assert isinstance(failed.exception, InvalidInput)
    assert says in f"{failed.exception} {failed.exception.remedy}"


@pytest.mark.parametrize("option", ["--seeds", "--plays"])
def test_nothing_is_not_measured(option: str) -> None:
    assert CliRunner().invoke(commands(), ["evaluate", "office", option, "0"]).exit_code == 2


def test_without_the_perception_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    failed = CliRunner().invoke(commands(), ["evaluate", "office"])
    assert isinstance(failed.exception, InvalidInput)
    assert str(failed.exception) == "playing recordings needs OpenCV"
    assert failed.exception.remedy == "pip install 'semap[perception]'"
