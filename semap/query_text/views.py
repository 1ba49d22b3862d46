"""The views of sql/350_query_view.sql: their names, their columns, and what each may be used for."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

from semap.model.predicate import Kind
from semap.model.track_state import COORDINATES, MEASURES

Use = Literal["text", "uid", "id", "map", "attributes", "shape", "moving", "other"]
"""What a column is for: a condition (text, uid, attributes), a relation (shape), or the payload alone."""

TRACK: Mapping[str, Use] = {
    "kind": "other",
    "id": "id",
    "uid": "uid",
    "name": "text",
    "source": "text",
    "map": "map",
    "map_id": "map",
    "stamp": "moving",
    "position": "shape",
    "footprint": "shape",
    **dict.fromkeys((*COORDINATES, *MEASURES), "moving"),
    "concept": "other",
    "concept_id": "other",
    "attributes": "attributes",
}
INSTANCE: Mapping[str, Use] = {
    "kind": "other",
    "id": "id",
    "uid": "uid",
    "name": "text",
    "alias": "text",
    "concept": "text",
    "concept_id": "other",
    "storey": "text",
    "map": "map",
    "map_id": "map",
    "attributes": "attributes",
    "position": "shape",
    "footprint": "shape",
    "footprint_hull": "shape",
    "footprint_box": "shape",
    "axis_aligned_2d": "shape",
    "position_3d": "shape",
    "axis_aligned_3d": "shape",
    "bounding_box": "shape",
    "bounding_hull": "shape",
    "z_min_m": "other",
    "z_max_m": "other",
}
"""The columns of each view in their order."""

ABSTRACTIONS: Mapping[str, str] = {
    "position": "Position2D",
    "footprint": "Footprint",
    "footprint_hull": "FootprintHull",
    "footprint_box": "FootprintBox",
    "axis_aligned_2d": "AxisAligned2D",
    "position_3d": "Position3D",
    "axis_aligned_3d": "AxisAligned3D",
    "bounding_box": "BoundingBox",
    "bounding_hull": "BoundingHull",
}
"""The abstraction that a column of an instance is."""
OF_SPACE = frozenset(("Position3D", "AxisAligned3D", "BoundingBox", "BoundingHull"))

LONGEST_NAME = 63
"""Bytes that PostgreSQL keeps of a name."""


@dataclass(frozen=True)
class View:
    """What one of the views shows; concept None: all instances, or tracks."""

    name: str
    kind: Kind
    concept: str | None = None

    @property
    def columns(self) -> Mapping[str, Use]:
        return TRACK if self.kind == "track" else INSTANCE


def view_name(concept: str) -> str | None:
    """The name of a concept's view: snake case, as `semap.view_name` makes it; None where it has none.

    DiningTable is dining_table, IFCWall is ifc_wall. Signs of ASCII are _.
    """
    snake = re.sub("([A-Z]+)([A-Z][a-z])", r"\1_\2", concept)
    snake = re.sub("([a-z0-9])([A-Z])", r"\1_\2", snake)
    snake = re.sub("[\x01-\x2f\x3a-\x40\x5b-\x60\x7b-\x7f]+", "_", snake)
    lower = re.sub("[A-Z]", lambda found: found.group().lower(), snake).strip("_")
    name = lower.encode()[:LONGEST_NAME].decode(errors="ignore")
    return None if name in ("", "track", "instance") or name.startswith("pg_") else name


def views_of(concepts: Collection[str]) -> Mapping[str, tuple[View, ...]]:
    """By name; more than one where concepts share a name in SQL."""
    found: dict[str, tuple[View, ...]] = defaultdict(tuple)
    found["track"] = (View("track", "track"),)
    found["instance"] = (View("instance", "instance"),)
    for concept in sorted(concepts):
        name = view_name(concept)
        if name is not None:
            found[name] += (View(name, "instance", concept),)
    return dict(found)
