"""Edits of the map under load: what latency the batches of a crowd see, and that no change is lost by it.

1,000 tracks report at 15 Hz, each frame one batch. The clock of a batch runs from when it was due to when it
is committed, so that one that an edit holds up delays those behind it. In every other stretch one room is
given another outline each second, as the service does it, so that tracks enter and leave by it.

At the end `differences` counts the relations that are not what ST_Contains says of the present places and the
outlines of the instances, and the changes that do not lead to them: a track enters and leaves a room in turn.
"""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from threading import Event as Signal
from threading import Thread

import numpy as np
import psycopg
import shapely
from semap_ingest.state_copy import COPY_STATES
from shapely.affinity import translate

from bench.crowd import RATE_HZ, Floor, batches, build_map, walk
from bench.figure import Rows, figure, percentiles, timed_ms
from bench.shapes import edit
from semap.store.database.connection import connect, open_engine
from semap.timeline.stamp import parse_stamp

FLOOR = Floor(40, 25)
TRACKS = 1000
ROUNDS = 5
STRETCH_S = 10.0
EDITS_PER_S = 1.0
FIRST = "2026-01-04T00:00:00Z"

DIFFERENCES = """
    with present as (
      select track_id, instance_id from semap.relation where confirmed
    ), wanted as (
      select t.track_id, w.instance_id
      from semap.region_wanted w join semap.track_now t using (map_id)
      where t.live and public.st_contains(w.footprint, public.st_point(t.x_m, t.y_m))
        and t.z_m >= w.z_min_m and t.z_m < w.z_max_m
    ), stepped as (
      select track_id, instance_id, kind = 'began' as begins,
             lag(kind = 'began', 1, false) over pair as holds, lead(kind) over pair is null as is_last
      from semap.relation_change window pair as (partition by track_id, instance_id order by change_id)
    ), told as (
      select track_id, instance_id from stepped where is_last and begins
    )
    select (select count(*) from (table present except table wanted) d)
         + (select count(*) from (table wanted except table present) d)
         + (select count(*) from (table told except table present) d)
         + (select count(*) from (table present except table told) d)
         + (select count(*) from stepped where begins = holds)
"""


@dataclass(frozen=True)
class Stretch:
    """Latencies of batches, and times of the edits meanwhile."""

    delays_ms: list[float]
    edits_ms: list[float]


def measure(
    dsn: str, floor: Floor = FLOOR, tracks: int = TRACKS, rounds: int = ROUNDS, stretch_s: float = STRETCH_S
) -> Rows:
    """A row for the stretches without edits and one for those with; the first stretch warms up."""
    rooms = floor.rooms()
    frames = round(stretch_s * RATE_HZ)
    with connect(dsn) as connection:
        _, track_ids = build_map(connection, "floor", rooms, tracks)
        connection.execute("select semap.ensure_partitions(array[%s::date])", [FIRST[:10]])
        places = walk(floor, tracks, (2 * rounds + 1) * frames, pause_s=0)
        data = batches(track_ids, places, parse_stamp(FIRST))
        _stretch(connection, data[:frames])
        connection.execute("vacuum analyze semap.track_now")
        found: dict[bool, list[Stretch]] = {False: [], True: []}
        for number in range(2 * rounds):
            own = data[(number + 1) * frames : (number + 2) * frames]
            with_edits = number % 2 == 1
            edited = _Editor(dsn, rooms, number) if with_edits else None
            found[with_edits].append(_stretch(connection, own, edited))
        lost = differences(connection)
    return [
        {
            "edits_per_s": EDITS_PER_S if with_edits else 0,
            "batches": sum(len(each.delays_ms) for each in stretches),
            **percentiles([each.delays_ms for each in stretches], 1),
            "edit_ms": figure((np.median(each.edits_ms) for each in stretches), 1) if with_edits else "",
            "edits": sum(len(each.edits_ms) for each in stretches),
            "lost": lost,
        }
        for with_edits, stretches in found.items()
    ]


def differences(connection: psycopg.Connection) -> int:
    """How many relations and changes are not as they should be."""
    connection.execute("select semap.flush_positions(array_agg(source_id)) from semap.source")
    (count,) = connection.execute(DIFFERENCES).fetchone() or (0,)
    return int(count)


class _Editor:
    """Moves the outline of one room after the other by half a metre, until it is told to stop."""

    def __init__(self, dsn: str, rooms: list[shapely.Polygon], seed: int) -> None:
        self.took_ms: list[float] = []
        self._rooms = rooms
        self._dice = np.random.default_rng(seed)
        self._engine = open_engine(dsn)
        self._stop = Signal()
        self._thread = Thread(target=self._run)

    def _run(self) -> None:
        pause_s = 0.5 / EDITS_PER_S
        while not self._stop.wait(pause_s):
            number = int(self._dice.integers(len(self._rooms)))
            area = translate(self._rooms[number], *self._dice.uniform(-0.5, 0.5, 2))
            self.took_ms.append(timed_ms(partial(edit, self._engine, number, area)))
            pause_s = max(0.0, 1 / EDITS_PER_S - self.took_ms[-1] / 1e3)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._engine.dispose()


def _stretch(connection: psycopg.Connection, data: list[bytes], editor: _Editor | None = None) -> Stretch:
    with editor or nullcontext():
        delays_ms = _write(connection, data)
    return Stretch(delays_ms, editor.took_ms if editor else [])


def _write(connection: psycopg.Connection, data: list[bytes]) -> list[float]:
    """From when each batch was due to its commit."""
    delays_ms = []
    started_s = time.monotonic()
    with connection.cursor() as cursor:
        for number, batch in enumerate(data):
            due_s = started_s + number / RATE_HZ
            Signal().wait(max(due_s - time.monotonic(), 0))
            with cursor.copy(COPY_STATES) as copy:
                copy.write(batch)
            delays_ms.append(1e3 * (time.monotonic() - due_s))
    return delays_ms
