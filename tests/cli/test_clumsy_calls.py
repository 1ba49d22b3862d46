"""Commands on rules and the log, called clumsily: a sentence, a remedy and exit status 2, never a traceback."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from test_map_commands import Semap, semap

from semap.store.database.connection import connect

__all__ = ["semap"]

RULE = "name: visits\ninput: door\nemit: {open: opened}\n"
THEN, BEFORE = "2027-01-01T00:00:00Z", "2026-01-01T00:00:00Z"
HEADER = "instance,property,value,stamp\n"


@pytest.fixture
def office(semap: Semap, tmp_path: Path) -> Semap:
    (tmp_path / "office.yaml").write_text(
        "map: office\nrooms: {lab: {footprint: [[0, 0], [4, 0], [4, 3]]}}\n"
    )
    assert semap("map", "import", tmp_path / "office.yaml")[0] == 0
    (tmp_path / "rule.yaml").write_text(RULE)
    assert semap("rule", "add", tmp_path / "rule.yaml", "--map", "office")[0] == 0
    return semap


def test_what_is_not_there_is_named(office: Semap, tmp_path: Path) -> None:
    rule = tmp_path / "rule.yaml"
    for call in (
        ("rule", "list"), ("rule", "late"), ("rule", "replay-late"), ("rule", "add", rule), ("rule", "test", rule),
        ("log", "export", tmp_path / "log.csv"), ("plot", "timeline", tmp_path / "log.svg"),
        ("recompute", BEFORE, THEN), ("track", "list"), ("track", "amendments"), ("door", "list"), ("query", "list"),
        ("source", "list"), ("relations",), ("events",), ("doctor", "--verify"),
    ):  # fmt: skip
        for name, told in (("nowhere", "nowhere"), ("", "(an empty name)")):
            status, _, said = office(*call, "--map", name)
            assert (status, f"There is no map {told}." in said) == (2, True), call
    status, _, said = office("map", "import", tmp_path / "office.yaml", "--map", "")
    assert (status, "a map without a name" in said) == (2, True)


def test_what_others_wrote_does_not_reach_the_terminal_as_a_command(office: Semap, database: str) -> None:
    name = "a\a\x1b]0;title\x07b\x9b2J\x7f\u202ec\nd"
    with connect(database) as connection:
        connection.execute("insert into semap.source (map_id, name) select map_id, 's' from semap.map")
        connection.execute(
            "insert into semap.track (uid, source_id, map_id, name)"
            " select gen_random_uuid(), source_id, map_id, %s from semap.source",
            [name],
        )
        connection.execute(
            "insert into semap.track_state (track_id, stamp, x_m, y_m) select track_id, now(), 3, 1 from semap.track"
        )
    seen = r"a\u0007\u001b]0;title\u0007b\u009b2J\u007f\u202ec\nd"
    for call in (("track", "list"), ("relations",)):
        status, shown, _ = office(*call)
        assert (status, seen in shown) == (0, True), shown
    status, shown, _ = office("track", "list", "--json")
    assert {char for char in shown if not char.isprintable()} == {"\n"}
    assert json.loads(shown)[0]["track"] == name
    status, _, said = office("rule", "list", "--map", name)
    assert (status, seen.replace(r"\n", "\n") in said) == (2, True), said


def test_spans_and_formats_that_are_none(office: Semap, tmp_path: Path) -> None:
    turned = ("--map", "office", "--from", THEN, "--to", BEFORE)
    for call in (
        ("log", "export", tmp_path / "log.csv"), ("plot", "timeline", tmp_path / "log.svg"),
        ("rule", "test", tmp_path / "rule.yaml"),
    ):  # fmt: skip
        status, _, said = office(*call, *turned)
        assert (status, "it ends before it begins" in said) == (2, True), call
    status, _, said = office("plot", "timeline", tmp_path / "log.gif", "--map", "office")
    assert (status, "log.gif: there is no such picture" in said) == (2, True)
    assert [path.name for path in tmp_path.glob("*log*")] == []
    for at in ("0001-01-01T00:00:00Z", "9999-12-31T00:00:00Z"):
        status, shown, _ = office("rule", "explain", "visits", "--at", at)
        assert (status, "it read no row" in shown) == (0, True)


def test_versions_fit_a_terminal(office: Semap) -> None:
    status, shown, _ = office("rule", "versions", "visits")
    assert status == 0
    assert [line.split()[:2] for line in shown.splitlines()] == [["version", "name"], ["1", "visits"]]
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (b"lab,door,op\xffen,2026-01-31T12:00:00Z", "no text in UTF-8"),
        (b"lab,door,op\0en,2026-01-31T12:00:00Z", "NUL"),
        (b"lab,door," + b"x" * 1001 + b",2026-01-31T12:00:00Z", "more than 1000 characters"),
    ],
)
def test_states_that_are_no_text(office: Semap, tmp_path: Path, cells: bytes, words: str) -> None:
    (tmp_path / "states.csv").write_bytes(HEADER.encode() + cells + b"\n")
    status, _, said = office("ingest", "objects", tmp_path / "states.csv", "--map", "office")
    assert (status, words in said, "states.csv, line 2" in said) == (2, True, True)


def test_an_argument_that_is_no_text(office: Semap) -> None:
    status, _, said = office("rule", "list", "--map", "\udcff")
    assert (status, "no text in UTF-8" in said) == (2, True)
