"""The simulated office as a map that semap imports: map.yaml, with a mesh for each room and each door."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from shapely import Polygon

from semap.formats.ply import write_ply
from semap.geometry.prism import extrude
from semap_ingest.simulation.floor import WALL_M, office_floor, office_map_text

LEAF_M = 0.04
"""How thick a leaf looks in the map."""


def write_map(folder: Path) -> Path:
    """Write the map into a new folder; returns its map.yaml."""
    document: dict[str, Any] = yaml.safe_load(office_map_text())
    meshes = folder / "meshes"
    meshes.mkdir(parents=True)
    floor = office_floor()
    for name, room in document["rooms"].items():
        mesh = extrude(Polygon(room.pop("footprint")), 0.0, room.pop("height_m"))
        (meshes / f"{name}.ply").write_bytes(write_ply(mesh))
        room["mesh"] = f"meshes/{name}.ply"
    for name, entry in document["doors"].items():
        door = floor.doors[name]
        half = np.array([door.width_m, LEAF_M if door.hinge else WALL_M]) / 2
        outline = Polygon(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half)
        (meshes / f"{name}.ply").write_bytes(write_ply(extrude(outline, 0.0, door.height_m)))
        entry["mesh"] = f"meshes/{name}.ply"
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False, default_flow_style=None), "utf-8")
    return path
