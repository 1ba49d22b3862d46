"""What rules make of edits under them: of queries, concepts, doors, tracks and maps, and of rules over rules."""

from __future__ import annotations

import json

import psycopg
import pytest
import shapely
from door_scene import DoorScene, stamp
from rule_work import await_progress, lose_slot, running_worker
from world import World

from semap.rules.language.reading import parse_declaration
from semap.store.database.connection import connect
from semap.store.operate.rule_slot import ensure_slot
from semap.worker import progress
from semap.worker.late_replay import Replay, replay_late
from semap.worker.past import dry_run
from semap.worker.resync import resync

IN_ROOM_ENDS = {
    "input": "track_in_room", "partition_by": "room", "pattern": "B followed by L",
    "define": {"B": "type = 'began'", "L": "type = 'ended'"}, "within": "1 h", "emit": "visited",
}  # fmt: skip
CROWDED = {"input": "track_in_room", "where": "occupants > 1", "emit": {"began": "crowded"}}
OPENED = {"input": {"object_state": "door"}, "emit": {"open": "opened"}}
TWICE = {
    "input": "visits", "partition_by": "track", "pattern": "A followed by B",
    "define": {"A": "type = 'entered'", "B": "type = 'entered'"}, "within": "1 min", "emit": "twice",
}  # fmt: skip
VISITS = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}


def test_a_query_that_rules_read_keeps_its_name(world: World) -> None:
    with pytest.raises(
        psycopg.errors.ForeignKeyViolation, match=r"Rules read the query track_in_room: room_visits\."
    ):
        world.run("update semap.continuous_query set name = 'where'")
    world.run("delete from semap.rule")
    world.run("update semap.continuous_query set name = 'where'")


@pytest.mark.parametrize("edit", ["concept", "instance", "track"])
def test_what_an_edit_ends_is_ended_in_the_room_in_which_it_began(world: World, edit: str) -> None:
    """The room is no Room any more, or is not there, or whoever was in it is not."""
    scene = DoorScene(world)
    scene.add_rule("visited", IN_ROOM_ENDS)
    with running_worker(world.dsn):
        scene.walk("ann", [(100, 1, 1), (101, 1, 1)])
        scene.watermark(101)
        await_progress(world.dsn)
        if edit == "concept":
            world.run(
                "update semap.instance set concept_id ="
                " (select concept_id from semap.concept where name = 'Window') where name = 'west'"
            )
        elif edit == "instance":
            world.delete_room("west")
        else:
            world.run("delete from semap.track")
        scene.watermark(110)
        await_progress(world.dsn)
    assert scene.events("visited") == [("visited", "ann", "west", 101.000001)]
    assert scene.events("left") == [("left", "ann", None, 101.0)]


def test_who_is_deleted_counts_no_more(world: World) -> None:
    scene = DoorScene(world)
    scene.add_rule("crowded", CROWDED)
    with running_worker(world.dsn):
        scene.walk("ann", [(100, 1, 1), (101, 1, 1)])
        scene.watermark(101)
        world.run("delete from semap.track")
        scene.walk("bob", [(110, 1, 2), (111, 1, 2)])
        scene.watermark(111)
        scene.walk("eve", [(120, 1, 3)])
        scene.watermark(121)
        await_progress(world.dsn)
    assert scene.events("crowded") == [("crowded", "eve", None, 120.0)]
    assert world.changes() == [
        ("bob", "west", "began", "appeared", 110_000_000),
        ("eve", "west", "began", "appeared", 120_000_000),
    ]


def test_a_removed_door_is_told_with_its_rooms(world: World) -> None:
    scene = DoorScene(world)
    extra = scene.add_door("hatch", shapely.box(3.9, 3, 4.1, 3.5), (scene.east_id,))
    scene.add_rule(
        "doors", {"input": {"map": True}, "partition_by": "room", "emit": {"removed": "bricked_up"}}
    )
    with running_worker(world.dsn):
        world.run("delete from semap.instance where instance_id = %s", extra)
        await_progress(world.dsn)
    assert [row[2] for row in scene.events("bricked_up")] == ["east"]


def test_an_edit_that_is_under_way_when_a_worker_stops_is_told_by_the_next(world: World) -> None:
    scene = DoorScene(world)
    scene.add_rule("works", {"input": {"map": True}, "emit": {"removed": "torn_down"}})
    with running_worker(world.dsn):
        await_progress(world.dsn)
        with connect(world.dsn) as editor, editor.transaction():
            editor.execute("delete from semap.instance where name = 'gate'")
            scene.watermark(50)
            await_progress(world.dsn)
            stopped = world.rows("select lsn::text from semap.progress")
            world.run(
                "select pg_terminate_backend(pid) from pg_stat_activity where datname = current_database()"
                " and application_name in ('semap work', 'semap replication')"
            )
            scene.watermark(60)
            await_progress(world.dsn)
        await_progress(world.dsn)
    assert stopped
    assert world.rows("select type, instance_name from semap.event") == [("torn_down", "gate")]


