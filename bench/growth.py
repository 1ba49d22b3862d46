"""What a state costs as one thing grows and all others stay: regions, tracks, states that are stored.

Each size is a database of its own, and rounds go through the sizes of a series in turn, so that what else the
machine does meets all of them.

regions  The building grows, with as many rooms at any place as before; 1,000 tracks walk all over it.
tracks   In 1,000 rooms, never more than 1,000 tracks of one source, which sends a frame (each of them
         once) in one batch. Fewer tracks send several frames in a batch, 1,000 states, as a replay does.
tracks of one source  A frame of more than 1,000 tracks is sent in several batches.
tracks in a frame     Each frame is a track batch, however many tracks it has.
stored   1,000 rooms and tracks; half of the states lie in the five days before, half in the partition that is
         written to, right before the first new one.

A batch is 1,000 states, all tracks march without pause, and each batch is committed durably. Regions and
stored states are written as they would lie there, past the triggers that would make them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psycopg
from numpy.typing import NDArray
from semap_ingest.track_batch import send_batch

from bench.copies import copied, without_slots
from bench.crowd import RATE_HZ, Floor, build_map, framed, source_of, walk
from bench.figure import Figure, Rows
from bench.in_turn import BATCH, Case, compare, thousands
from semap.picture.figure import FAINT, TRACKS, new_figure, save
from semap.store.database.connection import connect
from semap.timeline.stamp import parse_stamp

PICTURE = Path(__file__).with_suffix(".png")
ROOMS = Floor(40, 25)
FIRST = "2026-01-10T12:00:00Z"
FIRST_US = parse_stamp(FIRST)
PAST_DAYS = 5
GOAL = 1.3

REGIONS = """
    with made as (
      insert into semap.region (query_id, query_name, instance_id, instance_uid, instance_name, map_id,
                                footprint, z_min_m, z_max_m, enter_confirm, leave_confirm, stateful)
      select q.query_id, q.name, n, gen_random_uuid(), 'room ' || n, q.map_id, f.area::public.geometry,
             0, 3, '0', '0', false
      from unnest(%(rooms)s::text[]) with ordinality f (area, n) cross join semap.continuous_query q
      where q.map_id = %(map_id)s
      returning region_id)
    select semap.index_regions(array_agg(region_id)) from made
"""
STORED = """
    insert into semap.state_chunk (source_id, from_stamp, to_stamp, states, track_ids, x_m, y_m, z_m, std_m)
    select k.source_id, s.stamp, s.stamp, count(*), array_agg(k.track_id), array_agg(200 * random()),
           array_agg(100 * random()), array_agg(1::float8), array_agg(0.05::real)
    from generate_series(%(frames)s::bigint, 1, -1) frame cross join semap.track k
    cross join lateral (
      select %(last)s::timestamptz - interval '1 d' * %(days)s - frame * interval '66667 us' as stamp) s
    where k.track_id = any (%(track_ids)s::bigint[])
    group by k.source_id, s.stamp
