"""Who is left out of the watermark for being silent, second by second."""

from __future__ import annotations

import pytest
from door_scene import PAPER, DoorScene
from rule_work import await_event_of, await_progress, running_worker
from world import SECOND_US, World

from semap.worker import stretch
from semap.worker.idleness import Idleness

STAYED = {
    "input": "track_in_room", "partition_by": ["track", "room"], "pattern": "B not followed by L",
    "define": {"B": "type = 'began'", "L": "type = 'ended'"}, "within": "3 s", "emit": "stayed",
}  # fmt: skip


def spoke(idleness: Idleness, source_id: int, at_s: float, map_id: int = 1) -> bool:
    return idleness.spoke(map_id, source_id, round(at_s * SECOND_US), at_s)


def test_a_source_is_idle_while_others_go_on_without_it() -> None:
    idleness = Idleness(10)
    spoke(idleness, 7, 0)
    spoke(idleness, 8, 0)
    assert list(idleness.fallen_silent(30)) == []
    assert not spoke(idleness, 8, 31)
    assert list(idleness.fallen_silent(31)) == [(1, 7)]
    assert list(idleness.fallen_silent(50)) == []
    assert spoke(idleness, 7, 51)
    assert list(idleness.fallen_silent(55)) == [(1, 8)]
    assert list(idleness.fallen_silent(70)) == []


def test_sources_of_other_maps_and_those_that_are_gone_count_for_nothing() -> None:
    idleness = Idleness(10)
    for map_id, source_id, at_s in ((1, 7, 0), (2, 8, 20), (3, 9, 0), (3, 10, 20), (4, 11, 0), (4, 12, 20)):
        spoke(idleness, source_id, at_s, map_id)
    idleness.forget(3, 10)
    idleness.forget_map(4)
    assert list(idleness.fallen_silent(100)) == []


def test_one_that_ended_is_not_silent_but_has_gone_on_without_the_others() -> None:
    idleness = Idleness(10)
    spoke(idleness, 7, 0)
    spoke(idleness, 8, 1)
    idleness.ended(1, 8)
    assert list(idleness.fallen_silent(9)) == []
    assert list(idleness.fallen_silent(10)) == [(1, 7)]


def test_begun_again_a_worker_knows_who_spoke_last() -> None:
    """At 100 s another worker begins; all get their time anew."""
    idleness = Idleness(10, idle=[(1, 9)])
    for source_id, at_s in ((7, 50), (8, 51), (9, 2)):
        idleness.known(1, source_id, at_s * SECOND_US, 100)
    assert list(idleness.fallen_silent(109)) == []
    assert list(idleness.fallen_silent(110)) == [(1, 7)]
    assert spoke(idleness, 9, 111)


def test_a_silent_source_holds_nobody_up_until_it_speaks_again(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The door's source said something once; the tracks go on, and what they do is not kept waiting for it."""
    monkeypatch.setattr(stretch, "Idleness", lambda idle: Idleness(0.0, idle))
    scene = DoorScene(world)
    scene.add_rule("stayed", STAYED)
    scene.add_rule("opened_then_entered", PAPER["opened_then_entered"])
    with running_worker(world.dsn):
        scene.watermark(90)
        scene.passage(101)
        await_progress(world.dsn)
        assert scene.events("stayed") == []
        scene.watermark(150, world.source_id)
        await_progress(world.dsn)
        idle = world.one(
            "select watermarks -> 'maps' -> %s::text -> 'sources' -> %s::text ->> 'idle' from semap.progress",
            str(world.map_id), str(scene.door_source_id),
        )  # fmt: skip
    assert idle == "true"
    noted = world.rows("select name, idle from semap.source order by name")
    assert noted == [("doors", True), ("tracker", False)]
    assert {row[1:3] for row in scene.events("stayed")} == {("ann", "west"), ("ann", "east"), ("bob", "east")}


def test_a_source_that_never_spoke_holds_up_no_recording_that_ended(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The doors were made known and gave nothing; the tracks are over; another worker goes on meanwhile."""
    patience_s = [1000.0]
    monkeypatch.setattr(stretch, "Idleness", lambda idle: Idleness(patience_s[0], idle))
    scene = DoorScene(world)
    scene.add_rule("stayed", STAYED)
    with running_worker(world.dsn):
        scene.walk("ann", [(100, 1, 1), (120, 1, 1)])
        scene.watermark(120, world.source_id)
        world.run("update semap.source set ended = true where source_id = %s", world.source_id)
        await_progress(world.dsn)
    assert scene.events("stayed") == []
    patience_s[0] = 0.0
    with running_worker(world.dsn):
        await_event_of(world.dsn, "ann", "stayed")
    assert scene.events("stayed") == [("stayed", "ann", "west", 103.0)]
