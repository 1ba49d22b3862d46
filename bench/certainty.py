"""What it costs to ask one thing of one state, as triggers do: a condition, a distance, a probability.

python -m bench.certainty DSN     prints a line of JSON for each case
"""

from __future__ import annotations

import json
import sys
import time

import psycopg

from bench.figure import as_json, figure
from semap.store.conditions import compiled

ROUNDS = 5
CONDITION = {
    "op": "and",
    "args": [
        {"op": "<>", "args": [{"property": "attributes.kind"}, "lab"]},
        {"op": ">=", "args": [{"property": "attributes.seats"}, 0]},
    ],
}
ROOM = "'POLYGON((0 0,5 0,5 3,4 3,4 4,0 4,0 0))'"
DISC = "st_buffer(st_point(2.5, 2), 2, 'quad_segs={}')"
CASES = {
    "a condition of two comparisons": (
        20_000,
        ROOM,
        "(select semap.condition_holds(condition_id, said, name, '', attributes) from semap.condition)::int",
    ),
    "the distance alone, 6 corners": (20_000, ROOM, "semap.signed_distance_m(shape, x_m, y_m)"),
    "the distance by an ellipse, 6 corners": (
        20_000,
        ROOM,
        "semap.stretched_distance_m(st_boundary(shape), x_m, y_m, 0.5, 0.1, x_m)",
    ),
    "6 corners, error 10 cm": (
        5_000,
        ROOM,
        "(semap.probability_inside(shape, x_m, y_m, 0.01, 0, 0.01)).probability",
    ),
    "6 corners, error 50 cm": (
        5_000,
        ROOM,
        "(semap.probability_inside(shape, x_m, y_m, 0.25, 0, 0.25)).probability",
    ),
    "40 corners, error 50 cm": (
        1_000,
        DISC.format(10),
        "(semap.probability_inside(shape, x_m, y_m, 0.25, 0, 0.25)).probability",
    ),
    "5,000 corners, error 10 cm": (
        200,
        DISC.format(1250),
        "(semap.probability_inside(shape, x_m, y_m, 0.01, 0, 0.01)).probability",
    ),
}
"""How many states, the shape, and what is asked of each state."""


def measure(dsn: str) -> list[dict[str, object]]:
    made = compiled(CONDITION, "track")
    with psycopg.connect(dsn) as connection, connection.transaction(force_rollback=True):
        connection.execute("insert into semap.map (name, uid) values ('asked', gen_random_uuid())")
        connection.execute(
            "select semap.keep_condition(map_id, 'track', %s, %s, %s) from semap.map where name = 'asked'",
            [json.dumps(CONDITION), made.sql, list(made.said)],
        )
        return [{"case": name, "us": figure(_times_us(connection, *case), 1)} for name, case in CASES.items()]


def _times_us(connection: psycopg.Connection, count: int, shape: str, asked: str) -> list[float]:
    """Positions are spread over the shape and what is around it."""
    connection.execute(
        "create temp table if not exists asked (shape public.geometry, x_m float8, y_m float8, name text,"
        " attributes jsonb);"
        " truncate asked"
    )
    connection.execute(
        f"insert into asked select ({shape})::public.geometry,"
        " 5 * (n * 0.6180339887 % 1), 4 * (n * 0.7548776662 % 1),"
        " 'chair ' || n, jsonb_build_object('kind', 'oak', 'seats', n % 4)"
        f" from generate_series(1, {count}) n"
    )
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        connection.execute(f"select sum({asked}) from asked").fetchone()
        times.append((time.perf_counter() - start) * 1e6 / count)
    return times


if __name__ == "__main__":
    for line in as_json(measure(sys.argv[1])):
        print(json.dumps(line), flush=True)