"""


@dataclass(frozen=True)
class Extent:
    """What sizes are measured, in how many rounds, of at least how many batches each."""

    regions: Sequence[int] = (100, 1_000, 10_000, 100_000)
    tracks: Sequence[int] = (10, 100, 1_000, 10_000, 100_000)
    stored: Sequence[int] = (0, 5_000_000, 50_000_000)
    rounds: int = 5
    batches: int = 60


SMALLEST = Extent((100, 200), (10, 2_000), (0, 10_000), rounds=2, batches=2)


Build = Callable[[psycopg.Connection, int, Extent], Case]


def measure(dsn: str, extent: Extent, picture: Path = PICTURE) -> Rows:
    """A row for each size of each series, and a picture of all; nobody else is connected to the database."""
    without_slots(dsn)
    sizes = {
        "regions": extent.regions,
        "tracks": extent.tracks,
        "tracks of one source": [size for size in extent.tracks if size >= BATCH],
        "tracks in a frame": [size for size in extent.tracks if size >= BATCH],
        "stored": extent.stored,
    }
    rows: Rows = []
    for title, build in SERIES.items():
        rows += _series(dsn, title, build, sizes[title], extent)
    draw(rows, picture)
    return rows


def _series(dsn: str, title: str, build: Build, sizes: Iterable[int], extent: Extent) -> Rows:
    with ExitStack() as stack:
        cases = []
        for size in sizes:
            own = stack.enter_context(copied(dsn, f"{title.replace(' ', '_')}_{size}"))
            cases.append(build(stack.enter_context(connect(own)), size, extent))
            print(f"  {size:,} {title}: ready", flush=True)
        rows = compare(cases, extent.rounds)
    return [{"grows": title, **row} for row in rows]


def _of_regions(connection: psycopg.Connection, size: int, extent: Extent) -> Case:
    columns = max(count for count in range(1, int(size**0.5) + 1) if size % count == 0)
    return _case(connection, size, Floor(columns, size // columns), BATCH, BATCH, extent)


def _of_tracks(connection: psycopg.Connection, size: int, extent: Extent) -> Case:
    return _case(connection, size, ROOMS, size, min(size, BATCH), extent)


def _of_one_source(connection: psycopg.Connection, size: int, extent: Extent) -> Case:
    return _case(connection, size, ROOMS, size, size, extent)


def _in_a_frame(connection: psycopg.Connection, size: int, extent: Extent) -> Case:
    track_ids = _building(connection, ROOMS, size, size)
    per_round = max(round(extent.batches * BATCH / size), min(round(RATE_HZ), extent.batches))
    places = walk(ROOMS, size, (extent.rounds + 1) * per_round, pause_s=0)
    frames = framed(source_of(connection, track_ids), track_ids, places, FIRST_US)
    return Case({"size": size}, connection, iter(frames), per_round, send_batch, size)


def of_stored(connection: psycopg.Connection, size: int, extent: Extent) -> Case:
    case = _case(connection, size, ROOMS, BATCH, BATCH, extent)
    track_ids = [each for (each,) in connection.execute("select track_id from semap.track order by 1")]
    connection.execute("set session_replication_role = replica")
    for days in range(PAST_DAYS, -1, -1):
        share = size // 2 if days == 0 else size // 2 // PAST_DAYS
        values = {"last": FIRST, "days": days, "frames": share // BATCH, "track_ids": track_ids}
        connection.execute(STORED, values)
    connection.execute("set session_replication_role = origin")
    connection.execute("select semap.compact_all(array(select source_id from semap.source))")
    return case


SERIES: dict[str, Build] = {
    "regions": _of_regions,
    "tracks": _of_tracks,
    "tracks of one source": _of_one_source,
    "tracks in a frame": _in_a_frame,
    "stored": of_stored,
}


def _case(
    connection: psycopg.Connection, size: int, floor: Floor, tracks: int, per_source: int, extent: Extent
) -> Case:
    """Rooms, tracks, and the states to come: at least a second a round, in which all places are written."""
    track_ids = _building(connection, floor, tracks, per_source)
    per_round = max(extent.batches, round(RATE_HZ) * tracks // BATCH) if tracks > BATCH else extent.batches
    frames = -(-(extent.rounds + 1) * per_round * BATCH // tracks)
    places = walk(floor, tracks, frames, pause_s=0)
    return Case({"size": size}, connection, thousands(track_ids, places, FIRST_US), per_round)


def _building(
    connection: psycopg.Connection, floor: Floor, tracks: int, per_source: int
) -> NDArray[np.int64]:
    """Rooms and tracks, whose ids it gives, and partitions for all days."""
    map_id, track_ids = build_map(connection, "floor", [], tracks, per_source)
    put_regions(connection, map_id, [room.wkb_hex for room in floor.rooms()])
    connection.execute(
        "select semap.ensure_partitions(array(select %s::date - n from generate_series(0, %s) n))",
        [FIRST[:10], PAST_DAYS],
    )
    return track_ids


def put_regions(connection: psycopg.Connection, map_id: int, areas: Sequence[str]) -> None:
    """Let the map's query be about these areas (WKB in hexadecimal), as if each were an instance."""
    connection.execute(REGIONS, {"rooms": list(areas), "map_id": map_id})


def draw(rows: Rows, path: Path) -> None:
    """The cost of a state over the size, a panel for each series: medians, least and most."""
    titles = list(dict.fromkeys(str(row["grows"]) for row in rows))
    canvas = new_figure(12, 2.8, path)
    for number, (title, axes) in enumerate(
        zip(titles, canvas.subplots(1, len(titles), squeeze=False)[0], strict=True)
    ):
        own = [row for row in rows if row["grows"] == title]
        x = [max(int(str(row["size"])), 1) for row in own]
        rounds = [np.array(each.rounds) for row in own if isinstance(each := row["us_per_state"], Figure)]
        y = np.array([np.median(each) for each in rounds])
        spread = [y - [each.min() for each in rounds], [each.max() for each in rounds] - y]
        axes.axhline(GOAL * y[0], color=FAINT, linestyle="--")
        axes.errorbar(x, y, spread, color=TRACKS[number], marker="o", markersize=4, capsize=3)
        axes.set_xscale("symlog", linthresh=min(size for size in x if size > 1))
        axes.set(ylim=(0, None), title=title)
        axes.set_xticks(x, [f"{row['size']:,}" for row in own], rotation=30)
        axes.minorticks_off()
    canvas.axes[0].set_ylabel("µs for a state")
    save(canvas, path)
