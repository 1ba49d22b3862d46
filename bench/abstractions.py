"""Seconds and memory for all abstractions of a mesh of a million triangles, each in a process of its own.

The shapes are what costs: a ball has every vertex on its hull, a scan folds at every third edge, a room and
a building overlap themselves everywhere.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.figure import once
from semap.geometry.abstractions import derive
from semap.geometry.prism import extrude
from semap.model.building import Mesh

TRIANGLES = 1_000_000
L_ROOM = shapely.Polygon([(0, 0), (20, 0), (20, 8), (9, 8), (9, 14), (0, 14)])
L_HOUSE = shapely.Polygon([(0, 0), (60, 0), (60, 20), (25, 20), (25, 40), (0, 40)])


def measure() -> list[dict[str, object]]:
    """One row for each shape."""
    context = multiprocessing.get_context("spawn")
    rows = []
    for name in SHAPES:
        with context.Pool(1) as pool:
            rows.append(pool.apply(_measured, (name,)))
    return rows


def _measured(name: str) -> dict[str, object]:
    mesh = SHAPES[name]()
    started_s, started_cpu_s = time.perf_counter(), time.process_time()
    found = {each.type: each.geometry for each in derive(mesh)}
    seconds, cpu_seconds = time.perf_counter() - started_s, time.process_time() - started_cpu_s
    hull = found["BoundingHull"]
    assert isinstance(hull, Mesh)
    return {
        "shape": name,
        "triangles": len(mesh.faces),
        "seconds": once(seconds, 2),
        "cpu_seconds": once(cpu_seconds, 2),
        "peak_rss_mb": once(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "abstractions": len(found),
        "footprint_corners": int(shapely.get_num_coordinates(found["Footprint"])),
        "hull_corners": len(hull.vertices_m),
    }


def _sheet(rows: int, columns: int) -> NDArray[np.int64]:
    """The triangles of a grid of vertices."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def _ball(noise_m: float = 0.0, lumps_m: float = 0.0) -> Mesh:
    """A globe of meridians and parallels, closed."""
    rows, columns = TRIANGLES // 1416 + 1, 708
    tilt = np.linspace(0, np.pi, rows + 1)[1:-1]
    turn = np.arange(columns) * 2 * np.pi / columns
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    body = np.concatenate([np.column_stack([np.sin(t) * ring, np.full(columns, np.cos(t))]) for t in tilt])
    vertices_m = np.concatenate([body, [[0.0, 0, 1], [0, 0, -1]]])
    lumps = 1 + lumps_m * np.sin(5 * vertices_m[:, [0]]) * np.cos(4 * vertices_m[:, [2]])
    vertices_m = vertices_m * lumps + np.random.default_rng(0).normal(0, noise_m, vertices_m.shape)
    here = np.arange(columns)
    beside = (here + 1) % columns
    first = np.arange(len(tilt) - 1)[:, None] * columns
    a, b, c, d = first + here, first + columns + here, first + columns + beside, first + beside
    bands = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)
    last, north = (len(tilt) - 1) * columns, len(body)
    top = np.column_stack([here, beside, np.full(columns, north)])
    bottom = np.column_stack([last + beside, last + here, np.full(columns, north + 1)])
    return Mesh(vertices_m, np.concatenate([bands, top, bottom]))


def _terrain() -> Mesh:
    side = int(np.sqrt(TRIANGLES / 2)) + 2
    x, y = (part.ravel() for part in np.meshgrid(*[np.linspace(0, 100, side)] * 2, indexing="ij"))
    noise_m = np.random.default_rng(0).normal(0, 0.08, (side * side, 3))
    return Mesh(np.column_stack([x, y, 5 * np.sin(x / 9) * np.cos(y / 7)]) + noise_m, _sheet(side, side))


def _boxes(count: int, low_m: list[float], high_m: list[float], sizes_m: tuple[float, float]) -> Mesh:
    """Turned boxes in a volume; a third of them not along the axes."""
    random = np.random.default_rng(0)
    box = extrude(shapely.box(-0.5, -0.5, 0.5, 0.5), 0, 1)
    corners_m = box.vertices_m * random.uniform(*sizes_m, (count, 1, 3))
    yaw_rad = random.uniform(0, 2 * np.pi, (count, 1)) * (random.random((count, 1)) < 1 / 3)
    x, y = corners_m[..., 0], corners_m[..., 1]
    turned = [
        x * np.cos(yaw_rad) - y * np.sin(yaw_rad),
        x * np.sin(yaw_rad) + y * np.cos(yaw_rad),
        corners_m[..., 2],
    ]
    places_m = np.stack(turned, axis=-1) + random.uniform(low_m, high_m, (count, 3))[:, None]
    faces = box.faces + len(box.vertices_m) * np.arange(count)[:, None, None]
    return Mesh(places_m.reshape(-1, 3), faces.reshape(-1, 3))


def _furniture() -> Mesh:
    """Round stools of a thousand triangles each, without a floor below them."""
    random = np.random.default_rng(0)
    stool = extrude(shapely.Point(0, 0).buffer(0.5, quad_segs=64), 0, 1)
    parts = []
    for _ in range(TRIANGLES // len(stool.faces)):
        size_m = random.uniform(0.2, 0.8, 3)
        parts.append(stool.vertices_m * size_m + random.uniform([1, 1, 0.5], [8, 7, 2]))
    faces = stool.faces + len(stool.vertices_m) * np.arange(len(parts))[:, None, None]
    return Mesh(np.concatenate(parts), faces.reshape(-1, 3))


def _joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
    )


def _building() -> Mesh:
    slabs = [extrude(L_HOUSE, 3.0 * storey, 3.0 * storey + 0.3) for storey in range(10)]
    return _joined(*slabs, _boxes(TRIANGLES // 12, [0, 0, 0], [60, 20, 30], (0.05, 0.6)))


SHAPES: dict[str, Callable[[], Mesh]] = {
    "ball": _ball,
    "noisy scan of a body": lambda: _ball(0.002, 0.15),
    "noisy terrain": _terrain,
    "furnished room": lambda: _joined(extrude(L_ROOM, 0, 3), _furniture()),
    "furniture alone": _furniture,
    "building of many parts": _building,
}


if __name__ == "__main__":
    for row in measure():
        sys.stdout.write(f"{row}\n")
