"""The command line as a user meets it: each call a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rule_work import running_worker
from semap_service import demo
from warm import run_warm

FOLDER = Path(demo.__file__).parent
PATIENCE_S = 60.0


def semap(dsn: str | None, *arguments: str, stdin: str | None = None) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "COLUMNS": "110"}
    if dsn is not None:
        environment["SEMAP_DSN"] = dsn
    return run_warm(arguments, environment, stdin, PATIENCE_S)


def done(dsn: str, *arguments: str, stdin: str | None = None) -> str:
    ran = semap(dsn, *arguments, stdin=stdin)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_a_building_and_a_walk_give_events(database: str) -> None:
    report = json.loads(done(database, "map", "import", str(FOLDER / "office.geojson"), "--json"))
    assert report["concepts"] == {"Door": 7, "Room": 6, "Storey": 1}
    with running_worker(database):
        ingested = json.loads(
            done(database, "ingest", "tracks", str(FOLDER / "walk.csv"), "--map", "office", "--json")
        )
        follower = subprocess.Popen(
            [sys.executable, "-m", "semap_service", "events", "--follow", "--json", "--limit", "36"],
            env={**os.environ, "SEMAP_DSN": database}, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        followed = [json.loads(line) for line in follower.communicate(timeout=PATIENCE_S)[0].splitlines()]
    assert ingested == {
        "states": 2015, "tracks": 3, "resumed_at": 0, "late": 0, "left_out": 0, "states_inside_a_room": 2015
    }  # fmt: skip
    assert [event["seq"] for event in followed] == list(range(1, 37))
    listed = done(database, "events", "--after", "34").splitlines()
    assert [line.split()[0] for line in listed] == ["35", "36"]
    assert "ann left office_1 (last seen there)" in listed[0]
    assert done(database, "query", "now").strip() == "No relation holds now."
    again = done(database, "ingest", "tracks", str(FOLDER / "walk.csv"), "--map", "office")
    assert "2015 states had been written before" in again


def test_maps(database: str) -> None:
    assert "No maps yet" in done(database, "map", "list")
    done(database, "map", "create", "yard", "--cell", "50")
    assert json.loads(done(database, "map", "list", "--json"))[0]["cell_m"] == 50
    assert "empty" in done(database, "map", "show", "yard")
    done(database, "map", "import", str(FOLDER / "office.geojson"), "--map", "yard")
    assert len(done(database, "map", "show", "yard", "--concept", "Room").splitlines()) == 7
    twice = semap(database, "map", "import", str(FOLDER / "office.geojson"), "--map", "yard")
    assert twice.returncode == 2
    assert "What to do" in twice.stderr
    assert "Delete map yard" in semap(database, "map", "delete", "yard", stdin="n\n").stdout
    done(database, "map", "delete", "yard", "--yes")
    assert "No maps yet" in done(database, "map", "list")


def test_queries_and_rules(database: str) -> None:
    done(database, "map", "create", "home")
    assert "track_in_room" in done(database, "query", "list")
    done(database, "query", "add", "in_any_space", "--map", "home", "--concept", "Space")
    rule = "name: comings\ninput: in_any_space\nemit: {began: came}\n"
    assert "Rule 2 made" in done(database, "rule", "add", "-", "--map", "home", stdin=rule)
    assert json.loads(done(database, "rule", "show", "2"))["declaration"]["emit"] == {"began": "came"}
    done(database, "rule", "disable", "2")
    near = ("query", "add", "near", "--map", "home", "--concept", "Door", "--where", "attributes.floor = 2")
    assert "needs a distance" in semap(database, *near, "--predicate", "within_distance").stderr
    made = done(database, *near, "--predicate", "within_distance", "--distance", "2", "--debounce")
    assert "Query 3 made: near." in made
    assert "2 m, debounced" in done(database, "query", "list", "--map", "home")
    assert done(database, "query", "watch", "near", "--map", "home", "--limit", "0") == ""
    done(database, "query", "delete", "3")
    done(database, "query", "disable", "2")
    states = {row["name"]: row["enabled"] for row in json.loads(done(database, "rule", "list", "--json"))}
    assert states == {"room_visits": True, "comings": False}
    assert "comings" in semap(database, "query", "delete", "2").stderr
    later = rule.replace("came", "arrived")
    said = done(database, "rule", "add", "-", "--map", "home", "--replace", "--backfill", "all", stdin=later)
    assert "Rule 2 replaced: comings, version 2, over in_any_space; it runs over the past as well." in said
    assert "version 3" in done(database, "rule", "replace", "comings", "-", stdin=rule)
    versions = json.loads(done(database, "rule", "versions", "comings", "--json"))
    assert [each["declaration"]["emit"]["began"] for each in versions] == ["came", "arrived", "came"]
    assert "No row came late." in done(database, "rule", "late", "--map", "home")
    ready = done(database, "rule", "template", "dwell", "--set", "name=stayed", "--set", "duration=1 min")
    assert "Rule 3 made: stayed" in done(database, "rule", "add", "-", "--map", "home", stdin=ready)
    done(database, "rule", "delete", "stayed")
    done(database, "rule", "delete", "2")
    done(database, "query", "delete", "2")
    assert [row["name"] for row in json.loads(done(database, "query", "list", "--json"))] == ["track_in_room"]
    assert [row["name"] for row in json.loads(done(database, "rule", "list", "--json"))] == ["room_visits"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["map", "import", "nowhere.geojson"], "nowhere.geojson"),
        (["map", "import", "house.dwg"], ".dwg"),
        (["map", "show", "nowhere"], "no map nowhere"),
        (["ingest", "tracks", "nowhere.csv", "--map", "x"], "no file"),
        (["ingest", "tracks", str(FOLDER / "walk.csv"), "--map", "nowhere"], "no map nowhere"),
        (["ingest", "tracks", str(FOLDER / "walk.csv"), "--map", "x", "--epoch", "now"], "ISO 8601"),
        (["rule", "add", "nowhere.yaml", "--map", "x"], "nowhere.yaml"),
        (["rule", "show", "9"], "no rule 9"),
        (["query", "add", "q", "--map", "nowhere", "--concept", "Room"], "nowhere"),
    ],
)
def test_a_wrong_call_says_what_to_do(database: str, arguments: list[str], message: str) -> None:
    ran = semap(database, *arguments)
    assert ran.returncode == 2
    assert message in ran.stderr
    assert "What to do:" in ran.stderr
    assert "Traceback" not in ran.stderr


@pytest.mark.parametrize(
    "rule", ["name: [", "name: r\ninput: q\n", "name: r\ninput: {query: nowhere}\nemit: {began: x}\n"]
)
def test_a_wrong_rule_changes_nothing(database: str, rule: str) -> None:
    done(database, "map", "create", "home")
    ran = semap(database, "rule", "add", "-", "--map", "home", stdin=rule)
    assert ran.returncode == 2
    assert "What to do:" in ran.stderr
    assert len(json.loads(done(database, "rule", "list", "--json"))) == 1


def test_a_server_that_does_not_answer() -> None:
    ran = semap("host=127.0.0.1 port=1 dbname=x", "map", "list")
    assert ran.returncode == 1
    assert "SEMAP_DSN" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_a_database_without_a_schema(empty_database: str) -> None:
    ran = semap(empty_database, "map", "list")
    assert ran.returncode == 1
    assert "semap db migrate" in ran.stderr
    assert "version" in done(empty_database, "db", "migrate")
    assert json.loads(done(empty_database, "db", "status", "--json"))["maps"] == 0


def test_every_command_explains_itself() -> None:
    names = ("up", "demo", "events", "work", "serve", "map", "ingest", "query", "relations", "rule", "concept", "db",
             "recording", "simulate", "evaluate")  # fmt: skip
    pages = [
        ["--help"],
        *([*name.split(), "--help"] for name in (*names, "simulate office", "evaluate office")),
    ]
    for page in pages:
        ran = semap(None, *page)
        assert ran.returncode == 0
        assert len(ran.stdout.splitlines()) > 5
    assert semap(None, "--version").stdout.startswith("semap ")
