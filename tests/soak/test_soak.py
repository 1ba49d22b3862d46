"""Four writers that hand tracks to each other, a map editor and readers at once: no deadlock, no lost change.

`SEMAP_SOAK_S` says for how many seconds: 300 for a full run.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections import Counter
from contextlib import suppress
from typing import Any

import pytest
from busy_building import (
    MAY_WAIT,
    QUERIES,
    ROOMS,
    Done,
    Shift,
    add_query,
    add_room,
    at_work,
    edit,
    read,
    write,
    write_frames,
)
from world import World

from semap.errors import Conflict
from semap.store.operate.doctor.verification import verify
from semap.worker.correcting import correcting
from semap.worker.settling import settling

SECONDS = float(os.environ.get("SEMAP_SOAK_S", "20"))
WORKS: list[tuple[str, Any]] = [("w1", write), ("w2", write), ("w3", write), ("w4", write_frames),
                                ("editor", edit), ("reader 1", read), ("reader 2", read)]  # fmt: skip


def differing(dsn: str) -> list[Any]:
    verification = verify(dsn, lambda said: None)
    with verification.connection:
        while True:
            with suppress(Conflict):
                return [each for each in verification.look(None) if each.differ]


@pytest.mark.slow
@pytest.mark.parametrize("queries", [tuple(QUERIES), MAY_WAIT], ids=["all queries", "positions may wait"])
def test_writers_an_editor_and_readers_for_long(world: World, queries: tuple[str, ...]) -> None:
    world.run("select semap.ensure_partitions(array['2001-09-09'::date])")
    for number in range(ROOMS):
        add_room(world.connection, number)
    for name in queries:
        add_query(world.connection, name)
    context = multiprocessing.get_context("spawn")
    told: Any = context.Queue()
    gate = context.Barrier(len(WORKS) + 1)
    processes = [
        context.Process(
            target=at_work, args=(work, Shift(world.dsn, SECONDS, name, seed, queries), gate, told)
        )
        for seed, (name, work) in enumerate(WORKS)
    ]
    for process in processes:
        process.start()
    gate.wait(120)
    started_s, looked, unflushed = time.time(), 0, 0
    with settling(world.dsn), correcting(world.dsn):
        while time.time() < started_s + SECONDS:
            assert differing(world.dsn) == [], f"while they worked, after {time.time() - started_s:.0f} s"
            looked += 1
            unflushed += world.one("select count(*) from semap.source_count where unflushed > 0")
    done: list[Done] = [told.get(timeout=120) for _ in processes]
    for process in processes:
        process.join(60)
    assert [each.failed for each in done if each.failed] == []
    counts = sum((Counter(each.counts) for each in done), Counter())
    counts["changes"] = world.one("select count(*) from semap.relation_change")
    print(f"{SECONDS:.0f} s: looked {looked} times, saw {unflushed} sources unflushed, {dict(counts)}")  # noqa: T201
    assert world.one("select deadlocks from pg_stat_database where datname = current_database()") == 0
    assert world.one("select count(*) from semap.stored_state") == counts["states"]
    assert counts["states"] > 10 * SECONDS
    assert counts["handed over"] > SECONDS / 10
    assert counts["changes"] > SECONDS
    if queries == MAY_WAIT:
        assert unflushed > 0
    else:
        assert (
            world.one("select count(*) from semap.relation_change where object_track_id is not null")
            > SECONDS
        )
    assert world.one("select count(*) from semap.track where name not like (select name from semap.source s"
                     " where s.source_id = track.source_id) || '-%%'") > 0, "tracks are at other sources"  # fmt: skip
    assert differing(world.dsn) == []
