"""semap rule test, explain, learn and replay-late as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from door_scene import PAPER, DoorScene
from rule_work import await_progress, running_worker
from test_cli import done, semap
from world import World

OPENED = json.dumps({"name": "opened_then_entered", **PAPER["opened_then_entered"]})
"""JSON is YAML."""


@pytest.fixture
def scene(world: World) -> DoorScene:
    """Ann has opened and entered, and nobody looked."""
    made = DoorScene(world)
    made.passage(100)
    made.watermark(200)
    return made


def test_a_dry_run_shows_events_and_writes_none(scene: DoorScene) -> None:
    dsn = scene.world.dsn
    shown = done(dsn, "rule", "test", "-", "--map", "world", stdin=OPENED)
    assert shown.split() == ["1", "1970-01-01", "00:01:43.000", "ann", "opened_then_entered", "east"]
    assert (
        done(dsn, "rule", "test", "-", "--map", "world", "--from", "1970-01-01T00:02:00Z", stdin=OPENED) == ""
    )
    (event,) = json.loads(done(dsn, "rule", "test", "-", "--map", "world", "--json", stdin=OPENED))
    assert [each["variable"] for each in event["evidence"]] == ["O", "E"]
    assert scene.events() == []
    assert semap(dsn, "rule", "test", "-", "--map", "nowhere", stdin=OPENED).returncode == 2


def test_a_rule_is_said_in_one_sentence(scene: DoorScene) -> None:
    said = done(scene.world.dsn, "rule", "describe", "--file", "-", stdin=OPENED)
    assert said.startswith("For each room, it makes opened_then_entered when door becomes open")
    done(scene.world.dsn, "rule", "add", "-", "--map", "world", stdin=OPENED)
    assert done(scene.world.dsn, "rule", "describe", "opened_then_entered") == said
    assert semap(scene.world.dsn, "rule", "describe").returncode == 2


def test_rules_are_proposed_out_of_what_is_stored(scene: DoorScene) -> None:
    dsn = scene.world.dsn
    for number in range(5):
        scene.passage(300 + 200 * number)
    scene.watermark(2000)
    asked = (
        "rule",
        "mine",
        "--map",
        "world",
        "--input",
        "door",
        "--input",
        "track_in_room",
        "--within",
        "30 s",
    )
    found = json.loads(done(dsn, *asked, "--json"))
    entered = next(each for each in found if each["name"] == "open_then_began_by_room")
    # each opening is of two rooms, and one of these is entered
    assert (entered["support"], entered["confidence"]) == (6, 0.5)
    assert len(entered["events"]) == 6
    shown = done(dsn, *asked, "--most", "1")
    (text,) = shown.split("---\n")[1:]
    assert done(dsn, "rule", "test", "-", "--map", "world", stdin=text).count("\n") >= 5
    assert scene.events() == []
    refused = semap(dsn, "rule", "mine", "--map", "world", "--input", "nothing")
    assert refused.returncode == 0
    assert "0 rules proposed" in refused.stderr
    assert "Looked at were these. Name queries" in refused.stderr


def test_why_and_why_not(scene: DoorScene) -> None:
    dsn = scene.world.dsn
    done(dsn, "rule", "add", "-", "--map", "world", stdin=OPENED)
    asked = ("rule", "explain", "opened_then_entered", "--key", "room=east", "--at")
    assert "it found opened_then_entered at 1970-01-01T00:01:43Z" in done(dsn, *asked, "1970-01-01T00:01:43Z")
    scene.passage(300, "bob", "ann")
    scene.world.run("update semap.track set name = 'eve' where name = 'bob'")
    scene.world.run(
        "update semap.relation_change set track_name = 'eve' where stamp > to_timestamp(250) and track_name = 'bob'"
    )
    scene.world.run("update semap.relation_change set track_name = 'somebody else' where track_name = 'eve'")
    why_not = done(dsn, *asked, "1970-01-01T00:05:03Z")
    assert "it found nothing" in why_not
    assert "no  track = first(O.actor): 'somebody else' = 'eve'" in why_not
    of_all = done(dsn, "rule", "explain", "opened_then_entered", "--at", "1970-01-01T00:05:03Z")
    assert "An attempt came to nothing (room east):" in of_all
    assert "next would have been E" in of_all
    assert "of 2 keys" in of_all
    wrong = semap(
        dsn, "rule", "explain", "opened_then_entered", "--at", "1970-01-01T00:01:43Z", "--key", "track=ann"
    )
    assert wrong.returncode == 2
    assert "Its key is room" in wrong.stderr


def test_a_certificate_is_checked_by_itself_and_against_what_is_stored(
    scene: DoorScene, tmp_path: Path
) -> None:
    dsn = scene.world.dsn
    done(dsn, "rule", "add", "-", "--map", "world", stdin=OPENED)
    file = tmp_path / "certificate.json"
    span = ("--from", "1970-01-01T00:01:00Z", "--to", "1970-01-01T00:03:00Z")
    said = done(dsn, "rule", "explain", "opened_then_entered", *span, "--certificate", str(file))
    assert "makes opened_then_entered at 1970-01-01T00:01:43.000000Z:" in said
    assert done(dsn, "rule", "verify", str(file)) == said
    assert "those that are stored" in done(dsn, "rule", "verify", str(file), "--stored")

    document = json.loads(file.read_text())
    lie = {**document, "events": []}
    refused = semap(dsn, "rule", "verify", "-", stdin=json.dumps(lie))
    assert refused.returncode == 2
    assert "the rule also makes" in refused.stderr
    # of no rows nothing follows, and so it holds by itself
    omitted = {**lie, "streams": [], "attempts": [], "other_attempts": 0}
    assert "makes no event" in done(dsn, "rule", "verify", "-", stdin=json.dumps(omitted))
    refused = semap(dsn, "rule", "verify", "-", "--stored", stdin=json.dumps(omitted))
    assert refused.returncode == 2
    assert "other rows are stored" in refused.stderr
    other = {**document, "rule": {**document["rule"], "where": "type <> 'never'"}}
    refused = semap(dsn, "rule", "verify", "-", "--stored", stdin=json.dumps(other))
    assert "was not so in version 1" in refused.stderr


def test_a_rule_learns_its_next_version(scene: DoorScene) -> None:
    dsn = scene.world.dsn
    sure = {
        **PAPER["opened_then_entered"], "name": "sure",
        "confidence": {"gap": ["O", "E"], "distribution": "exponential", "mean_s": 60},
    }  # fmt: skip
    done(dsn, "rule", "add", "-", "--map", "world", stdin=json.dumps(sure))
    assert done(dsn, "rule", "learn", "sure", "--dry-run").strip() == "Rule sure: mean_s 1."
    assert done(dsn, "rule", "learn", "sure").strip() == "Rule sure is at version 2: mean_s 1."
    shown = json.loads(done(dsn, "rule", "show", "sure"))
    assert shown["declaration"]["confidence"]["mean_s"] == 1.0


def test_late_rows_are_replayed(world: World) -> None:
    scene = DoorScene(world)
    done(world.dsn, "rule", "add", "-", "--map", "world", stdin=OPENED)
    with running_worker(world.dsn):
        # nobody waits for the doors, and then they speak
        world.run("update semap.source set ended = true where source_id = %s", scene.door_source_id)
        scene.watermark(200, world.source_id)
        await_progress(world.dsn)
        scene.passage(100)
        await_progress(world.dsn)
    said = done(world.dsn, "rule", "replay-late", "--map", "world")
    assert said.strip().endswith("late rows replayed; 1 event added.")
    assert scene.events("opened_then_entered") == [("opened_then_entered", "ann", "east", 103.0)]
    assert done(world.dsn, "rule", "replay-late").strip() == "0 late rows replayed; 0 events added."


def test_what_a_rule_gave_up_stands_beside_it(scene: DoorScene) -> None:
    """The list and an explanation say it; what reads the list as JSON has it there."""
    dsn = scene.world.dsn
    done(dsn, "rule", "add", "-", "--map", "world", stdin=OPENED)
    scene.world.run(
        "update semap.progress set watermarks = watermarks || jsonb_build_object('given_up', (select"
        " jsonb_object_agg(rule_id, jsonb_build_object('version', version, 'attempts', 12, 'first',"
        " '2026-01-31T12:00:00+00:00', 'key', '{\"room\": \"east\"}'::jsonb)) from semap.rule"
        " where name = 'opened_then_entered'))"
    )
    loss = (
        "It gave up 12 attempts, as more than 10,000 were under way in one key; events that begin at"
        " 2026-01-31T12:00:00Z or later may be missing (first of room east). Give it a window (within), a finer"
        " partition_by, or an after_match that skips more."
    )
    assert semap(dsn, "rule", "list").stderr.splitlines() == [f"Rule opened_then_entered: {loss}"]
    given_up = {each["name"]: each["given_up"] for each in json.loads(done(dsn, "rule", "list", "--json"))}
    assert given_up["opened_then_entered"]["key"] == {"room": "east"}
    assert given_up["room_visits"] is None
    asked = ("rule", "explain", "opened_then_entered", "--key", "room=east", "--at", "1970-01-01T00:01:43Z")
    assert done(dsn, *asked).splitlines()[-1] == f"Since version 1 is in force: {loss}"
    assert semap(dsn, "rule", "show", "opened_then_entered").returncode == 0
