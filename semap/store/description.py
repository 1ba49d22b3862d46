"""Descriptions: blueprints, in a frame of their own, that instances place in the map.

A description has source geometries and the abstractions derived from them. What an instance looks like in
the map follows from its description and its frame, and the database keeps it so (sql/050_placement.sql).
A description without a name belongs to its one instance; one with a name is shared.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.affinity import affine_transform
from sqlalchemy import Connection, text

from semap.errors import InvalidInput
from semap.geometry.abstractions import Abstraction, derive
from semap.geometry.ewkb import from_ewkb, to_ewkb
from semap.geometry.pose import pose_from_matrix
from semap.model.building import HeightBand, Mesh
from semap.model.pose import IDENTITY, Pose
from semap.model.source_geometry import BODY, OUTLINE, SourceGeometry
from semap.store.database import translated
from semap.store.placement import PARTS, inverse, normalised

GEOMETRIES_AT_ONCE = 500

LEVEL = 1e-9
"""How far the z axis of what is upright may lean."""

INSERT_DESCRIPTIONS = text("""
    insert into semap.description (map_id, name)
    select :map_id, name from unnest(cast(:names as text[])) with ordinality as v (name, place) order by place
    returning description_id
""")
FORGET_GEOMETRIES = text("""
    delete from semap.geometry g
    where description_id = any (cast(:description_ids as bigint[]))
      and not exists (select from unnest(cast(:kept_ids as bigint[]), cast(:kept as text[])) as v (id, name)
                      where v.id = g.description_id and v.name = g.name)
""")
WRITE_GEOMETRIES = text("""
    insert into semap.geometry
      (description_id, name, type, body, x_m, y_m, z_m, qx, qy, qz, qw, z_min_m, z_max_m)
    select description_id, name, type, public.st_geomfromewkb(body), x_m, y_m, z_m, qx, qy, qz, qw,
           z_min_m, z_max_m
    from unnest(cast(:description_ids as bigint[]), cast(:names as text[]), cast(:types as text[]),
                cast(:bodies as bytea[]),
                cast(:x_m as float8[]), cast(:y_m as float8[]), cast(:z_m as float8[]),
                cast(:qx as float8[]), cast(:qy as float8[]), cast(:qz as float8[]), cast(:qw as float8[]),
                cast(:z_min_m as float8[]), cast(:z_max_m as float8[]))
      as v (description_id, name, type, body, x_m, y_m, z_m, qx, qy, qz, qw, z_min_m, z_max_m)
    on conflict (description_id, name) do update
    set type = excluded.type, body = excluded.body,
        x_m = excluded.x_m, y_m = excluded.y_m, z_m = excluded.z_m,
        qx = excluded.qx, qy = excluded.qy, qz = excluded.qz, qw = excluded.qw,
        z_min_m = excluded.z_min_m, z_max_m = excluded.z_max_m
""")
READ_GEOMETRIES = text("""
    select description_id, name, type, public.st_asewkb(body), x_m, y_m, z_m, qx, qy, qz, qw, z_min_m, z_max_m
    from semap.geometry where description_id = any (cast(:description_ids as bigint[]))
    order by description_id, geometry_id
""")
WRITE_ABSTRACTIONS = text("""
    with wanted as materialized (
      select * from unnest(cast(:description_ids as bigint[]), cast(:types as text[]),
                           cast(:geometries as bytea[]), cast(:z_min_m as float8[]),
                           cast(:z_max_m as float8[]))
        as v (description_id, type, geometry, z_min_m, z_max_m)
    ), gone as (
      delete from semap.abstraction a
      where a.description_id = any (cast(:all_ids as bigint[])) and a.instance_id is null
        and not exists (select from wanted w where w.description_id = a.description_id and w.type = a.type)
    )
    insert into semap.abstraction (description_id, type, geometry, z_min_m, z_max_m)
    select description_id, type, public.st_geomfromewkb(geometry), z_min_m, z_max_m from wanted
    on conflict (description_id, type) do update
    set geometry = excluded.geometry, z_min_m = excluded.z_min_m, z_max_m = excluded.z_max_m
