"""The stream against a real server: order, acknowledgement, and who may read."""

from __future__ import annotations

import pytest
import shapely
from patience import until
from world import SECOND_US, World

from semap.errors import ServerUnavailable, SlotLost
from semap.replication.pgoutput import Transaction, parse_lsn
from semap.replication.stream import ReplicationStream, SlotInUse, open_stream
from semap.store.database.connection import connect

PUBLICATIONS = ("semap_change", "semap_rule")
PATIENCE_S = 10.0


def receive(stream: ReplicationStream, count: int) -> list[Transaction]:
    got: list[Transaction] = []
    while len(got) < count:
        more = stream.receive(PATIENCE_S)
        assert more, f"only {len(got)} of {count} transactions came"
        got.extend(more)
    return got


def close(stream: ReplicationStream, world: World) -> None:
    """Ends when the server has noticed, so that another may read."""
    stream.close()
    until(
        lambda: not world.one("select active from pg_replication_slots where slot_name = semap.rule_slot()")
    )


def test_transactions_come_in_the_order_of_their_commits_and_again_until_acknowledged(world: World) -> None:
    slot = world.one("select semap.rule_slot()")
    start = parse_lsn(
        world.one("select confirmed_flush_lsn::text from pg_replication_slots where slot_name = %s", slot)
    )
    stream = open_stream(world.dsn, slot, PUBLICATIONS, start)
    assert [[change.table for change in t.changes] for t in receive(stream, 3)] == [
        ["map"],
        ["rule"],
        ["source"],
    ]
    world.add_room("room", shapely.box(0, 0, 1, 1))
    track = world.add_track("t")
    world.copy_states([(track, SECOND_US, 0.5, 0.5, None), (track, 2 * SECOND_US, 2, 2, None)])
    (changes,) = receive(stream, 1)
    relations = [c.row for c in changes.changes if c.table == "relation_change"]
    assert [(row["kind"], row["track_name"], row["instance_name"]) for row in relations] == [
        ("began", "t", "room"),
        ("ended", "t", "room"),
    ]
    close(stream, world)

    again = open_stream(world.dsn, slot, PUBLICATIONS, start)
    assert receive(again, 4)[-1] == changes
    again.acknowledge(changes.end_lsn)
    close(again, world)
    world.run("update semap.rule set enabled = false")
    after = open_stream(world.dsn, slot, PUBLICATIONS, start)
    (disabled,) = receive(after, 1)
    assert disabled.changes[0].row["enabled"] == "f"
    after.close()


def test_a_slot_has_one_reader(world: World) -> None:
    slot = world.one("select semap.rule_slot()")
    stream = open_stream(world.dsn, slot, PUBLICATIONS, 0)
    with pytest.raises(SlotInUse):
        open_stream(world.dsn, slot, PUBLICATIONS, 0)
    stream.close()


def test_a_slot_that_is_gone_is_told_apart(world: World) -> None:
    with pytest.raises(SlotLost) as lost:
        open_stream(world.dsn, "semap_nowhere", PUBLICATIONS, 0)
    assert "semap db resync" in lost.value.remedy


def test_a_lost_connection_is_an_error(world: World) -> None:
    slot = world.one("select semap.rule_slot()")
    stream = open_stream(world.dsn, slot, PUBLICATIONS, 0)
    with connect(world.dsn) as other:
        other.execute(
            "select pg_terminate_backend(active_pid) from pg_replication_slots where slot_name = %s", [slot]
        )
    with pytest.raises(ServerUnavailable):
        receive(stream, 1000)
    stream.close()


def test_the_log_of_unpublished_tables_is_let_go(world: World) -> None:
    """A slot that only ever sees other tables change must not keep the log back."""
    slot = world.one("select semap.rule_slot()")
    stream = open_stream(world.dsn, slot, PUBLICATIONS, 0)
    for transaction in receive(stream, 3):
        stream.acknowledge(transaction.end_lsn)
    world.run("create table public.noise as select generate_series(1, 200000) n")
    target = parse_lsn(world.one("select pg_current_wal_lsn()::text"))
    while stream.acknowledged_lsn < target - 1_000_000:
        assert stream.receive(0.2) == []
    stream.close()
