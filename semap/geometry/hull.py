"""Convex hulls in space, of anything from a point to a body.

What is flat has a hull of two sides: its polygon twice, so that the surface is closed and has no volume.
What is collinear has none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from semap.geometry.projection import cross_3d
from semap.model.building import Mesh

FLAT = 1e-9
"""Points are in one plane, on one line or in one place if none is farther from it than this share of their
extent, or than float noise at the place where they are."""

NOISE = 1e-14

SAMPLES = 16
MANY_VERTICES = 50_000
"""From here on a mesh is tried for being convex already: qhull takes seconds for hulls of such a size."""


def convex_hull(points_m: NDArray[np.float64], mesh: Mesh | None = None) -> Mesh | None:
    """The convex hull of points (n, 3), n >= 1, wound outwards; None where they are collinear.

    mesh     the surface that the points are of, if it is one; where it is convex it is its own hull
    returns  corners are some of the points, exactly
    """
    basis = _basis(points_m)
    if basis is None:
        return None
    if mesh is not None and len(points_m) >= MANY_VERTICES and is_convex(mesh):
        return mesh
    _, across, up, is_flat = basis
    if not is_flat:
        from scipy.spatial import QhullError  # noqa: PLC0415  slow to import

        try:
            return _solid(points_m)
        except QhullError:
            # Thicker than float noise, thinner than qhull tells from flat.
            pass
    return _two_sided(points_m, across, up)


def centroid(hull: Mesh) -> NDArray[np.float64]:
    """The centre (3,) of the volume of a closed mesh, or of its area where it has no volume [m]."""
    origin = hull.vertices_m[hull.faces[0, 0]]
    a, b, c = (hull.vertices_m[hull.faces[:, i]] - origin for i in range(3))
    normals = cross_3d(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    volumes = np.einsum("ij,ij->i", a, cross_3d(b, c))
    extent_m = float(np.ptp(hull.vertices_m, axis=0).max())
    if volumes.sum() > FLAT * extent_m * areas.sum():
        shift: NDArray[np.float64] = volumes @ (a + b + c) / (4 * volumes.sum())
    else:
        shift = areas @ (a + b + c) / (3 * areas.sum())
    middle: NDArray[np.float64] = origin + shift
    return middle


def is_convex(mesh: Mesh) -> bool:
    """Whether a mesh is the surface of a convex body, wound outwards.

    It is if it is closed, of one piece, of the topology of a sphere, and no edge is a valley but for float
    noise. Read conservatively: False where there is a doubt.
    """
    for face in mesh.faces[:: max(1, len(mesh.faces) // SAMPLES)]:
        a, b, c = mesh.vertices_m[face]
        height = (mesh.vertices_m - a) @ cross_3d(b - a, c - a)
        if height.max() > 1e-9 * -height.min():
            return False
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    keys = ((np.minimum(start, end) * len(mesh.vertices_m) + np.maximum(start, end)) << 1) | (start > end)
    order = np.argsort(keys)
    first, second = order[::2], order[1::2]
    is_used = np.zeros(len(mesh.vertices_m), dtype=bool)
    is_used[mesh.faces] = True
    if len(keys) % 2 or np.count_nonzero(is_used) - len(first) + len(mesh.faces) != 2:
        return False
    if not np.array_equal(keys[first] + 1, keys[second]):
        return False
    a, b, c = (mesh.vertices_m[mesh.faces[:, i]] for i in range(3))
    normals = cross_3d(b - a, c - a)
    above = np.roll(mesh.faces, 1, axis=1).ravel()[second]
    lengths = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    height = np.einsum(
        "ij,ij->i", mesh.vertices_m[above] - mesh.vertices_m[start[first]], normals[first // 3]
    )
    noise_m = NOISE * float(np.abs(mesh.vertices_m).max())
    return bool((height <= noise_m * lengths[first // 3]).all() and lengths.min() > 0)


def _basis(
    points_m: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], bool] | None:
    """Unit vectors along and across the points and the normal of both, and whether they are flat."""
    noise_m = NOISE * float(np.abs(points_m).max())
    origin = points_m[np.argmin(points_m[:, 0])]
    offsets = points_m - origin
    lengths = np.einsum("ij,ij->i", offsets, offsets)
    along = offsets[np.argmax(lengths)]
    extent_m = float(np.linalg.norm(along))
    limit_m = max(FLAT * extent_m, noise_m)
    if extent_m <= limit_m:
        return None
    along = along / extent_m
    beside = offsets - np.outer(offsets @ along, along)
    widths = np.einsum("ij,ij->i", beside, beside)
    across = beside[np.argmax(widths)]
    width_m = float(np.linalg.norm(across))
    if width_m <= limit_m:
        return None
    across = across / width_m
    normal = cross_3d(along, across)
    is_flat = float(np.abs(offsets @ normal).max()) <= limit_m
    return along, across, normal, is_flat


def _two_sided(
    points_m: NDArray[np.float64], across: NDArray[np.float64], normal: NDArray[np.float64]
) -> Mesh:
    from scipy.spatial import ConvexHull  # noqa: PLC0415  slow to import

    flat = (points_m - points_m[0]) @ np.column_stack([cross_3d(across, normal), across])
    ring = ConvexHull(flat).vertices
    corner = np.arange(1, len(ring) - 1)
    fan = np.column_stack([np.zeros_like(corner), corner, corner + 1])
    return Mesh(points_m[ring], np.concatenate([fan, fan[:, ::-1]]).astype(np.int64))


def _solid(points_m: NDArray[np.float64]) -> Mesh:
    from scipy.spatial import ConvexHull  # noqa: PLC0415  slow to import

    found = ConvexHull(points_m - points_m[0])
    faces = found.simplices.astype(np.int64)
    a, b, c = (points_m[faces[:, i]] for i in range(3))
    inwards = np.einsum("ij,ij->i", cross_3d(b - a, c - a), found.equations[:, :3]) < 0
    faces[inwards] = faces[inwards, ::-1]
    if not _is_closed(faces):
        faces = _rewound(faces, found.neighbors)
    kept = np.unique(faces)
    index_of = np.zeros(len(points_m), dtype=np.int64)
    index_of[kept] = np.arange(len(kept))
    return Mesh(points_m[kept], index_of[faces])


def _is_closed(faces: NDArray[np.int64]) -> bool:
    """Whether each directed edge has exactly one opposite."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = int(faces.max()) + 1
    forth, back = directed @ np.array([count, 1]), directed @ np.array([1, count])
    forth.sort()
    back.sort()
    return bool(np.array_equal(forth, back) and (forth[1:] != forth[:-1]).all())


def _rewound(faces: NDArray[np.int64], neighbours: NDArray[np.int32]) -> NDArray[np.int64]:
    """All faces wound like the largest share of them: slivers do not know their own normal."""
    wound = [tuple(face) for face in faces.tolist()]
    done = np.zeros(len(wound), dtype=bool)
    done[0] = True
    waiting = [0]
    flips = 0
    while waiting:
        face = waiting.pop()
        a, b, c = wound[face]
        edges = {(a, b), (b, c), (c, a)}
        for other in neighbours[face].tolist():
            if not done[other]:
                p, q, r = wound[other]
                if edges & {(p, q), (q, r), (r, p)}:
                    wound[other] = (r, q, p)
                    flips += 1
                done[other] = True
                waiting.append(other)
    result = np.array(wound, dtype=np.int64)
    return result[:, ::-1] if 2 * flips > len(wound) else result
