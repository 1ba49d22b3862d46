"""How an IfcDoor opens: its leaf, where it has a single one that swings.

IfcDoorTypeOperationEnum: SINGLE_SWING_LEFT has its hinge on the left, SINGLE_SWING_RIGHT on the right, as
seen along the door's own +y, towards which it opens. IFC4 says so of the door or of its IfcDoorType, IFC2X3
of its IfcDoorStyle. Double doors, sliding and folding ones have no leaf here; `operation` keeps what they
are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semap.model.building import Mesh

HINGES = {"SINGLE_SWING_LEFT": "left", "SINGLE_SWING_RIGHT": "right"}
UNSAID = (None, "NOTDEFINED", "USERDEFINED")
UPRIGHT_M = 1.5
"""Parts of a door's body that are lower are no leaf but handles, sills and the like."""


def door_attributes(door: Any, kind: Any, body: Mesh | None, width_m: float | None) -> dict[str, object]:
    """The attributes `operation` and `leaf` of a door, as far as the file tells them.

    kind     its IfcDoorType or IfcDoorStyle, or None
    body     in the door's own frame
    width_m  of the doorway; without it, that of the body
    """
    said = (getattr(entity, "OperationType", None) for entity in (door, kind))
    operation = next((each for each in said if each not in UNSAID), None)
    if operation is None:
        return {}
    attributes: dict[str, object] = {"operation": str(operation)}
    if width_m is None and body is not None:
        width_m = float(np.ptp(body.vertices_m[:, 0]))
    if operation in HINGES and width_m is not None and 0.2 <= width_m <= 10:
        middle_m = _leaf_middle(body, width_m)
        attributes["leaf"] = {
            "hinge": HINGES[operation],
            "width_m": round(width_m, 6),
            "at": [round(each, 6) for each in middle_m],
        }
    return attributes


def _leaf_middle(body: Mesh | None, width_m: float) -> tuple[float, float]:
    """x and y of the middle of the closed leaf in the door's frame; its origin is a corner of the doorway."""
    if body is None:
        return width_m / 2, 0.0
    low, high = body.vertices_m.min(axis=0), body.vertices_m.max(axis=0)
    middle_x = float(low[0] + high[0]) / 2
    # the leaf fills the doorway from side to side; frames and casings are wider
    sides = np.array([middle_x - width_m / 2, middle_x + width_m / 2])
    parts = [part for part in _parts(body) if np.ptp(part[:, 2]) >= UPRIGHT_M]
    misfits = [float(np.abs(_range(part[:, 0]) - sides).sum()) for part in parts]
    if not misfits or min(misfits) > width_m / 4:
        return middle_x, float(low[1] + high[1]) / 2
    return middle_x, float(_range(parts[int(np.argmin(misfits))][:, 1]).mean())


def _range(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([values.min(), values.max()])


def _parts(body: Mesh) -> list[NDArray[np.float64]]:
    """The vertices (n, 3) of each part whose faces share vertices: a leaf only touches its frame."""
    from scipy.sparse import coo_array  # noqa: PLC0415  slow to import
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415  slow to import

    edges = np.concatenate([body.faces[:, :2], body.faces[:, 1:]])
    size = len(body.vertices_m)
    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    count, part = connected_components(links, directed=False)
    return [body.vertices_m[part == each] for each in range(count)]
