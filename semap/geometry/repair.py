"""Triangle meshes made fit to be asked for an inside, as far as that is certain.

In this order: triangles that name a vertex twice and triangles that are there twice go; the rest of a
surface is wound as its neighbours are; small holes are closed; closed bodies are wound outwards, cavities
inwards. A body inside another stays a body (a cupboard in a room), so that only what is wound inwards in
the open is turned. What is left wrong is named. Nothing moves a vertex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap.model.building import Finding, Mesh

SUBJECT = "mesh"

SMALL_SHARE = 0.02
"""A hole is small if it spans less than this share of the extent of the whole."""

MAX_HOLES = 1_000
MAX_LOOP = 100

MAX_BODIES = 1_000
"""Of more bodies, which lies in which is not asked."""


@dataclass(frozen=True, eq=False)
class _Edges:
    """The undirected edges of a mesh by their triangles.

    pairs      (k, 2) the two triangles of each edge that has just two
    is_even    (k,) whether the two run through it in opposite directions, as they should
    open_ends  (o, 2) directed edges, as wound, that one triangle has alone
    crowded    how many edges have more than two triangles
    """

    pairs: NDArray[np.int64]
    is_even: NDArray[np.bool_]
    open_ends: NDArray[np.int64]
    crowded: int


def repaired(mesh: Mesh) -> tuple[Mesh, tuple[Finding, ...]]:
    """The mesh with what could be repaired, and what was done and what is left.

    mesh  its vertices distinct; at least one triangle
    A mesh that is all degenerate is returned as it is.
    """
    findings: list[Finding] = []
    faces = _without_repeats(mesh.faces, findings)
    if len(faces) == 0:
        return mesh, (Finding("note", SUBJECT, "every triangle is degenerate: the mesh has no surface"),)
    faces = _evenly_wound(faces, findings)
    faces = _with_small_holes_closed(mesh.vertices_m, faces, findings)
    faces = _outwards(mesh.vertices_m, faces, findings)
    _note_what_is_left(faces, findings)
    return Mesh(mesh.vertices_m, faces), tuple(findings)


def _without_repeats(faces: NDArray[np.int64], findings: list[Finding]) -> NDArray[np.int64]:
    a, b, c = faces.T
    sound = faces[(a != b) & (b != c) & (c != a)]
    if len(sound) < len(faces):
        findings.append(
            Finding("repaired", SUBJECT, f"{len(faces) - len(sound)} degenerate triangles removed")
        )
    if len(sound) == 0:
        return np.empty((0, 3), dtype=np.int64)
    # Turned until the lowest index comes first: the same triangle in the same winding is the same row.
    first = np.argmin(sound, axis=1)
    rows = np.take_along_axis(sound, (first[:, None] + np.arange(3)) % 3, axis=1)
    order = np.lexsort(rows.T[::-1])
    is_repeat = np.zeros(len(sound), dtype=bool)
    is_repeat[order[1:]] = (rows[order[1:]] == rows[order[:-1]]).all(axis=1)
    if is_repeat.any():
        findings.append(Finding("repaired", SUBJECT, f"{int(is_repeat.sum())} duplicate triangles removed"))
    kept: NDArray[np.int64] = sound[~is_repeat]
    return kept


def _edges(faces: NDArray[np.int64]) -> _Edges:
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    count = int(faces.max()) + 1
    keys = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(keys, kind="stable")
    firsts = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0]))
    sizes = np.diff(np.append(firsts, len(keys)))
    two, one = firsts[sizes == 2], order[firsts[sizes == 1]]
    first, second = order[two], order[two + 1]
    return _Edges(
        np.column_stack([first // 3, second // 3]),
        start[first] != start[second],
        np.column_stack([start[one], end[one]]),
        int((sizes > 2).sum()),
    )


def _evenly_wound(faces: NDArray[np.int64], findings: list[Finding]) -> NDArray[np.int64]:
    edges = _edges(faces)
    if edges.is_even.all():
        return faces
    # Each triangle twice, as it is and turned; neighbours that agree are joined alike, others crosswise.
    count = len(faces)
    left, right = edges.pairs.T
    cross = np.where(edges.is_even, 0, count)
    rows, columns = (
        np.concatenate([left, left + count]),
        np.concatenate([right + cross, right + count - cross]),
    )
    from scipy.sparse import coo_array  # noqa: PLC0415  slow to import
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415  slow to import

    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(2 * count, 2 * count))
    _, labels = connected_components(graph, directed=False)
    straight, turned = labels[:count], labels[count:]
    if (straight == turned).any():
        findings.append(
            Finding(
                "note", SUBJECT, "a surface has one side only, so that its triangles cannot be wound alike"
            )
        )
    # Of the two windings of a surface, the one that fewer triangles must be turned for.
    sizes = np.bincount(np.minimum(straight, turned), weights=straight < turned)
    others = np.bincount(np.minimum(straight, turned), weights=straight > turned)
    surface = np.minimum(straight, turned)
    flip = np.where(sizes[surface] >= others[surface], straight > turned, straight < turned)
    if flip.any():
        findings.append(
            Finding("repaired", SUBJECT, f"{int(flip.sum())} triangles turned like their neighbours")
        )
    turned_faces: NDArray[np.int64] = np.where(flip[:, None], faces[:, ::-1], faces)
    return turned_faces


def _with_small_holes_closed(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int64], findings: list[Finding]
) -> NDArray[np.int64]:
    edges = _edges(faces)
    # A sheet is open by nature; only what is nearly closed has holes.
    if not 0 < len(edges.open_ends) < 0.1 * len(edges.pairs):
        return faces
    small_m = SMALL_SHARE * float(np.linalg.norm(np.ptp(vertices_m[np.unique(faces)], axis=0)))
    after: dict[int, int] = {}
    forked: set[int] = set()
    for start, end in edges.open_ends.tolist():
        # The hole runs against the triangle beside it.
        if end in after:
            forked.add(end)
        after[end] = start
    caps: list[list[int]] = []
    closed = 0
    while after and closed < MAX_HOLES:
        loop = [next(iter(after))]
        while loop[-1] in after and len(loop) <= MAX_LOOP:
            loop.append(after.pop(loop[-1]))
            if loop[-1] == loop[0]:
                break
        is_loop = len(loop) > 3 and loop[-1] == loop[0] and len(set(loop)) == len(loop) - 1
        if is_loop and not forked & set(loop):
            corners_m = vertices_m[loop[:-1]]
            if float(np.linalg.norm(np.ptp(corners_m, axis=0))) <= small_m:
                caps.extend([loop[0], loop[i], loop[i + 1]] for i in range(1, len(loop) - 2))
                closed += 1
    if closed:
        findings.append(Finding("repaired", SUBJECT, f"{closed} small holes closed"))
        return np.concatenate([faces, np.array(caps, dtype=np.int64)])
    return faces


def _outwards(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int64], findings: list[Finding]
) -> NDArray[np.int64]:
    from scipy.sparse import coo_array  # noqa: PLC0415  slow to import
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415  slow to import

    edges = _edges(faces)
    count = len(faces)
    graph = coo_array((np.ones(len(edges.pairs), dtype=bool), tuple(edges.pairs.T)), shape=(count, count))
    body_count, bodies = connected_components(graph, directed=False)
    is_sound = np.ones(body_count, dtype=bool)
    is_sound[bodies[edges.pairs[~edges.is_even].ravel()]] = False
    has_three = np.bincount(edges.pairs.ravel(), minlength=count) == 3
    is_sound[bodies[~has_three]] = False
    origin = vertices_m[faces].reshape(-1, 3).mean(axis=0)
    a, b, c = (vertices_m[faces[:, i]] - origin for i in range(3))
    volumes = np.bincount(bodies, weights=np.einsum("ij,ij->i", a, np.cross(b, c)))
    inwards = np.flatnonzero(is_sound & (volumes < 0))
    if len(inwards) == 0:
        return faces
    if body_count > 1 and body_count <= MAX_BODIES:
        inwards = np.array(
            [body for body in inwards if not _is_inside(vertices_m, faces, bodies, int(body))], dtype=np.int64
        )
    if len(inwards) == 0:
        return faces
    findings.append(Finding("repaired", SUBJECT, f"{len(inwards)} bodies turned outwards"))
    return np.where(np.isin(bodies, inwards)[:, None], faces[:, ::-1], faces)


def _is_inside(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int64], bodies: NDArray[np.int32], body: int
) -> bool:
    """Whether a corner of one body lies inside the others, by the solid angles of their triangles.

    van Oosterom and Strackee 1983
    """
    point = vertices_m[faces[np.argmax(bodies == body), 0]]
    a, b, c = (vertices_m[faces[bodies != body, i]] - point for i in range(3))
    lengths = [np.linalg.norm(each, axis=1) for each in (a, b, c)]
    bottom = (
        lengths[0] * lengths[1] * lengths[2]
        + np.einsum("ij,ij->i", a, b) * lengths[2]
        + np.einsum("ij,ij->i", b, c) * lengths[0]
        + np.einsum("ij,ij->i", c, a) * lengths[1]
    )
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    return abs(float(np.arctan2(top, bottom).sum())) > np.pi


def _note_what_is_left(faces: NDArray[np.int64], findings: list[Finding]) -> None:
    edges = _edges(faces)
    if len(edges.open_ends):
        findings.append(
            Finding("note", SUBJECT, f"not closed: {len(edges.open_ends)} edges have one triangle only")
        )
    if edges.crowded:
        findings.append(Finding("note", SUBJECT, f"{edges.crowded} edges have more than two triangles"))
