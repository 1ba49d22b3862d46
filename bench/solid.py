"""Time of the predicates on solids, in the database: two spheres of the same number of triangles.

python -m bench.solid DSN     prints a line of JSON for each case
"""

from __future__ import annotations

import json
import sys
import time

import psycopg
import trimesh

from bench.figure import as_json, figure
from semap.geometry.tin import mesh_to_wkb
from semap.model.building import Mesh

ROUNDS = 5
FUNCTIONS = ("contains_3d", "overlaps_3d", "intersects_3d", "distance_3d")


def cases(subdivisions: int) -> dict[str, tuple[trimesh.Trimesh, trimesh.Trimesh]]:
    """By name, a container and a content; the surfaces of the last two touch in part, or all over."""
    large, small = (
        trimesh.creation.icosphere(subdivisions, 2.0),
        trimesh.creation.icosphere(subdivisions, 1.0),
    )

    def at(x: float, y: float, z: float) -> trimesh.Trimesh:
        return small.copy().apply_translation((x, y, z))

    return {
        "boxes apart": (small, at(3, 0.3, 0.2)),
        "surfaces apart": (large, at(0.3, 0.1, 0.0)),
        "crossing": (large, at(1.3, 0.3, 0.2)),
        "touching": (large, at(1.0, 0.0, 0.0)),
        "identical": (small, small),
    }


def measure(dsn: str, subdivisions: int) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    with psycopg.connect(dsn, autocommit=True) as connection:
        for name, pair in cases(subdivisions).items():
            a, b = (mesh_to_wkb(Mesh(each.vertices, each.faces)) for each in pair)
            row: dict[str, object] = {"triangles": len(pair[0].faces), "case": name}
            for function in FUNCTIONS:
                row[f"{function}_ms"] = figure(_times_ms(connection, function, a, b), 1)
            rows.append(row)
    return rows


def _times_ms(connection: psycopg.Connection, function: str, a: bytes, b: bytes) -> list[float]:
    statement = f"select semap.{function}(%s::bytea::public.geometry, %s::bytea::public.geometry)"
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        connection.execute(statement, (a, b)).fetchone()
        times.append((time.perf_counter() - start) * 1e3)
    return times


if __name__ == "__main__":
    for level in (0, 1, 2, 3):
        for line in as_json(measure(sys.argv[1], level)):
            print(json.dumps(line), flush=True)
