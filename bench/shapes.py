"""Regions that are hard on the triggers: 5,000 corners each, or all over one another, beside plain rooms.

Each is a floor of 100 regions on which 1,000 tracks march without pause. Rounds of all take turns. They are
imported as any building is, and edited one at a time while nobody writes states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial

import numpy as np
from shapely import Polygon
from shapely.affinity import scale, translate
from sqlalchemy import Engine, text

from bench.copies import copied, without_slots
from bench.crowd import Floor, add_tracks, import_rooms, walk
from bench.figure import Rows, figure, once, timed_ms
from bench.in_turn import Case, compare, thousands
from semap.store.database.connection import connect, open_engine
from semap.store.map.instance_edit import Changes, edit_instance
from semap.timeline.stamp import parse_stamp

ROUNDS = 5
BATCHES = 60
TRACKS = 1000
FLOOR = Floor(10, 10)
CORNERS = 5000
WAVE_M = 0.02
FIRST = "2026-01-03T00:00:00Z"


def plain(regions: int) -> list[Polygon]:
    """Rooms of six corners."""
    return FLOOR.rooms()[:regions]


def many_corners(regions: int) -> list[Polygon]:
    """The same rooms, their walls in waves of a few centimetres inwards."""
    return [wavy(room, CORNERS) for room in plain(regions)]


def over_one_another(regions: int) -> list[Polygon]:
    """One room as large as most of the floor, again and again, each a little further off."""
    width_m, depth_m = FLOOR.size_m()
    room = scale(FLOOR.rooms()[0], 0.8 * width_m / 5, 0.8 * depth_m / 4, origin=(0, 0))
    return [translate(room, 0.2 * width_m * n / regions, 0.2 * depth_m * n / regions) for n in range(regions)]


SHAPES: dict[str, Callable[[int], list[Polygon]]] = {
    "plain rooms": plain,
    f"{CORNERS:,} corners each": many_corners,
    "all over one another": over_one_another,
}


def wavy(outline: Polygon, corners: int) -> Polygon:
    """An outline of axis-parallel walls with so many corners, whose walls recede inwards in waves."""
    points = np.array(outline.exterior.coords)
    lengths_m = np.hypot(*np.diff(points, axis=0).T)
    counts = np.diff(np.rint(np.cumsum([0, *lengths_m]) / lengths_m.sum() * corners)).astype(int)
    walls = []
    for start, end, length_m, count in zip(points[:-1], points[1:], lengths_m, counts, strict=True):
        along = np.arange(count)[:, None] / count
        waves = max(1, round(length_m / 0.2))
        inwards = np.array([start[1] - end[1], end[0] - start[0]]) / length_m
        depth_m = WAVE_M / 2 * (1 - np.cos(2 * np.pi * waves * along))
        walls.append(start + along * (end - start) + depth_m * inwards)
    return Polygon(np.concatenate(walls))


def measure(dsn: str, regions: int = 100, rounds: int = ROUNDS, batches: int = BATCHES) -> Rows:
    """A row for each shape; `dsn` is of a database that nobody else is connected to."""
    without_slots(dsn)
    places = walk(FLOOR, TRACKS, (rounds + 1) * batches, pause_s=0)
    with ExitStack() as stack:
        cases = []
        for number, (title, make) in enumerate(SHAPES.items()):
            own = stack.enter_context(copied(dsn, f"shape_{number}"))
            connection = stack.enter_context(connect(own))
            areas = make(regions)
            import_ms = timed_ms(partial(import_rooms, connection, "floor", areas))
            (map_id,) = connection.execute("select map_id from semap.map").fetchone() or (0,)
            track_ids = add_tracks(connection, map_id, TRACKS, TRACKS)
            connection.execute("select semap.ensure_partitions(array[%s::date])", [FIRST[:10]])
            row = {
                "regions": f"{regions} {title}",
                "import_ms_a_region": once(import_ms / regions, 1),
                "edit_ms": figure(edits_ms(own, areas, rounds), 1),
            }
            cases.append(Case(row, connection, thousands(track_ids, places, parse_stamp(FIRST)), batches))
            print(f"  {row['regions']}: ready", flush=True)
        return compare(cases, rounds)


def edits_ms(dsn: str, areas: Sequence[Polygon], rounds: int) -> list[float]:
    """Times of edits that move the outline of a room by a centimetre, each of another room."""
    engine = open_engine(dsn)
    try:
        return [timed_ms(partial(edit, engine, n, translate(areas[n], 0.01))) for n in range(rounds)]
    finally:
        engine.dispose()


def edit(engine: Engine, number: int, area: Polygon) -> None:
    """Give a room of the only map another outline."""
    with engine.begin() as connection:
        instance_id = connection.scalar(
            text("select instance_id from semap.instance where name = :name"), {"name": f"room {number}"}
        )
        edit_instance(connection, instance_id, Changes(footprint=area))
