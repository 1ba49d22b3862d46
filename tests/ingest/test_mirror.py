"""The mirror of the map: as the map was, and as it becomes."""

from __future__ import annotations

import time
from collections.abc import Callable
from uuid import uuid4

import numpy as np
import shapely
from patience import moment
from semap_ingest.mirror import Follower, count_inside, open_mirror
from world import World

from semap.store.database.connection import connect

PATIENCE_S = 15.0


def await_all(follower: Follower, world: World) -> None:
    """Until the mirror has seen all that is committed now: a concept added last comes last."""
    marker = f"marker {uuid4()}"
    world.run("insert into semap.concept (name) values (%s)", marker)
    until(lambda: any(row["name"] == marker for row in follower.mirror.tables["concept"].copy().values()))


def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        moment()


def test_snapshot_then_changes(world: World) -> None:
    square, moved = shapely.box(0, 0, 4, 4), shapely.box(10, 0, 14, 4)
    world.add_room("before", square)
    world.add_room("goes", shapely.box(20, 20, 21, 21))
    with Follower(world.dsn) as follower:
        assert follower.wait_ready(PATIENCE_S)
        # what others need of the map passes by
        world.run("insert into semap.door_room select min(instance_id), max(instance_id) from semap.instance")
        assert set(follower.footprints("world", "Room")) == {"before", "goes"}
        world.add_room("after", moved)
        world.edit_room("before", moved)
        world.delete_room("goes")
        await_all(follower, world)
        footprints = follower.footprints("world", "Space")
    assert set(footprints) == {"before", "after"}
    assert footprints["before"].equals(moved)
    assert follower.footprints("world", "Agent") == {}
    assert follower.footprints("elsewhere", "Room") == {}


def test_nothing_falls_between_snapshot_and_stream(world: World) -> None:
    """What is committed once the slot exists comes by the stream, if not by the snapshot."""
    mirror, stream = open_mirror(world.dsn)
    world.add_room("late", shapely.box(0, 0, 1, 1))
    while "late" not in mirror.footprints("world", "Room"):
        for transaction in stream.receive(PATIENCE_S):
            for change in transaction.changes:
                mirror.apply(change)
    stream.close()


def test_a_mirror_that_lost_its_connection_starts_anew(world: World) -> None:
    with Follower(world.dsn) as follower:
        assert follower.wait_ready(PATIENCE_S)
        with connect(world.dsn) as other:
            other.execute("select pg_terminate_backend(active_pid) from pg_replication_slots where temporary"
                          " and database = current_database()")  # fmt: skip
        world.add_room("new", shapely.box(0, 0, 1, 1))
        until(lambda: "new" in follower.footprints("world", "Room"))
    # the server lets a slot go a moment after its client went
    until(lambda: not world.rows("select slot_name from pg_replication_slots where temporary"
                                 " and database = current_database() and active"))  # fmt: skip


def test_count_inside() -> None:
    rooms = {"a": shapely.box(0, 0, 2, 2), "b": shapely.box(1, 1, 3, 3)}
    x_m, y_m = np.array([0.5, 1.5, 2.5, 5.0, 0.0]), np.array([0.5, 1.5, 2.5, 5.0, 0.0])
    assert count_inside(rooms, x_m, y_m) == 3
    assert count_inside({}, x_m, y_m) == 0
