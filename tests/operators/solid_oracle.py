"""Pairs of concave solids, and what manifold3d's booleans say about them: an oracle for the predicates on meshes.

Shapes lie on a lattice of eighths of a metre, so that faces, edges and corners that touch do so exactly;
a pose moves both solids of a pair alike or, for the pairs in general position, each for itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import manifold3d
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semap.geometry.tin import mesh_to_wkb
from semap.model.building import Mesh

TOLERANCE_M = 1e-6
STEP_M = 0.125
SEARCH_M = 100.0

# rounding leaves slivers of some 1e-13 m3 by the faces that touch
NOTHING_M3 = 1e-11

Solid = manifold3d.Manifold


@dataclass(frozen=True)
class Truth:
    """What holds for a pair (a, b); None where the pair lies within the band around the tolerance."""

    contains: bool | None
    overlaps: bool | None
    intersects: bool | None
    distance_m: float


def box(size_m: tuple[float, float, float], corner_m: tuple[float, float, float]) -> Solid:
    return Solid.cube(size_m).translate(corner_m)


def lattice(random: Generator, low: int, high: int) -> float:
    return float(random.integers(low, high + 1)) * STEP_M


def prism(outline_m: list[tuple[float, float]], height_m: float) -> Solid:
    return Solid.extrude(manifold3d.CrossSection([outline_m]), height_m)


def l_shape(random: Generator) -> Solid:
    x, y = lattice(random, 4, 16), lattice(random, 4, 16)
    return box((x + 1, 1, 1), (0, 0, 0)) + box((1, y + 1, lattice(random, 4, 16)), (0, 0, 0))


def u_shape(random: Generator) -> Solid:
    gap, depth = lattice(random, 4, 16), lattice(random, 4, 16)
    return box((gap + 2, depth + 1, 1), (0, 0, 0)) - box((gap, depth, 1), (1, 1, 0))


def ring(random: Generator) -> Solid:
    hole = lattice(random, 4, 16)
    return box((hole + 2, hole + 2, lattice(random, 4, 12)), (0, 0, 0)) - box((hole, hole, 9), (1, 1, -1))


def hollow(random: Generator) -> Solid:
    hole = lattice(random, 4, 16)
    return box((hole + 2, hole + 2, hole + 2), (0, 0, 0)) - box((hole, hole, hole), (1, 1, 1))


def star(random: Generator) -> Solid:
    points = int(random.integers(4, 9))
    angles = np.arange(2 * points) * np.pi / points
    radii = np.where(np.arange(2 * points) % 2, 1.0, 2.5)
    outline = np.round(np.column_stack([np.cos(angles), np.sin(angles)]) * radii[:, None] / STEP_M) * STEP_M
    return prism([(float(x), float(y)) for x, y in outline], lattice(random, 4, 16))


def fine_box(random: Generator) -> Solid:
    return box((2, lattice(random, 8, 24), 2), (0, 0, 0)).refine(int(random.integers(2, 4)))


def boxes(random: Generator) -> Solid:
    whole = Solid()
    for _ in range(int(random.integers(2, 6))):
        size = (lattice(random, 4, 20), lattice(random, 4, 20), lattice(random, 4, 20))
        whole += box(size, (lattice(random, -12, 12), lattice(random, -12, 12), lattice(random, -12, 12)))
    return whole


SHAPES: tuple[Callable[[Generator], Solid], ...] = (l_shape, u_shape, ring, hollow, star, fine_box, boxes)


def shape(random: Generator) -> Solid:
    return SHAPES[int(random.integers(len(SHAPES)))](random)


def without_sheets(solid: Solid) -> Solid:
    """The solid without parts that have no volume, which booleans of touching solids leave behind."""
    whole = Solid()
    for part in solid.decompose():
        if part.volume() > STEP_M**3 / 8:
            whole += part
    return whole


def random_pose(random: Generator, reach_m: float) -> NDArray[np.float64]:
    """map_T_solid as (3, 4): any rotation, and a translation of up to reach_m on each axis."""
    turned = Rotation.random(random_state=int(random.integers(2**31))).as_matrix()
    return np.column_stack([turned, random.uniform(-reach_m, reach_m, 3)])


def moved(solid: Solid, pose: NDArray[np.float64]) -> Solid:
    """The solid with its corners carried by the pose in double precision, its triangles as they were."""
    corners, faces = corners_and_faces(solid)
    return from_corners(corners @ pose[:, :3].T + pose[:, 3], faces)


def corners_and_faces(solid: Solid) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    mesh = solid.to_mesh64()
    return np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3], np.asarray(
        mesh.tri_verts, dtype=np.int64
    )


def from_corners(corners_m: NDArray[np.float64], faces: NDArray[np.int64]) -> Solid:
    return Solid(manifold3d.Mesh64(vert_properties=corners_m, tri_verts=faces.astype(np.uint64)))


def wkb(solid: Solid) -> bytes:
    corners, faces = corners_and_faces(solid)
    return mesh_to_wkb(Mesh(corners, faces))


def nested(random: Generator) -> tuple[Solid, Solid]:
    """A solid, and a thing cut out of it that touches it from inside, or one that is free within."""
    a = shape(random)
    low, high = np.array(a.bounding_box()).reshape(2, 3)
    corner = low + (high - low) * random.uniform(0, 0.7, 3)
    corner = np.round(corner / STEP_M) * STEP_M
    size = np.round((high - low) * random.uniform(0.1, 0.6, 3) / STEP_M + 1) * STEP_M
    b = without_sheets(a ^ box(tuple(size), tuple(corner)))
    return (a, b) if not b.is_empty() else (a, a)


def on_lattice(random: Generator) -> tuple[Solid, Solid]:
    """Two shapes that lie anyhow on the lattice: they often touch along faces, edges and corners."""
    low, high = -24, 24
    return shape(random), shape(random).translate(
        (lattice(random, low, high), lattice(random, low, high), lattice(random, low, high))
    )


def side_by_side(random: Generator) -> tuple[Solid, Solid]:
    """Boxes touch: a thing on another, edge to edge, or corner to corner, as the shapes have it."""
    a, b = shape(random), shape(random)
    low_a, high_a = np.array(a.bounding_box()).reshape(2, 3)
    low_b, _ = np.array(b.bounding_box()).reshape(2, 3)
    touching = random.integers(1, 8)
    offset = np.where([touching & 1, touching & 2, touching & 4], high_a - low_b, low_a - low_b)
    return a, b.translate(tuple(np.round(offset / STEP_M) * STEP_M))


def plugged(random: Generator) -> tuple[Solid, Solid]:
    """A hollow, and a thing that fills it exactly, partly, or is larger than it."""
    a = hollow(random)
    low, high = np.array(a.bounding_box()).reshape(2, 3)
    grown = float(random.integers(-1, 2)) * STEP_M
    return a, box(tuple(high - low - 2 + 2 * grown), tuple(low + 1 - grown))


def identical(random: Generator) -> tuple[Solid, Solid]:
    a = shape(random)
    return a, a


def anyhow(random: Generator) -> tuple[Solid, Solid]:
    """Each in a pose of its own: crossing, apart, or one within a hollow or a large box."""
    a, b = shape(random), shape(random)
    if random.random() < 0.4:
        b = b.scale((0.2, 0.2, 0.2))
    return moved(a, random_pose(random, 0.0)), moved(b, random_pose(random, float(random.uniform(0, 3))))


PLACEMENTS: tuple[Callable[[Generator], tuple[Solid, Solid]], ...] = (
    nested, on_lattice, side_by_side, plugged, identical, anyhow, anyhow,
)  # fmt: skip


def pair(seed: int) -> tuple[Solid, Solid]:
    """The pair of a seed, half of the pairs carried into a pose without round coordinates."""
    random = np.random.default_rng(seed)
    a, b = PLACEMENTS[seed % len(PLACEMENTS)](random)
    if random.random() < 0.5:
        pose = random_pose(random, 50.0)
        a, b = moved(a, pose), moved(b, pose)
    return (b, a) if random.random() < 0.3 else (a, b)


def truth(a: Solid, b: Solid) -> Truth:
    """What manifold3d says; nothing about volumes where its two booleans do not add up to the solid b."""
    outside_m3, shared_m3, gap_m = (b - a).volume(), (a ^ b).volume(), a.min_gap(b, SEARCH_M)
    sure = abs(outside_m3 + shared_m3 - b.volume()) < NOTHING_M3
    return Truth(
        contains=_below(outside_m3, NOTHING_M3) if sure else None,
        overlaps=_not(_below(shared_m3, NOTHING_M3)) if sure else None,
        intersects=_below(gap_m, TOLERANCE_M),
        distance_m=gap_m,
    )


def _below(value: float, limit: float) -> bool | None:
    return None if limit / 10 < abs(value) < limit * 10 else abs(value) < limit


def _not(value: bool | None) -> bool | None:
    return None if value is None else not value