def test_rules_that_are_made_together_run_over_the_past_together(world: World) -> None:
    scene = DoorScene(world)
    world.run("delete from semap.rule")
    scene.walk("ann", [(100, 1, 1), (110, 6, 1), (120, 1, 1)])
    scene.watermark(130)
    with running_worker(world.dsn):
        await_progress(world.dsn)
        with world.connection.transaction():
            scene.add_rule("visits", VISITS, backfill_from_s=0)
            scene.add_rule("twice", TWICE, backfill_from_s=0)
        await_progress(world.dsn)
    assert [at_s for _, _, _, at_s in scene.events("twice")] == [110.0]
    with connect(world.dsn) as connection:
        dry = dry_run(connection, world.name, parse_declaration(TWICE, "twice"))
    made = world.rows("select event_id::text from semap.event where rule_name = 'twice'")
    assert [(str(event.event_id),) for event in dry] == made


def test_late_rows_come_to_rules_that_read_others_by_their_bare_name(world: World) -> None:
    scene = DoorScene(world)
    world.run("delete from semap.rule")
    scene.add_rule("visits", VISITS)
    scene.add_rule("twice", TWICE)
    late_id = world.add_source("late")
    scene.tracks["bob"] = world.add_track("bob", late_id)
    world.run("update semap.source set ended = true where source_id = %s", late_id)
    with running_worker(world.dsn):
        scene.watermark(200, world.source_id, scene.door_source_id)
        await_progress(world.dsn)
        scene.walk("bob", [(100, 1, 1), (110, 6, 1)])
        await_progress(world.dsn)
        assert scene.events("twice") == []
        assert replay_late(world.dsn) == Replay(3, 1)
    assert [at_s for _, _, _, at_s in scene.events("twice")] == [110.0]


def test_a_state_that_comes_after_later_ones_tells_since_when_it_is(world: World) -> None:
    """Open is reported again before it is known when it was opened; in whichever order, the same comes out."""
    scene = DoorScene(world)
    world.run("update semap.source set lateness = '10 s'")
    scene.add_rule("shut", {
        "input": {"object_state": "door"}, "where": "occupants is null", "emit": {"closed": "shut"},
        "measures": {"open_s": "duration_s"},
    })  # fmt: skip
    with running_worker(world.dsn):
        for value, at_s in (("open", 103), ("open", 105), ("closed", 107), ("open", 102), ("closed", 101)):
            scene.door(value, at_s)
        scene.watermark(130)
        await_progress(world.dsn)
    shut = world.rows(
        "select extract(epoch from stamp)::int, measures from semap.event where rule_name = 'shut' order by stamp"
    )
    assert shut == [(101, {"open_s": None}), (107, {"open_s": 5.0})]
    with connect(world.dsn) as connection:
        document = json.loads(world.one("select declaration::text from semap.rule where name = 'shut'"))
        dry = dry_run(connection, world.name, parse_declaration(document, "shut"), stamp(0))
    assert [event.measures["open_s"] for event in dry] == [None, 5.0]


def test_events_of_a_map_that_is_gone_are_not_added(world: World) -> None:
    event = {
        "event_id": "00000000-0000-0000-0000-000000000001", "map_id": world.map_id + 1, "rule_name": "r",
        "rule_version": 1, "type": "t", "stamp": "2026-01-01Z", "since": "2026-01-01Z", "evidence": [],
    }  # fmt: skip
    other = {**event, "event_id": "00000000-0000-0000-0000-000000000002", "map_id": world.map_id}
    assert world.one("select semap.add_events('rules', %s)", json.dumps([event, other])) == 1
    assert world.rows("select map_id, seq from semap.event") == [(world.map_id, 1)]


