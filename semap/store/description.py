"""Descriptions: what an instance looks like, relative to its own frame and absolute in the map.

The relative description holds the body and the abstractions derived from it, in the instance's own
frame. The absolute one holds the abstractions in the map frame, for questions of space:

* An upright pose (yaw and translation) carries each relative abstraction into the map.
* A tilted pose carries none, so that the absolute ones are derived from the body as it then stands.
* An outline that the caller gives is absolute; an upright pose carries it back into the own frame, so
  that it moves with the instance. It wins over the one derived from the body, and so do its heights.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.affinity import affine_transform
from sqlalchemy import Connection, text

from semap.errors import InvalidInput
from semap.geometry.abstractions import Abstraction, derive
from semap.geometry.pose import transform_mesh
from semap.geometry.tin import mesh_to_wkb
from semap.model.building import HeightBand, Mesh
from semap.store.database import translated
from semap.store.placement import inverse

AREAS = ("Footprint", "FootprintHull")
BODIES_AT_ONCE = 500

INSERT_DESCRIPTIONS = text("""
    insert into semap.description (map_id)
    select :map_id from generate_series(1, :count) returning description_id
""")
WRITE_BODIES = text("""
    insert into semap.geometry (description_id, type, body)
    select description_id, 'Body', public.st_geomfromewkb(body)
    from unnest(cast(:description_ids as bigint[]), cast(:bodies as bytea[])) as v (description_id, body)
    on conflict (description_id, type) do update set body = excluded.body
""")
WRITE_ABSTRACTIONS = text("""
    insert into semap.abstraction (description_id, type, geometry, z_min_m, z_max_m)
    select description_id, type, public.st_geomfromewkb(geometry), z_min_m, z_max_m
    from unnest(cast(:description_ids as bigint[]), cast(:types as text[]), cast(:geometries as bytea[]),
                cast(:z_min_m as float8[]), cast(:z_max_m as float8[]))
      as v (description_id, type, geometry, z_min_m, z_max_m)
    on conflict (description_id, type) do update
    set geometry = excluded.geometry, z_min_m = excluded.z_min_m, z_max_m = excluded.z_max_m
""")


@dataclass(frozen=True, eq=False)
class Outline:
    """What the caller gives of an instance's area, in the map frame; the body says the rest.

    area  None: the outline of the body
    band  None: the heights of the body, or every height where there is no body
    """

    area: Polygon | MultiPolygon | None = None
    band: HeightBand | None = None


@dataclass(frozen=True, eq=False)
class Described:
    """The abstractions of one instance, in its own frame and in the map frame."""

    relative: tuple[Abstraction, ...]
    absolute: tuple[Abstraction, ...]


def describe(map_T_item: NDArray[np.float64], body: Mesh | None, given: Outline) -> Described:
    """All abstractions of an instance.

    map_T_item  (4, 4)
    body        in the instance's own frame
    raises      InvalidInput if a body without area comes without an outline, or an outline is not an area
    """
    relative = _derived(body, given)
    absolute = carried(map_T_item, relative, body if relative else None)
    if given.area is None and given.band is None:
        return Described(relative, absolute)
    areas = _areas(given, absolute, None if body is None else _heights(map_T_item, body))
    if is_upright(map_T_item):
        relative = _merged(relative, carried(inverse(map_T_item), areas, None))
    return Described(relative, _merged(absolute, areas))


def carried(
    map_T_item: NDArray[np.float64], relative: Iterable[Abstraction], body: Mesh | None
) -> tuple[Abstraction, ...]:
    """The abstractions of an instance's own frame in the map frame.

    raises  InvalidInput if the pose is tilted and there is no body to derive them from
    """
    relative = tuple(relative)
    if is_upright(map_T_item):
        return tuple(_carried_upright(map_T_item, each) for each in relative)
    if body is not None:
        tilted = derive(transform_mesh(map_T_item, body))
        return tuple(_with_heights(each, each.z_min_m, each.z_max_m) for each in tilted)
    if relative:
        raise InvalidInput(
            "an outline without a body cannot be tilted",
            "Give a pose that turns about the vertical axis only, or give a body.",
            "pose",
        )
    return ()


def is_upright(map_T_item: NDArray[np.float64]) -> bool:
    """Whether the frame's z axis points up, so that an outline stays an outline."""
    return bool(np.allclose(map_T_item[2, :3], [0, 0, 1], atol=1e-9))


