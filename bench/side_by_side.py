"""semap's triggers and the peers (bench/peers) on the same states: rates, and whether they find the same.

Rounds alternate: each way takes in the same frames before the next frames are begun. One round warms all up.
What a way finds in each round, as which track began or ended to be in which room and when, must equal what
semap's triggers find, or the benchmark fails.

semap takes them as frames, which become rows later, and as rows on a map of its own. It and the peers on
PostGIS are one connection to one server with semap's own settings and commit each frame durably. What else a
peer does and leaves out is said at the top of its file.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray
from semap_ingest.track_batch import send_batch

from bench.crowd import Crowd, Floor, build_map, walk
from bench.figure import figure, once
from bench.in_turn import copy_states
from bench.peers import Changes, Fed, Named, Peer, PeerMissing, ordered, peers
from semap.store.database.connection import connect

ROUNDS = 5
FRAMES = 120
TRACKS = 1000
CROWDS = {"office (pauses up to 30 s)": 30.0, "marching (never pauses)": 0.0}
FIRST_US = 1_767_225_600_000_000


def measure(dsn: str) -> list[dict[str, object]]:
    """A row for each way and crowd: rates [states/s], their ratio to semap's, the changes found."""
    floor = Floor(40, 25)
    rows: list[dict[str, object]] = []
    for name, pause_s in CROWDS.items():
        places = walk(floor, TRACKS, (ROUNDS + 1) * FRAMES, pause_s)
        rows += [{"crowd": name} | row for row in compare(dsn, name, floor.rooms(), places, FRAMES)]
    return rows


def compare(
    dsn: str, name: str, rooms: list[shapely.Polygon], places: NDArray[np.float64], frames: int
) -> list[dict[str, object]]:
    """A row for each way, on a map of that name, in rounds of so many frames; the first warms up."""
    missing: list[dict[str, object]] = []
    with connect(dsn) as connection, ExitStack() as stack:
        triggers, crowd = begin_triggers(connection, name, rooms, places, frames)
        by_rows, _ = begin_triggers(connection, f"{name}, as rows", rooms, places, frames, as_rows=True)
        by_rows.stand_for(crowd)
        ways: dict[str, Peer] = {"semap": triggers, "semap by rows": by_rows}
        for file, module in peers().items():
            try:
                ways[file] = stack.enter_context(module.begin(dsn, crowd, frames))
            except PeerMissing as reason:
                missing.append({"way": file, "note": str(reason)})
        found = rounds_in_turn(ways, len(places) // frames, frames)
        states = frames * len(crowd.track_ids)
        rows = [row for way, fed in found.items() for row in _rows(ways[way].named, fed, found, states)]
    return rows + missing


def rounds_in_turn(ways: Mapping[str, Peer], rounds: int, frames: int) -> dict[str, list[Fed]]:
    """What each way found in each round but the first.

    raises  RuntimeError if one did not find the same as semap
    """
    _agree({way: peer.begun for way, peer in ways.items()}, 0)
    found: dict[str, list[Fed]] = {way: [] for way in ways}
    for number in range(1, rounds):
        for way, peer in ways.items():
            found[way].append(peer.feed(number * frames, frames))
        _agree({way: fed[-1].changes for way, fed in found.items()}, number)
    return found


def _agree(found: Mapping[str, Changes], number: int) -> None:
    wanted = found["semap"]
    for way, changes in found.items():
        if not np.array_equal(changes, wanted):
            counts = f"{len(changes)} and {len(wanted)} changes"
            raise RuntimeError(f"{way} and semap differ in round {number}: {counts}.")


def _rows(
    named: Named, fed: list[Fed], found: Mapping[str, list[Fed]], states: int
) -> list[dict[str, object]]:
    rates = [states / each.seconds for each in fed]
    semap = [states / each.seconds for each in found["semap"]]
    ratios = [rate / of for rate, of in zip(rates, semap, strict=True)]
    measured = {
        "way": named.title,
        "states_per_s": figure(rates),
        "ratio_to_semap": figure(ratios, 3),
        "changes": sum(len(each.changes) for each in fed),
    }
    return [measured, *({"way": f"  {way}", **_one(said)} for way, said in named.slower.items())]


def _one(said: float | str) -> dict[str, object]:
    if isinstance(said, str):
        return {"note": said}
    return {"states_per_s": once(said), "note": "in half of a round, beforehand"}


def begin_triggers(
    connection: psycopg.Connection,
    name: str,
    rooms: list[shapely.Polygon],
    places: NDArray[np.float64],
    frames: int,
    *,
    as_rows: bool = False,
) -> tuple[Triggers, Crowd]:
    """semap's triggers on a new map after the first round, and the crowd whose tracks are known there."""
    map_id, track_ids = build_map(connection, name, rooms, places.shape[1])
    connection.execute("select semap.ensure_partitions(array[date '2026-01-01'])")
    crowd = Crowd(rooms, track_ids, places, FIRST_US)
    return Triggers(connection, map_id, crowd, frames, as_rows=as_rows), crowd


class Triggers:
    """semap's own, as a peer."""

    def __init__(
        self,
        connection: psycopg.Connection,
        map_id: int,
        crowd: Crowd,
        frames: int,
        *,
        as_rows: bool = False,
    ) -> None:
        self.named = Named("semap's triggers" + (", as rows" if as_rows else ""))
        self._connection = connection
        self._map_id = map_id
        self._send: Callable[[psycopg.Cursor, Any], None] = copy_states if as_rows else send_batch
        self._batches: Sequence[Any] = crowd.batches if as_rows else crowd.frames(connection)
        self._first_id = int(crowd.track_ids[0])
        self._shift = 0
        self._last_change = 0
        self.begun = self.feed(0, frames).changes
        connection.execute("vacuum analyze semap.track_now")

    def stand_for(self, crowd: Crowd) -> None:
        """Call the tracks as this crowd does; the ids of both follow on one another."""
        self._shift = int(crowd.track_ids[0]) - self._first_id
        self.begun[:, 0] += self._shift

    def feed(self, first: int, count: int) -> Fed:
        batches = self._batches[first : first + count]
        started_s = time.perf_counter()
        with self._connection.cursor() as cursor:
            for batch in batches:
                self._send(cursor, batch)
        seconds = time.perf_counter() - started_s
        rows = self._connection.execute(
            "select change_id, track_id + %s, substring(instance_name from '\\d+')::int,"
            " (kind = 'began')::int, (extract(epoch from stamp) * 1e6)::bigint"
            " from semap.relation_change where map_id = %s and change_id > %s",
            [self._shift, self._map_id, self._last_change],
        ).fetchall()
        self._last_change = max((row[0] for row in rows), default=self._last_change)
        return Fed(seconds, ordered([row[1:] for row in rows]))
