"""Where a map lies on the earth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import shapely
from shapely.affinity import translate
from sqlalchemy import Connection, delete, select, text
from sqlalchemy.dialects.postgresql import insert

from semap.errors import Conflict, DatabaseError, InvalidInput
from semap.geometry.ewkb import from_ewkb, to_ewkb
from semap.model.anchor import Anchor
from semap.model.building import Building, Mesh
from semap.model.pose import IDENTITY, Pose
from semap.model.source_geometry import PolygonMesh
from semap.store.database import translated
from semap.store.maps import map_id_of
from semap.store.placement import PARTS, normalised
from semap.store.tables import instance, map_anchor

Placeable: TypeAlias = shapely.Geometry | Mesh | PolygonMesh

ON_EARTH = text("""
    select public.st_asewkb(semap.to_earth(public.st_geomfromewkb(shape), :map_id, :epsg))
    from unnest(cast(:shapes as bytea[])) with ordinality as v (shape, place) order by place
""")


def read_anchor(connection: Connection, map_name: str) -> Anchor | None:
    """None: the map lies nowhere in particular.

    raises  NotFound if there is no such map
    """
    map_id = map_id_of(connection, map_name)
    with translated():
        row = connection.execute(
            select(map_anchor.c.epsg, *(map_anchor.c[part] for part in PARTS)).where(
                map_anchor.c.map_id == map_id
            )
        ).one_or_none()
    return None if row is None else Anchor(row[0], Pose(*row[1:]))


def set_anchor(connection: Connection, map_name: str, anchor: Anchor) -> None:
    """Say where a map lies, in a metric system of the earth.

    raises  NotFound, InvalidInput if the system is unknown to PostGIS or not in metres
    """
    map_id = map_id_of(connection, map_name)
    with translated():
        definition = connection.scalar(
            text("select proj4text from public.spatial_ref_sys where srid = :epsg"), {"epsg": anchor.epsg}
        )
    if definition is None or "+units=m" not in definition:
        raise InvalidInput(
            f"EPSG:{anchor.epsg} is {'unknown' if definition is None else 'not in metres'}",
            "Name a projected system in metres, such as EPSG:25832.",
            "epsg",
        )
    pose = normalised(anchor.pose)
    values = {"epsg": anchor.epsg, **{part: getattr(pose, part) for part in PARTS}}
    with translated():
        connection.execute(
            insert(map_anchor)
            .values(map_id=map_id, **values)
            .on_conflict_do_update(index_elements=["map_id"], set_=values)
        )


def place_on_earth(connection: Connection, map_name: str, building: Building) -> Building:
    """A building in the frame of its map, which is anchored where the building lies if it is new.

    raises  NotFound; Conflict if the map has things and no anchor, or one in another system, or turned
    """
    wanted = building.anchor
    if wanted is None:
        return building
    known = read_anchor(connection, map_name)
    if known is None:
        with translated():
            is_used = connection.scalar(
                select(instance.c.instance_id)
                .where(instance.c.map_id == map_id_of(connection, map_name))
                .limit(1)
            )
        if is_used is not None:
            raise Conflict(
                f"The building is given in degrees, and the map {map_name} has no anchor on the earth.",
                f"Import it into another map, or anchor this one: `semap map anchor {map_name} --epsg ...`.",
            )
        set_anchor(connection, map_name, wanted)
        return building
    if known.epsg != wanted.epsg or replace(known.pose, x_m=0, y_m=0, z_m=0) != IDENTITY:
        raise Conflict(
            f"The map {map_name} is turned, or lies in EPSG:{known.epsg}, and the building in"
            f" EPSG:{wanted.epsg}.",
            "Import it into another map, or give its coordinates in metres of this one.",
        )
    return _shifted(building, wanted.pose.x_m - known.pose.x_m, wanted.pose.y_m - known.pose.y_m)


def _shifted(building: Building, x_m: float, y_m: float) -> Building:
    items = tuple(
        replace(
            item,
            pose=replace(item.pose, x_m=item.pose.x_m + x_m, y_m=item.pose.y_m + y_m),
            footprint=None if item.footprint is None else translate(item.footprint, x_m, y_m),
        )
        for item in building.items
    )
    return replace(building, items=items)


def on_earth(
    connection: Connection, map_name: str, shapes: Sequence[Placeable], epsg: int
) -> tuple[Placeable, ...]:
    """Shapes of the map frame in a system of the earth, in their order.

    raises  Conflict if the map has no anchor, InvalidInput if the system is unknown or cannot hold a shape
    """
    if read_anchor(connection, map_name) is None:
        raise Conflict(
            f"The map {map_name} has no anchor, so its place on the earth is unknown.",
            f"Set one: PUT /maps/{map_name}/anchor, or `semap map anchor {map_name} --epsg ...`.",
        )
    with translated():
        known = connection.scalar(
            text("select true from public.spatial_ref_sys where srid = :epsg"), {"epsg": epsg}
        )
    if not known:
        raise InvalidInput(f"EPSG:{epsg} is unknown", "Name a system such as EPSG:4326.", "crs")
    try:
        with translated():
            rows = connection.execute(
                ON_EARTH,
                {
                    "map_id": map_id_of(connection, map_name),
                    "epsg": epsg,
                    "shapes": [to_ewkb(shape) for shape in shapes],
                },
            ).all()
    except DatabaseError as error:
        raise InvalidInput(
            f"it has no place in EPSG:{epsg}: {error}", "Name a system of the region of the map.", "crs"
        ) from error
    return tuple(from_ewkb(bytes(ewkb)) for (ewkb,) in rows)


def remove_anchor(connection: Connection, map_name: str) -> None:
    """raises NotFound if there is no such map"""
    map_id = map_id_of(connection, map_name)
    with translated():
        connection.execute(delete(map_anchor).where(map_anchor.c.map_id == map_id))