def insert_descriptions(connection: Connection, map_id: int, count: int) -> list[int]:
    """The ids of so many new descriptions."""
    with translated():
        return list(connection.scalars(INSERT_DESCRIPTIONS, {"map_id": map_id, "count": count}))


def write_bodies(connection: Connection, bodies: Sequence[tuple[int, Mesh]]) -> None:
    """Write the body of each description, in place of one that is there."""
    for start in range(0, len(bodies), BODIES_AT_ONCE):
        batch = bodies[start : start + BODIES_AT_ONCE]
        with translated():
            connection.execute(
                WRITE_BODIES,
                {
                    "description_ids": [description_id for description_id, _ in batch],
                    "bodies": [mesh_to_wkb(mesh) for _, mesh in batch],
                },
            )


def write_abstractions(connection: Connection, rows: Sequence[tuple[int, Abstraction]]) -> None:
    """Write abstractions of descriptions, in place of those of the same type, in one statement.

    Its trigger keeps writers of track states out until the transaction ends: do this last.
    raises  InvalidInput for an area that crosses itself
    """
    if not rows:
        return
    with translated():
        connection.execute(
            WRITE_ABSTRACTIONS,
            {
                "description_ids": [description_id for description_id, _ in rows],
                "types": [each.type for _, each in rows],
                "geometries": [shapely.to_wkb(each.geometry) for _, each in rows],
                "z_min_m": [each.z_min_m for _, each in rows],
                "z_max_m": [each.z_max_m for _, each in rows],
            },
        )


def _derived(body: Mesh | None, given: Outline) -> tuple[Abstraction, ...]:
    if body is None:
        return ()
    try:
        return tuple(_with_heights(each, each.z_min_m, each.z_max_m) for each in derive(body))
    except InvalidInput:
        # A door leaf without thickness is fine as long as something says what area it covers.
        if given.area is None or len(body.faces) == 0:
            raise
        return ()


def _areas(
    given: Outline, absolute: Iterable[Abstraction], heights_m: tuple[float, float] | None
) -> tuple[Abstraction, ...]:
    area = given.area
    if area is None:
        area = next((each.geometry for each in absolute if each.type == "Footprint"), None)
    if area is None:
        return ()
    if area.is_empty or not area.is_valid or area.geom_type not in ("Polygon", "MultiPolygon"):
        raise InvalidInput("an outline that is empty or crosses itself", "Give a valid polygon.", "footprint")
    if given.band is not None:
        heights_m = given.band.z_min_m, given.band.z_max_m
        if not heights_m[0] < heights_m[1]:
            raise InvalidInput(f"heights from {heights_m[0]} m to {heights_m[1]} m", "Let them rise.", "band")
    flat = shapely.force_2d(area)
    return tuple(
        _with_heights(Abstraction(type_, geometry, None, None), *(heights_m or (None, None)))
        for type_, geometry in zip(AREAS, (flat, flat.convex_hull), strict=True)
    )


def _heights(map_T_item: NDArray[np.float64], body: Mesh) -> tuple[float, float]:
    heights_m = transform_mesh(map_T_item, body).vertices_m[body.faces, 2]
    return float(heights_m.min()), float(heights_m.max())


def _with_heights(each: Abstraction, z_min_m: float | None, z_max_m: float | None) -> Abstraction:
    """The same between these heights; a body without height says nothing about heights."""
    if z_min_m is None or z_max_m is None or z_min_m >= z_max_m:
        return replace(each, z_min_m=None, z_max_m=None)
    return replace(each, z_min_m=float(z_min_m), z_max_m=float(z_max_m))


def _carried_upright(map_T_item: NDArray[np.float64], each: Abstraction) -> Abstraction:
    (a, b, c), (d, e, f), (g, h, i) = map_T_item[:3, :3]
    x_m, y_m, z_m = map_T_item[:3, 3]
    affine = [a, b, c, d, e, f, g, h, i, x_m, y_m, z_m] if each.geometry.has_z else [a, b, d, e, x_m, y_m]
    return replace(
        each,
        geometry=affine_transform(each.geometry, affine),
        z_min_m=None if each.z_min_m is None else each.z_min_m + float(z_m),
        z_max_m=None if each.z_max_m is None else each.z_max_m + float(z_m),
    )


def _merged(below: Iterable[Abstraction], above: Iterable[Abstraction]) -> tuple[Abstraction, ...]:
    """Abstractions by type; those of `above` win."""
    return tuple({each.type: each for each in (*below, *above)}.values())
