"""The paper's rules on a small scene: who opened the door, entered, and closed it behind him."""

from __future__ import annotations

import pytest
from door_scene import BASE, PAPER, DoorScene
from rule_work import await_progress, running_worker
from world import World

from semap.store.database.connection import connect


@pytest.fixture
def scene(world: World) -> DoorScene:
    return DoorScene(world)


def test_the_rules_of_the_paper_are_attributed_to_the_right_person(scene: DoorScene) -> None:
    scene.world.run("delete from semap.rule")
    for name, document in PAPER.items():
        scene.add_rule(name, document)
    with running_worker(scene.world.dsn):
        scene.passage(100, "ann", "bob")
        scene.passage(200, "bob", "ann")
        scene.watermark(300)
        await_progress(scene.world.dsn)
    assert scene.events() == [
        ("opened_then_entered", "ann", "east", 103.0),
        ("entered_then_closed", "ann", "east", 104.0),
        ("left_then_closed", "ann", "west", 104.0),
        ("opened_then_entered", "bob", "east", 203.0),
        ("entered_then_closed", "bob", "east", 204.0),
        ("left_then_closed", "bob", "west", 204.0),
    ]


def test_a_door_that_somebody_else_opened_does_not_match(scene: DoorScene) -> None:
    """Bob opens the door from the east; ann, far from it, then enters by it."""
    scene.add_rule("opened_then_entered", PAPER["opened_then_entered"])
    scene.walk("bob", [(100, 7, 2), (101, 4.5, 2), (106, 4.5, 2)])
    scene.walk("ann", [(100, 1, 2), (101, 1.5, 2), (103, 4.6, 2.2)])
    scene.door("open", 101)
    scene.watermark(120)
    with running_worker(scene.world.dsn):
        await_progress(scene.world.dsn)
    assert scene.events("opened_then_entered") == []


def test_a_source_that_has_not_spoken_is_waited_for_until_it_has_ended(scene: DoorScene) -> None:
    """The doors come after the tracks, and are not late, since their source was known; then it ends."""
    scene.add_rule("opened_then_entered", PAPER["opened_then_entered"])
    scene.world.run(
        "update semap.source set watermark = '-infinity' where source_id = %s", scene.door_source_id
    )
    with running_worker(scene.world.dsn):
        scene.passage(100)
        scene.watermark(150, scene.world.source_id)
        await_progress(scene.world.dsn)
        assert scene.events("opened_then_entered") == []
        scene.world.run("update semap.source set ended = true where source_id = %s", scene.door_source_id)
        await_progress(scene.world.dsn)
        assert scene.events("opened_then_entered") == [("opened_then_entered", "ann", "east", 103.0)]

        # it speaks again, and is waited for again
        scene.watermark(160, scene.door_source_id)
        scene.passage(200, "bob", "ann")
        scene.watermark(250, scene.world.source_id)
        await_progress(scene.world.dsn)
        assert len(scene.events("opened_then_entered")) == 1
        scene.watermark(250, scene.door_source_id)
        await_progress(scene.world.dsn)
        assert scene.events("opened_then_entered")[1:] == [("opened_then_entered", "bob", "east", 203.0)]
    assert scene.world.rows("select ended from semap.source where source_id = %s", scene.door_source_id) == [
        (False,)
    ]
    assert scene.world.rows("select count(*) from semap.late_row") == [(0,)]


def test_states_that_come_out_of_order_are_told_in_order(scene: DoorScene) -> None:
    """Open at 1 s and again at 5 s, and only then the report that it was closed at 3 s: it opened twice."""
    scene.add_rule("opened", {**BASE, "pattern": "O", "define": {"O": "type = 'open'"}, "partition_by": "instance", "emit": "opened",
                              "measures": {"was": "O.previous", "for_s": "O.duration_s"}})  # fmt: skip
    scene.add_rule("edges", {"input": {"object_state": "door"}, "emit": {"open": "noticed"}})
    scene.world.run("update semap.source set lateness = '3 s' where source_id = %s", scene.door_source_id)
    with running_worker(scene.world.dsn):
        for value, at_s in (("closed", 0), ("open", 1), ("open", 5), ("closed", 3)):
            scene.door(value, at_s)
        scene.watermark(10)
        await_progress(scene.world.dsn)
    found = scene.world.rows(
        "select extract(epoch from stamp)::float8, measures from semap.event where type = 'opened' order by seq"
    )
    assert found == [(1.0, {"was": "closed", "for_s": 1.0}), (5.0, {"was": "closed", "for_s": 2.0})]
    assert [row[3] for row in scene.events("noticed")] == [1.0, 5.0]


def test_what_the_log_shows_is_seen_before_it_is_looked_up(scene: DoorScene) -> None:
    """The numbers of a transaction: one that is over, one under way, one to come."""
    world = scene.world
    assert world.one("select semap.is_visible((txid_current() - 1) %% 4294967296)")
    newest = world.one("select txid_current()")
    assert not world.one("select semap.is_visible(%s)", (newest + 100) % 2**32)
    with connect(world.dsn, autocommit=False) as other:
        (under_way,) = other.execute("select txid_current()").fetchone()
        assert not world.one("select semap.is_visible(%s)", under_way % 2**32)
        other.commit()
    assert world.one("select semap.is_visible(%s)", under_way % 2**32)


def test_what_is_about_a_room_is_a_row_of_that_room_for_other_rules(scene: DoorScene) -> None:
    """Ann comes out of the west; the match ends in the east, and is told of the west."""
    scene.world.run("delete from semap.rule")
    moved = {
        "input": "track_in_room", "where": "type = 'began'", "partition_by": "track", "pattern": "R H",
        "define": {"R": "instance = 'west'", "H": "instance = 'east'"}, "emit": "went",
    }  # fmt: skip
    closed = {
        "input": [{"rule": "out_of_west"}, "door"], "partition_by": "room", "pattern": "L followed by C",
        "define": {"L": "input = 'out_of_west'", "C": "type = 'closed'"}, "within": "9 s", "emit": "closed_after",
    }  # fmt: skip
    scene.add_rule("into_east", moved)
    scene.add_rule("out_of_west", {**moved, "about": "R", "emit": "came_out"})
    scene.add_rule("closed_after", closed)
    with running_worker(scene.world.dsn):
        scene.passage(100)
        scene.watermark(150)
        await_progress(scene.world.dsn)
    rows = scene.world.rows("select type, instance_name, key ->> 'room' from semap.event order by seq")
    assert rows == [("went", "east", None), ("came_out", "west", None), ("closed_after", "gate", "west")]
