"""What happens is told with one identity in whatever database, and of each map with one of its own."""

from __future__ import annotations

from itertools import chain

import shapely
from door_scene import PAPER, DoorScene
from rule_work import await_progress, running_worker
from server import database_with_slot
from world import World

from semap.cluster import Cluster
from semap.intake.input_row import map_row
from semap.intake.map_facts import MapFacts
from semap.replication.pgoutput import Change


def play(*scenes: DoorScene) -> list[set[tuple[str, str, str]]]:
    """Type, id and rows of the events of each scene, all of which see the same."""
    dsn = scenes[0].world.dsn
    for scene in scenes:
        for name, document in PAPER.items():
            scene.add_rule(name, document)
    with running_worker(dsn):
        for scene in scenes:
            scene.passage(100, "ann", "bob")
            scene.watermark(300)
        await_progress(dsn)
    return [
        set(
            scene.world.rows(
                "select type, event_id::text, array(select v.uid::text from semap.event_evidence v"
                " where v.event_id = e.event_id order by v.place)::text"
                " from semap.event e where map_id = %s",
                scene.world.map_id,
            )
        )
        for scene in scenes
    ]


def test_no_number_of_a_database_is_in_an_identity(cluster: Cluster, template: str) -> None:
    found = []
    for others in (0, 3):
        with database_with_slot(cluster, template) as dsn:
            for number in range(others):
                other = World(dsn, f"other {number}")
                other.add_room("room", shapely.box(0, 0, 1, 1))
                other.add_track("somebody")
                other.close()
            world = World(dsn)
            found += play(DoorScene(world))
            world.close()
    first, second = found
    assert first == second
    assert {each for each, _, _ in first} >= set(PAPER)


def test_maps_that_are_alike_have_events_of_their_own(database: str) -> None:
    worlds = [World(database, name) for name in ("north", "south", "east", "west")]
    found = play(*map(DoorScene, worlds))
    for world in worlds:
        world.close()
    assert len({tuple(sorted(each for each, _, _ in of_map)) for of_map in found}) == 1
    ids = [event_id for _, event_id, _ in chain(*found)]
    assert len(set(ids)) == len(ids) == 4 * len(found[0])


def facts(map_id: int, instance_id: int, map_uid: str) -> MapFacts:
    known = MapFacts()
    for table, row in (
        ("map", {"map_id": str(map_id), "uid": map_uid}),
        ("concept", {"concept_id": "1", "name": "Room"}),
        ("instance", {"instance_id": str(instance_id), "map_id": str(map_id), "uid": "u", "name": "hall",
                      "concept_id": "1", "attributes": None}),
    ):  # fmt: skip
        known.apply(Change(table, "insert", row))
    return known


def test_a_change_of_the_map_is_known_by_the_uids_of_map_and_instance() -> None:
    here, there = (map_row(number, "added", 5, facts(number, number, "north")) for number in (7, 8))
    other = map_row(7, "added", 5, facts(7, 7, "south"))
    assert here.uid == there.uid
    assert here.uid != other.uid


def test_a_map_that_went_while_nobody_worked_holds_up_no_other(database: str) -> None:
    """Of what it had the log still tells, and nothing else does."""
    gone, kept = (DoorScene(World(database, name)) for name in ("gone", "kept"))
    for scene in (gone, kept):
        scene.add_rule("works", {"input": {"map": True}, "emit": {"changed": "rebuilt"}})
    with running_worker(database):
        await_progress(database)
    edit = "update semap.instance set alias = 'other' where instance_id = %s"
    gone.world.run(edit, gone.west_id)
    gone.world.run("delete from semap.map where map_id = %s", gone.world.map_id)
    kept.world.run(edit, kept.west_id)
    with running_worker(database):
        await_progress(database)
    assert kept.world.rows("select type, instance_name from semap.event") == [("rebuilt", "west")]
    for scene in (gone, kept):
        scene.world.close()
