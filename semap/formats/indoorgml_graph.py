"""The dual graph of IndoorGML: which cells one can go between, and where."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from semap.formats.gml_surface import geometry_of, polygons_of
from semap.formats.gml_tree import LINE, child, children, id_of, name_of, points_of, referred, text_of
from semap.formats.indoorgml_cells import OBSTACLE, ROOM, key_of
from semap.model.building import Finding

SAME_DIGITS = 6
"""Lines whose points agree to these decimals are the same, whichever way they run."""

DOORS = ("ConnectionBoundary", "AnchorBoundary")


@dataclass(frozen=True)
class Place:
    """Where a passage is: a point [m, map frame], the yaw of its wall, and its sizes [m] where known."""

    point_m: tuple[float, float, float]
    yaw_rad: float = 0.0
    sizes_m: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Passage:
    """A transition between two cells; both directions are one.

    cells     keys of both, sorted
    boundary  the boundary of the cells in which the passage lies, where the file names one
    """

    key: str
    name: str | None
    cells: tuple[str, str]
    weight: float | None
    transition: Element
    boundary: Element | None
    ids: Mapping[str, Element]

    @property
    def is_door(self) -> bool:
        """Whether the file says that it is a door."""
        return self.boundary is not None and name_of(self.boundary) in DOORS

    def place(self, scale: float, where: str) -> Place:
        """Where it is, by its boundary, else by its line.

        scale   metres for one unit of the file
        raises  InvalidInput for positions that are none
        """
        at = f"{where}:{self.transition.get(LINE)}"
        if self.boundary is not None:
            geometry = geometry_of(self.boundary, "cellSpaceBoundaryGeometry")
            rings = [] if geometry is None else list(polygons_of(geometry, self.ids, at))
            if rings:
                return _of_boundary(np.concatenate([polygon[0] for polygon in rings]) * scale)
        line = child(self.transition, "geometry")
        if line is None:
            return Place((0.0, 0.0, 0.0))
        return Place(_crossing(points_of(line, at) * scale))


def passages(
    root: Element, ids: Mapping[str, Element], concepts: Mapping[str, str], findings: list[Finding]
) -> tuple[Passage, ...]:
    """Every passage between two cells, once.

    concepts  what each cell is, by its key
    findings  gets what was left out and why
    """
    cells = _cells_of_states(root, ids)
    found: dict[tuple[object, ...], Passage] = {}
    left_out: Counter[str] = Counter()
    for transition in (each for each in root.iter() if name_of(each) == "Transition"):
        ends = sorted(
            cell
            for link in children(transition, "connects")
            if (state := referred(link, ids)) is not None
            and (cell := cells.get(id_of(state) or "", "")) in concepts
        )
        if len(ends) != 2 or ends[0] == ends[1]:
            left_out["they do not connect two cells of this file"] += 1
            continue
        kinds = {concepts[end] for end in ends}
        if OBSTACLE in kinds:
            left_out["they lead into a cell that is not navigable"] += 1
            continue
        if ROOM not in kinds:
            left_out["they lead from one door into another"] += 1
            continue
        boundary = _dual(transition, ids)
        mark = (*ends, None if boundary is None else id_of(boundary), *_line(transition))
        if mark in found:
            left_out["they lead back along another one, which is kept"] += 1
            continue
        found[mark] = Passage(
            id_of(transition) or f"transition {len(found)}",
            text_of(transition, "name"),
            (ends[0], ends[1]),
            _weight(transition),
            transition,
            boundary,
            ids,
        )
    for reason, count in left_out.items():
        findings.append(
            Finding("note", f"{count} transition{'s' if count > 1 else ''}", f"left out: {reason}")
        )
    return tuple(found.values())


def _cells_of_states(root: Element, ids: Mapping[str, Element]) -> dict[str, str]:
    """Keys of cells by keys of states: by the state's duality, else by the cell's."""
    cells: dict[str, str] = {}
    for element in root.iter():
        dual = _dual(element, ids)
        if dual is None:
            continue
        if name_of(element) == "State":
            cells[id_of(element) or ""] = key_of(dual)
        elif name_of(dual) == "State":
            cells.setdefault(id_of(dual) or "", key_of(element))
    return cells


def _dual(element: Element, ids: Mapping[str, Element]) -> Element | None:
    link = child(element, "duality")
    return None if link is None else referred(link, ids)


def _weight(transition: Element) -> float | None:
    try:
        return float(text_of(transition, "weight") or "")
    except ValueError:
        return None


def _line(transition: Element) -> tuple[object, ...]:
    line = child(transition, "geometry")
    points = (
        [] if line is None else points_of(line, f"line {transition.get(LINE)}").round(SAME_DIGITS).tolist()
    )
    return tuple(sorted(tuple(point) for point in points))


def _of_boundary(corners_m: NDArray[np.float64]) -> Place:
    """The middle of its lower edge, along which x runs."""
    flat = corners_m[:, :2]
    start = flat[np.argmax(np.linalg.norm(flat - flat[0], axis=1))]
    end = flat[np.argmax(np.linalg.norm(flat - start, axis=1))]
    along = end - start
    x_m, y_m = (float(part) for part in (start + end) / 2)
    bottom_m, top_m = float(corners_m[:, 2].min()), float(corners_m[:, 2].max())
    return Place(
        (x_m, y_m, bottom_m),
        float(np.arctan2(along[1], along[0])) % np.pi,
        {"width_m": float(np.linalg.norm(along)), "height_m": top_m - bottom_m},
    )


def _crossing(line_m: NDArray[np.float64]) -> tuple[float, float, float]:
    """Where a line leads from one cell into the other: at its inner point, or its middle one of several."""
    point = line_m[len(line_m) // 2] if len(line_m) >= 3 else line_m.mean(axis=0)
    return (float(point[0]), float(point[1]), float(point[2]))