""")


def sources_of(
    map_T_item: NDArray[np.float64],
    body: Mesh | None,
    area: Polygon | MultiPolygon | None,
    band: HeightBand | None,
) -> tuple[SourceGeometry, ...]:
    """The source geometries of an instance that is given by a body, an outline and heights.

    map_T_item  (4, 4), where the instance stands
    body        in the instance's own frame
    area, band  in the map frame; a band without an area is that of the body's own outline
    raises      InvalidInput for an outline that is not an area, or heights of nothing
    """
    sources = [] if body is None else [SourceGeometry(BODY, "TRIANGLEMESH3D", body)]
    if area is not None:
        sources.append(outline_of(map_T_item, area, band))
    elif band is not None:
        outline = own_outline(sources)
        sources.append(replace(outline, band=band_within(outline, map_T_item, band)))
    return tuple(sources)


def outline_of(
    map_T_item: NDArray[np.float64], area: Polygon | MultiPolygon, band: HeightBand | None
) -> SourceGeometry:
    """An outline that is given in the map frame, as a source geometry of the instance that stands there.

    Under a pose that tilts, the outline stays as it is given, by a pose of its own that turns it back.
    raises  InvalidInput if it is empty or crosses itself, or if the heights do not rise
    """
    if area.is_empty or not area.is_valid or area.geom_type not in ("Polygon", "MultiPolygon"):
        raise InvalidInput("an outline that is empty or crosses itself", "Give a valid polygon.", "footprint")
    if band is not None and not band.z_min_m < band.z_max_m:
        raise InvalidInput(f"heights from {band.z_min_m} m to {band.z_max_m} m", "Let them rise.", "band")
    flat = shapely.force_2d(area)
    if not is_upright(map_T_item):
        return SourceGeometry(OUTLINE, "POLYGON2D", flat, pose_from_matrix(inverse(map_T_item)), band)
    own = flat
    if not np.array_equal(map_T_item, np.eye(4)):
        (a, b, _, x_m), (d, e, _, y_m) = inverse(map_T_item)[:2]
        own = affine_transform(flat, [a, b, d, e, x_m, y_m])
    return SourceGeometry(OUTLINE, "POLYGON2D", own, band=_lowered(band, map_T_item))


def own_outline(sources: Sequence[SourceGeometry]) -> SourceGeometry:
    """The outline that the source geometries have by themselves, as one of them.

    raises  InvalidInput if they have no area
    """
    for each in sources:
        if each.name == OUTLINE:
            return each
    footprint = next((each.geometry for each in derive(sources) if each.type == "Footprint"), None)
    if not isinstance(footprint, Polygon | MultiPolygon):
        raise InvalidInput("there is no footprint to give heights to", "Give a footprint too.", "band")
    return SourceGeometry(OUTLINE, "POLYGON2D", footprint)


def band_within(
    outline: SourceGeometry, map_T_item: NDArray[np.float64], band: HeightBand | None
) -> HeightBand | None:
    """Heights of the map frame in the outline's own.

    raises  InvalidInput where the outline is tilted, or the heights do not rise
    """
    if band is None:
        return None
    map_T_outline = map_T_item @ outline.pose.matrix()
    if not is_upright(map_T_outline):
        raise InvalidInput("heights of an outline that is tilted", "Give a footprint too.", "band")
    if not band.z_min_m < band.z_max_m:
        raise InvalidInput(f"heights from {band.z_min_m} m to {band.z_max_m} m", "Let them rise.", "band")
    return _lowered(band, map_T_outline)


def is_upright(map_T_item: NDArray[np.float64]) -> bool:
    """Whether the frame's z axis points up, so that an outline stays an outline."""
    x, y, z = map(float, map_T_item[2, :3])
    return abs(x) <= LEVEL and abs(y) <= LEVEL and z > 0


