"""Where a map lies on the earth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import shapely
from sqlalchemy import Connection, delete, select, text
from sqlalchemy.dialects.postgresql import insert

from semap.errors import Conflict, DatabaseError, InvalidInput
from semap.geometry.ewkb import from_ewkb, to_ewkb
from semap.model.building import Mesh
from semap.model.map_document import Anchor
from semap.model.pose import Pose
from semap.model.source_geometry import PolygonMesh
from semap.store.database import translated
from semap.store.maps import map_id_of
from semap.store.placement import PARTS, normalised
from semap.store.tables import map_anchor

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


def on_earth(
    connection: Connection, map_name: str, shapes: Sequence[Placeable], epsg: int
) -> tuple[Placeable, ...]:
    """Shapes of the map frame in a system of the earth, in their order.

    raises  Conflict if the map has no anchor, InvalidInput if the system is unknown or cannot hold a shape
    """
    if read_anchor(connection, map_name) is None:
        raise Conflict(
            f"The map {map_name} has no anchor, so nobody knows where on the earth it lies.",
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
