"""Operators on a map of 100,000 things: how long one question takes.

The things stand in 10,000 rooms on five floors, each turned its own way; a few shared
blueprints give them their shapes. They are made by SQL, and the triggers of the map place them all.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
import psycopg
import shapely
from shapely import Polygon

from bench.figure import once, percentiles
from semap.geometry.abstractions import derive
from semap.geometry.prism import extrude
from semap.model.building import HeightBand
from semap.model.source_geometry import BODY, OUTLINE, SourceGeometry
from semap.store.database.connection import connect, one_transaction
from semap.store.map.description import insert_descriptions, write_descriptions
from semap.store.map.maps import create_map

THINGS = 100_000
ROOMS = 10_000
ROUNDS = 5
QUESTIONS = 100
BATCH = 10_000

CHAIR = Polygon([(-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)])
DESK = Polygon([(-0.8, -0.8), (0.8, -0.8), (0.8, 0), (0, 0), (0, 0.8), (-0.8, 0.8)])
ROOM = Polygon([(0, 0), (10, 0), (10, 6), (8, 6), (8, 8), (0, 8)])

SCATTER = """
    create temporary table scattered as
    select n, 'thing ' || n as name, kind,
           (room %% 40) * 10.0 + case kind when 0 then 0 else 1 + 8 * random() end as x_m,
           (room / 40 %% 50) * 8.0 + case kind when 0 then 0 else 1 + 5 * random() end as y_m,
           (room / 2000) * 3.0 as z_m,
           case kind when 0 then 0 when 3 then floor(4 * random()) * pi() / 2
                     else 2 * pi() * random() end as yaw_rad
    from (select n, case when n <= %(rooms)s then 0 else 1 + n %% 3 end as kind,
                 case when n <= %(rooms)s then n else 1 + (n * 7919) %% %(rooms)s end as room
          from generate_series(1, %(things)s::int) n) placed
