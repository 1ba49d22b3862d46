"""Facts of the map: kept by the log they are, after each transaction, what history says of that moment."""

from __future__ import annotations

import random
from collections.abc import Iterator

import shapely
from door_scene import DoorScene
from world import World

from semap.intake.map_facts import MapFacts
from semap.intake.stored_facts import load_map_facts
from semap.replication.pgoutput import Transaction, parse_lsn
from semap.replication.stream import open_stream
from semap.store.database.connection import connect
from semap.timeline.stamp import to_datetime
from semap.worker.rule_worker import PUBLICATIONS


def edits(scene: DoorScene, dice: random.Random) -> None:
    """Some edits of the map, a transaction each."""
    world = scene.world
    for number in range(60):
        rooms = world.rows("select instance_id from semap.instance order by 1")
        instance_id = dice.choice(rooms)[0] if rooms else 0
        match dice.randrange(7):
            case 0:
                world.add_room(f"room {number}", shapely.box(20 + number, 0, 21 + number, 1))
            case 1:
                world.run("update semap.instance set attributes = jsonb_build_object('n', %s::int) where instance_id = %s",
                          number, instance_id)  # fmt: skip
            case 2:
                world.run(
                    "update semap.instance set name = %s where instance_id = %s",
                    f"name {number}",
                    instance_id,
                )
            case 3:
                world.run("update semap.instance set concept_id = (select concept_id from semap.concept"
                          " order by md5(concept_id || %s::text) limit 1) where instance_id = %s", number, instance_id)  # fmt: skip
            case 4:
                other_id = dice.choice(rooms)[0] if rooms else 0
                world.run("insert into semap.door_room select %s::bigint, %s::bigint where %s <> %s on conflict do nothing",
                          scene.door_id, other_id, scene.door_id, other_id) if any(
                              row == (scene.door_id,) for row in rooms) else None  # fmt: skip
            case 5:
                world.run("delete from semap.instance where instance_id = %s", instance_id)
            case 6:
                world.run("insert into semap.concept_parent select c.concept_id, p.concept_id from semap.concept c, semap.concept p"
                          " where c.name = 'Table' and p.name = 'Room' on conflict do nothing")  # fmt: skip


def all_of(facts: MapFacts, instance_ids: list[int]) -> dict[int, object]:
    return {instance_id: facts.of(instance_id) for instance_id in instance_ids}


def transactions(world: World, until_lsn: int) -> Iterator[Transaction]:
    """Everything in the log of the worker's slot up to a place."""
    stream = open_stream(world.dsn, world.one("select semap.rule_slot()::text"), PUBLICATIONS, 0)
    try:
        while True:
            for transaction in stream.receive(5.0, limit=1):
                yield transaction
                if transaction.end_lsn >= until_lsn:
                    return
    finally:
        stream.close()


def test_the_log_and_the_history_tell_the_same_after_each_transaction(world: World) -> None:
    scene = DoorScene(world)
    edits(scene, random.Random(11))
    end = parse_lsn(world.one("select pg_current_wal_insert_lsn()::text"))
    world.run("update semap.source set idle = true")
    ids = [id_ for (id_,) in world.rows(
        "select distinct row_key::bigint from semap.row_version where table_name = 'instance'"
    )]  # fmt: skip
    compared = 0
    with connect(world.dsn) as connection:
        facts = load_map_facts(connection, to_datetime(0))
        for transaction in transactions(world, end):
            for change in transaction.changes:
                facts.apply(change)
            facts.settle()
            then = load_map_facts(connection, to_datetime(transaction.committed_at_us))
            assert all_of(facts, ids) == all_of(then, ids)
            compared += 1
    assert compared > 50
    assert any(facts.of(each) is not None for each in ids)


def test_a_door_is_in_the_rooms_that_it_joins_and_a_room_in_itself(world: World) -> None:
    scene = DoorScene(world)
    with connect(world.dsn) as connection:
        facts = load_map_facts(connection)
    (west_uid,), (east_uid,) = world.rows(
        "select concat(m.uid, '/', i.uid) from semap.instance i join semap.map m using (map_id)"
        " where i.instance_id = any (%s) order by i.name = 'east'",
        [scene.west_id, scene.east_id],
    )
    west = {"room": "west", "room_id": scene.west_id, "room_uid": west_uid, "neighbours": ["east"]}
    east = {"room": "east", "room_id": scene.east_id, "room_uid": east_uid, "neighbours": ["west"]}
    gate, room = facts.of(scene.door_id), facts.of(scene.west_id)
    assert gate is not None
    assert room is not None
    assert gate.values["rooms"] == [west, east]
    assert gate.concepts == ("Door", "Opening", "Thing")
    assert {name: room.values[name] for name in west} == west
    assert room.concepts == ("Room", "Space", "Thing")
    assert facts.of(999) is None
