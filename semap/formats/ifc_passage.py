"""Which rooms the ways of an IFC model join that are no doors: stairs, ramps, lifts and openings.

A stair or ramp joins the room at its foot with the one at its head. A lift joins, on each storey, the room
that it stands in or before, wherever its car was drawn. An opening counts where it joins two rooms
and somebody fits through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semap.formats.adjacency import Floor, joined_rooms
from semap.formats.ifc_boundary import LOWEST_M
from semap.model.building import HeightBand

Entity = Any

CONCEPTS = {
    "IfcStair": "Stair",
    "IfcStairFlight": "Stair",
    "IfcRamp": "Ramp",
    "IfcRampFlight": "Ramp",
    "IfcTransportElement": "Lift",
}
LIFT = "Lift"
STEP_M = 0.2
"""The lowest and the highest part of a stair: a step."""

THICK_M = 0.6
"""How far above its lowest part one stands at the foot, at most: a sloping slab reaches below the floor."""

TREAD_M = 0.5
"""The ends of a stair: a tread or two."""

REACH_M = 0.4
"""How far a stair may end before the room that it leads into."""

FOOT_M = 0.5
"""An opening that begins higher above the floor is a window or a hatch."""

CONTACT_M2 = 1e-3


@dataclass(frozen=True)
class Place:
    """A room as ways see it: its outline [m, map frame], heights that it answers for, and its storey."""

    name: str
    footprint: Polygon | MultiPolygon
    band: HeightBand
    storey: str | None


def passage_entities(file: Entity) -> list[tuple[Entity, str]]:
    """Stairs, ramps and lifts as wholes; a flight that is no part of one stands for itself."""
    found: dict[int, tuple[Entity, str]] = {}
    for kind, concept in CONCEPTS.items():
        for entity in file.by_type(kind):
            is_part = any(relation.RelatingObject.is_a() in CONCEPTS for relation in entity.Decomposes)
            if not is_part and _carries_people(entity):
                found[entity.id()] = entity, concept
    return list(found.values())


def parts_of(entity: Entity) -> list[Entity]:
    """The entity, and what it is made of, as far as one walks on it: flights and landings, no railings."""
    parts = [part for relation in entity.IsDecomposedBy for part in relation.RelatedObjects]
    walked = [part for part in parts if part.is_a() in ("IfcStairFlight", "IfcRampFlight", "IfcSlab")]
    return [entity, *walked]


def joined_by_stair(points_m: NDArray[np.float64], places: Sequence[Place]) -> tuple[str, ...]:
    """The rooms at the foot and at the head of a stair, by the corners (n, 3) of its body."""
    heights_m = points_m[:, 2]
    low_m, high_m = float(heights_m.min()), float(heights_m.max())
    highest_m = points_m[heights_m >= high_m - STEP_M]
    lowest_m = points_m[heights_m <= low_m + STEP_M]
    # A massive stair stands on the floor in all its length: its foot is the end away from the head.
    away_m = np.linalg.norm(lowest_m[:, :2] - highest_m[:, :2].mean(axis=0), axis=1)
    head = _around(highest_m)
    below = _best(_around(lowest_m[away_m >= away_m.max() - TREAD_M]), low_m + THICK_M, places)
    if below is None:
        return ()
    # A stair often has a room of its own, of both storeys: it leads out of that.
    others = [place for place in places if place.name != below.name and place.band != below.band]
    above = _best(head, high_m + STEP_M, others)
    return (below.name,) if above is None else tuple(sorted((below.name, above.name)))


def joined_by_lift(points_m: NDArray[np.float64], places: Sequence[Place]) -> tuple[str, ...]:
    """On each storey the room in which a lift stands or, where the shaft is none, the one before it."""
    car = _around(points_m)
    best: dict[str | None, tuple[float, str]] = {}
    for place in places:
        area_m2 = float(car.intersection(place.footprint).area)
        if area_m2 > max(CONTACT_M2, best.get(place.storey, (0.0, ""))[0]):
            best[place.storey] = area_m2, place.name
    return tuple(sorted(name for _, name in best.values()))


def joined_by_opening(
    points_m: NDArray[np.float64], elevation_m: float | None, floor: Floor
) -> tuple[str, ...]:
    """The two rooms that a hole in a wall joins, by the corners (n, 3) of its body; () where it is no way."""
    low_m, high_m = float(points_m[:, 2].min()), float(points_m[:, 2].max())
    if high_m - low_m < LOWEST_M or (elevation_m is not None and low_m > elevation_m + FOOT_M):
        return ()
    joins = joined_rooms(shapely.MultiPoint(points_m[:, :2]).convex_hull, floor)
    return joins if len(joins) == 2 else ()


def _carries_people(entity: Entity) -> bool:
    if not entity.is_a("IfcTransportElement"):
        return True
    kind = getattr(entity, "OperationType", None) or getattr(entity, "PredefinedType", None)
    return kind not in ("CRANEWAY", "LIFTINGGEAR")


def _around(points_m: NDArray[np.float64]) -> shapely.Geometry:
    return shapely.MultiPoint(points_m[:, :2]).convex_hull.buffer(REACH_M)


def _best(area: shapely.Geometry, height_m: float, places: Sequence[Place]) -> Place | None:
    """The room at this height that has most of an area."""
    shares = [
        (float(area.intersection(place.footprint).area), place)
        for place in places
        if place.band.z_min_m <= height_m < place.band.z_max_m
    ]
    best = max(shares, key=lambda each: each[0], default=None)
    return None if best is None or best[0] <= CONTACT_M2 else best[1]