"""

PUT = (
    "insert into semap.frame (map_id, name, parent_id)"
    " select %(map_id)s, name, %(root_id)s from scattered where n between %(first)s and %(last)s",
    "insert into semap.frame_pose (frame_id, x_m, y_m, z_m, qz, qw)"
    " select frame_id, x_m, y_m, z_m, sin(yaw_rad / 2), cos(yaw_rad / 2)"
    " from semap.frame f join scattered s using (name)"
    " where f.map_id = %(map_id)s and n between %(first)s and %(last)s",
    "insert into semap.instance (map_id, name, concept_id, frame_id, relative_description_id)"
    " select %(map_id)s, name, semap.concept_named(case kind when 0 then 'Room' else 'Furniture' end),"
    "        frame_id,"
    "        (%(blueprints)s::bigint[])[kind + 1]"
    " from semap.frame f join scattered s using (name)"
    " where f.map_id = %(map_id)s and n between %(first)s and %(last)s",
)

THING = "array[%(thing)s::bigint]"
SPACE = "p_abstraction => 'BoundingHull'"
CALLS = {
    "contained-in, of a room": "in_objects(array[%(room)s::bigint])",
    "contained-in, of a thing": f"in_objects(null, {THING})",
    "contained-in, bodies": f"in_objects(null, {THING}, '3d', true)",
    "nearest 10": f"nearest({THING}, p_count => 10)",
    "nearest 10, in space": f"nearest({THING}, p_count => 10, {SPACE})",
    "nearest 10 to a point": "nearest_to(st_makepoint(%(x)s, %(y)s), %(map_id)s, 10)",
    "within 3 m": f"within_range({THING}, p_max_m => 3)",
    "within 3 m, in space": f"within_range({THING}, p_max_m => 3, {SPACE})",
    "on": f"on_objects({THING})",
    "intersecting": f"intersecting_objects({THING})",
    "left of": f"left_of({THING})",
    "above, half-space": f"above({THING}, p_kind => 'halfspace', p_reach_m => 3)",
    "in an area": "in_area(st_makeenvelope(%(x)s, %(y)s, %(x)s + 5, %(y)s + 5), %(map_id)s)",
}


def measure(dsn: str, things: int = THINGS) -> list[dict[str, object]]:
    """One row for the import, then one for each question: times [ms] and rows of the answer."""
    map_id, seconds = build(dsn, things)
    rows: list[dict[str, object]] = [
        {
            "question": f"put {things} things on the map",
            "p50_ms": once(1000 * seconds),
            "rows": things,
        }
    ]
    with connect(dsn) as connection:
        for name, call in CALLS.items():
            values = _parameters(connection, map_id)
            rows.append({"question": name, **_timed(connection, f"select * from semap.{call}", values)})
    return rows


def build(dsn: str, things: int) -> tuple[int, float]:
    """A map of many things; its id, and how long it took [s]."""
    with one_transaction(dsn) as made:
        map_id = create_map(made, "many things").map_id
        blueprints = insert_descriptions(made, map_id, ["room", "chair", "desk", "box"])
        write_descriptions(
            made,
            [(id_, sources, derive(sources)) for id_, sources in zip(blueprints, _shapes(), strict=True)],
        )
    with connect(dsn) as connection:
        (root_id,) = connection.execute(
            "select frame_id from semap.frame where map_id = %s and name = 'map'", [map_id]
        ).fetchone() or (0,)
        connection.execute("select setseed(0.5)")
        connection.execute(SCATTER, {"things": things, "rooms": min(ROOMS, things // 10)})
        connection.execute("analyze scattered")
        started_s = time.perf_counter()
        for first in range(1, things + 1, BATCH):
            values = {"map_id": map_id, "root_id": root_id, "blueprints": blueprints,
                      "first": first, "last": first + BATCH - 1}  # fmt: skip
            with connection.transaction():
                for statement in PUT:
                    connection.execute(statement, values)
        seconds = time.perf_counter() - started_s
        connection.execute("vacuum analyze semap.abstraction, semap.instance, semap.frame, semap.frame_pose")
    return map_id, seconds


def _shapes() -> Iterator[list[SourceGeometry]]:
    yield [SourceGeometry(OUTLINE, "POLYGON2D", ROOM, band=HeightBand(0, 2.8))]
    yield [SourceGeometry(BODY, "TRIANGLEMESH3D", extrude(CHAIR, 0, 0.9))]
    yield [SourceGeometry(BODY, "TRIANGLEMESH3D", extrude(DESK, 0, 0.75))]
    yield [SourceGeometry(BODY, "TRIANGLEMESH3D", extrude(shapely.box(-0.2, -0.3, 0.2, 0.3), 0, 0.4))]


def _parameters(connection: psycopg.Connection, map_id: int) -> Callable[[], dict[str, object]]:
    dice = np.random.default_rng(1)
    (rooms,), (others,) = (
        connection.execute(
            "select array_agg(instance_id order by instance_id) from semap.instance"
            " where map_id = %s and concept_id = semap.concept_named(%s)", [map_id, concept],
        ).fetchone() or ([],)
        for concept in ("Room", "Furniture")
    )  # fmt: skip
    return lambda: {
        "map_id": map_id,
        "room": rooms[dice.integers(len(rooms))],
        "thing": others[dice.integers(len(others))],
        "x": float(dice.uniform(0, 400)),
        "y": float(dice.uniform(0, 400)),
    }


def _timed(
    connection: psycopg.Connection, statement: str, parameters: Callable[[], dict[str, object]]
) -> dict[str, object]:
    found: list[int] = []
    rounds: list[list[float]] = []
    for _ in range(ROUNDS):
        rounds.append([])
        for _ in range(QUESTIONS):
            values = parameters()
            started_s = time.perf_counter()
            rows = connection.execute(statement, values).fetchall()
            rounds[-1].append(1000 * (time.perf_counter() - started_s))
            found.append(len(rows))
    return {**percentiles(rounds), "rows": round(float(np.mean(found)), 1)}