def test_a_lost_slot_hides_no_map_and_no_source_that_was_deleted(world: World) -> None:
    """The doors' source, for which rules would wait for ever, and another map with its events."""
    scene = DoorScene(world)
    scene.add_rule("visited", IN_ROOM_ENDS)
    other = World(world.dsn, "other")
    other.add_room("shed", shapely.box(0, 0, 4, 4))
    with running_worker(world.dsn):
        other.add_states([(other.add_track("cat"), 100_000_000, 1, 1, None)])
        scene.walk("ann", [(100, 1, 1), (101, 9, 1), (120, 9, 1)])
        scene.watermark(90)
        scene.watermark(120, world.source_id)
        await_progress(world.dsn)
    assert world.one("select count(*) from semap.event where map_id = %s", other.map_id) == 1
    lose_slot(world.dsn)
    world.run("delete from semap.source where source_id = %s", scene.door_source_id)
    world.run("delete from semap.map where map_id = %s", other.map_id)
    with connect(world.dsn) as connection:
        ensure_slot(connection)
    resync(world.dsn)
    assert scene.events("visited") == [("visited", "ann", "west", 101.0)]
    assert world.rows("select distinct map_id from semap.event") == [(world.map_id,)]
    assert world.one("select watermarks -> 'maps' ? %s from semap.progress", str(other.map_id)) is False
    other.close()


def test_what_is_too_much_for_one_statement_is_committed_in_parts_and_at_once(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "PART_CHARACTERS", 1)
    scene = DoorScene(world)
    scene.add_rule("visited", IN_ROOM_ENDS)
    way = [(100 + i, 1 + 5 * (i % 2), 1) for i in range(20)]
    for name in ("ann", "bob"):
        scene.walk(name, [*way[:-1], (way[-1][0], 20, 1)])
    scene.watermark(110)
    with running_worker(world.dsn):
        await_progress(world.dsn)
        waiting = world.one("select count(*) from semap.pending_row")
        states = world.one("select count(*) from semap.rule_state")
        scene.watermark(200)
        await_progress(world.dsn)
    assert (waiting, states) == (2 * 17, 1)
    assert world.one("select count(*) from semap.pending_row") == 0
    kinds = ("entered", "left", "visited")
    assert {kind: len(scene.events(kind)) for kind in kinds} == {"entered": 38, "left": 38, "visited": 19}
    assert [seq for (seq,) in world.rows("select seq from semap.event order by seq")] == list(range(1, 96))


def test_a_row_of_an_edit_is_not_taken_from_the_past_as_well(world: World) -> None:
    """It waits for no source, and stands where the map was."""
    scene = DoorScene(world)
    ends = {
        "input": "track_in_room", "where": "type = 'ended'", "pattern": "E{2}", "define": {"E": "true"},
        "within": "1 h", "emit": "two_ended",
    }  # fmt: skip
    scene.add_rule("visited", IN_ROOM_ENDS)
    with running_worker(world.dsn):
        scene.walk("ann", [(100, 1, 1), (101, 1, 1)])
        scene.watermark(101)
        await_progress(world.dsn)
        world.delete_room("west")
        await_progress(world.dsn)
        assert world.one("select count(*) from semap.pending_row") == 0
        scene.add_rule("ends", ends, backfill_from_s=0)
        scene.watermark(110)
        await_progress(world.dsn)
    assert scene.events("visited", "two_ended") == [("visited", "ann", "west", 101.000001)]


def test_a_rule_finds_its_actor_whatever_others_look_for(world: World) -> None:
    """Somebody stands by three metres away, whom the rule that looks further takes for possible as well."""
    scene = DoorScene(world)
    near, far = (
        {
            "input": {"object_state": "door", "actor_within_m": within_m}, "emit": {"open": "opened"},
            "measures": {"who": "actor", "likelihood": "actor_likelihood", "distance_m": "actor_distance_m"},
        }
        for within_m in (1.5, 6)
    )  # fmt: skip
    lone = {**near, "input": {"object_state": "door", "actor_within_m": 0.1}}
    rules = {"near": near, "far": far, "lone": lone}
    for name, document in rules.items():
        scene.add_rule(name, document)
    with running_worker(world.dsn):
        scene.walk("ann", [(100 + i, 3, 2) for i in range(4)])
        scene.walk("bob", [(100 + i, 7, 2) for i in range(4)])
        scene.door("open", 102)
        scene.watermark(110)
        await_progress(world.dsn)
    with connect(world.dsn) as connection:
        for name, document in rules.items():
            made = world.rows("select measures from semap.event where rule_name = %s", name)
            dry = dry_run(connection, world.name, parse_declaration(document, name))
            assert [(dict(event.measures),) for event in dry] == made
    measured = dict(
        world.rows("select rule_name, measures from semap.event where rule_name = any (%s)", list(rules))
    )
    assert [measured[name]["who"] for name in rules] == ["ann", "ann", None]
    assert measured["near"]["likelihood"] > 0.6 > measured["far"]["likelihood"]