def insert_descriptions(connection: Connection, map_id: int, names: Sequence[str | None]) -> list[int]:
    """The ids of new descriptions, in the order of their names; None: one instance's own.

    raises  Conflict if a name is taken
    """
    with translated():
        return list(connection.scalars(INSERT_DESCRIPTIONS, {"map_id": map_id, "names": list(names)}))


def write_descriptions(
    connection: Connection,
    described: Sequence[tuple[int, Sequence[SourceGeometry], Sequence[Abstraction]]],
) -> None:
    """Let each description consist of these geometries, with what `derive` gives for them.

    The abstractions come last: with them every instance of these descriptions follows.
    raises  InvalidInput for an area that crosses itself
    """
    ids = [description_id for description_id, _, _ in described]
    rows = [(description_id, each) for description_id, sources, _ in described for each in sources]
    with translated():
        connection.execute(
            FORGET_GEOMETRIES,
            {
                "description_ids": ids,
                "kept_ids": [description_id for description_id, _ in rows],
                "kept": [each.name for _, each in rows],
            },
        )
        for start in range(0, len(rows), GEOMETRIES_AT_ONCE):
            connection.execute(WRITE_GEOMETRIES, _geometry_columns(rows[start : start + GEOMETRIES_AT_ONCE]))
        parts = [(description_id, each) for description_id, _, derived in described for each in derived]
        connection.execute(
            WRITE_ABSTRACTIONS,
            {
                "all_ids": ids,
                "description_ids": [description_id for description_id, _ in parts],
                "types": [each.type for _, each in parts],
                "geometries": [to_ewkb(each.geometry) for _, each in parts],
                "z_min_m": [each.z_min_m for _, each in parts],
                "z_max_m": [each.z_max_m for _, each in parts],
            },
        )


def reshape(connection: Connection, description_id: int, sources: Sequence[SourceGeometry]) -> None:
    """Let a description consist of these geometries; its instances follow."""
    write_descriptions(connection, [(description_id, sources, derive(sources))])


def read_geometries(
    connection: Connection, description_ids: Iterable[int]
) -> dict[int, tuple[SourceGeometry, ...]]:
    """The source geometries of descriptions that have any, by id."""
    found: dict[int, tuple[SourceGeometry, ...]] = {}
    with translated():
        rows = connection.execute(READ_GEOMETRIES, {"description_ids": list(description_ids)})
        for description_id, name, type_, ewkb, *numbers in rows:
            *pose, z_min_m, z_max_m = numbers
            band = None if z_min_m is None or z_max_m is None else HeightBand(z_min_m, z_max_m)
            source = SourceGeometry(name, type_, from_ewkb(bytes(ewkb)), Pose(*pose), band)
            found[description_id] = (*found.get(description_id, ()), source)
    return found


def _geometry_columns(rows: Sequence[tuple[int, SourceGeometry]]) -> dict[str, list[object]]:
    poses = [each.pose if each.pose == IDENTITY else normalised(each.pose) for _, each in rows]
    return {
        "description_ids": [description_id for description_id, _ in rows],
        "names": [each.name for _, each in rows],
        "types": [each.type for _, each in rows],
        "bodies": [to_ewkb(each.shape) for _, each in rows],
        **{part: [getattr(pose, part) for pose in poses] for part in PARTS},
        "z_min_m": [None if each.band is None else each.band.z_min_m for _, each in rows],
        "z_max_m": [None if each.band is None else each.band.z_max_m for _, each in rows],
    }


def _lowered(band: HeightBand | None, map_T_item: NDArray[np.float64]) -> HeightBand | None:
    """Heights of the map frame in the instance's own."""
    z_m = float(map_T_item[2, 3])
    return None if band is None else HeightBand(band.z_min_m - z_m, band.z_max_m - z_m)
