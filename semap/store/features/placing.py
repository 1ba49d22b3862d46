"""Where on the earth a map is shown, and what shapes of the earth are on the map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import shapely
from sqlalchemy import Connection, Integer, cast, func, literal, literal_column, text
from sqlalchemy.sql.elements import ColumnElement

from semap.model.pose import Pose
from semap.store.database.connection import translated
from semap.store.database.tables import POSE
from semap.store.map.anchor import read_anchor
from semap.store.map.placement import PARTS

WGS84 = 4326
WEB_MERCATOR = 3857
FAR_AWAY = shapely.Point(1e12, 1e12)
"""[m, map frame] Where nothing is: what lies nowhere near a map is there for it."""

REACH_DEG = 3.0
REACH_M = 300_000.0
"""A map is looked at no further than this from what is on it: no projection holds all over the earth."""

STEP_DEG, STEP_M = 0.05, 5_000.0

CENTRE = text("""
    select coalesce(
      (select public.st_centroid(a.geometry)
       from semap.instance i
       join semap.abstraction a on a.instance_id = i.instance_id and a.type = 'Footprint'
       where i.map_id = :map_id limit 1),
      (select public.st_makepoint(n.x_m, n.y_m)
       from semap.track t join semap.track_place n using (track_id)
       where t.map_id = :map_id and n.x_m is not null limit 1),
      public.st_makepoint(0, 0)) as centre
""")
POSE_SQL = f"row({', '.join(f':{part}' for part in POSE)})::semap.pose"
CENTRE_ON_EARTH = text(f"""
    select public.st_x(c), public.st_y(c)
    from (select semap.on_globe(centre, {POSE_SQL}, cast(:anchor as integer), :epsg) as c
          from ({CENTRE.text}) centre) placed
""")  # noqa: S608  (a constant)
TO_MAP = text(f"""
    select public.st_asbinary(semap.from_globe(
             public.st_setsrid(public.st_geomfromwkb(s.shape), cast(:epsg as integer)),
             {POSE_SQL}, cast(:anchor as integer)))
    from unnest(cast(:shapes as bytea[])) with ordinality s (shape, place) order by place
""")  # noqa: S608
ON_EARTH = text(f"""
    select public.st_asbinary(semap.on_globe(public.st_geomfromwkb(s.shape), {POSE_SQL},
                                             cast(:anchor as integer), cast(:epsg as integer)))
    from unnest(cast(:shapes as bytea[])) with ordinality s (shape, place) order by place
""")  # noqa: S608
NORTH_FIRST = text("""
    select srtext ~ 'AXIS\\["[^"]*",NORTH\\],AXIS\\["[^"]*",EAST\\]'
    from public.spatial_ref_sys where srid = :epsg
""")


@dataclass(frozen=True)
class System:
    """A system of coordinates that a map is shown in.

    epsg         None: the map frame itself [m]
    north_first  whether its first axis is the northern one
    degrees      whether it is in degrees
    """

    epsg: int | None
    north_first: bool = False
    degrees: bool = False


CRS84 = System(WGS84, degrees=True)
MAP_FRAME = System(None)

Placed: TypeAlias = Literal["everywhere", "nowhere"] | shapely.Geometry


@dataclass(frozen=True)
class Placing:
    """How the frame of a map lies on the earth; without an EPSG code at 0 N 0 E."""

    map_id: int
    epsg: int | None
    pose: Pose

    @property
    def parameters(self) -> dict[str, Any]:
        return {
            "map_id": self.map_id,
            "anchor": self.epsg,
            **{part: getattr(self.pose, part) for part in PARTS},
        }

    def shown(self, shape: ColumnElement[Any], system: System) -> ColumnElement[Any]:
        """The SQL of a shape of the map frame in a system."""
        if system.epsg is None:
            return shape
        parts = ", ".join(repr(float(getattr(self.pose, part))) for part in PARTS)
        pose: ColumnElement[Any] = literal_column(f"row({parts})::semap.pose")
        found: ColumnElement[Any] = func.semap.on_globe(
            shape, pose, cast(literal(self.epsg), Integer), cast(literal(system.epsg), Integer), type_=None
        )
        return func.public.st_flipcoordinates(found, type_=None) if system.north_first else found


def placing_of(connection: Connection, map_id: int, map_name: str) -> Placing:
    anchor = read_anchor(connection, map_name)
    if anchor is None:
        return Placing(map_id, None, Pose(0, 0, 0, 0, 0, 0, 1))
    return Placing(map_id, anchor.epsg, anchor.pose)


def is_north_first(connection: Connection, epsg: int) -> bool:
    """Whether the axes of a projected system are in the order north, east."""
    with translated():
        return bool(connection.scalar(NORTH_FIRST, {"epsg": epsg}))


def on_map(
    connection: Connection, placing: Placing, shapes: Sequence[shapely.Geometry], system: System
) -> list[Placed]:
    """Shapes of a system as seen from above in the map frame [m], in their order.

    What lies beyond `REACH_M` of the map is cut off, which changes nothing that is asked of what is near it.
    """
    if system.epsg is None:
        return list(shapes)
    with translated():
        centre = connection.execute(CENTRE_ON_EARTH, {**placing.parameters, "epsg": system.epsg}).one()
    cut = [_near(each, centre, system) for each in shapes]
    inside = [each for each in cut if isinstance(each, shapely.Geometry)]
    if not inside:
        return cut
    asked = {
        **placing.parameters,
        "epsg": system.epsg,
        "shapes": [shapely.to_wkb(each) for each in inside],
    }
    with translated():
        moved = iter([shapely.from_wkb(bytes(wkb)) for (wkb,) in connection.execute(TO_MAP, asked)])
    return [next(moved) if isinstance(each, shapely.Geometry) else each for each in cut]


def shown_shapes(
    connection: Connection, placing: Placing, shapes: Sequence[shapely.Geometry], system: System
) -> list[shapely.Geometry]:
    """Shapes of the map frame in a system, x before y, in their order."""
    if system.epsg is None or not shapes:
        return list(shapes)
    asked = {
        **placing.parameters,
        "epsg": system.epsg,
        "shapes": [shapely.to_wkb(each) for each in shapes],
    }
    with translated():
        return [shapely.from_wkb(bytes(wkb)) for (wkb,) in connection.execute(ON_EARTH, asked)]


def _near(shape: shapely.Geometry, centre: Sequence[float], system: System) -> Placed:
    """What of a shape is near the centre of the map, in steps short enough to be bent."""
    reach, step = (REACH_DEG, STEP_DEG) if system.degrees else (REACH_M, STEP_M)
    x, y = centre
    if system.north_first:
        shape = shapely.transform(shape, lambda points: points[:, ::-1])
    if system.degrees and abs(y) + reach < 90:
        reach_x = min(180.0, reach / max(0.01, math.cos(math.radians(y))))
    else:
        reach_x = 360.0 if system.degrees else reach
    if system.degrees:
        middle = shapely.box(*shape.bounds).centroid.x
        turns = round((x - middle) / 360)
        if turns:
            shape = shapely.transform(shape, lambda points: points + np.array([360.0 * turns, 0.0]))
    low, high = y - reach, y + reach
    if system.degrees:
        low, high = max(-90.0, low), min(90.0, high)
    domain = shapely.box(x - reach_x, low, x + reach_x, high)
    if shapely.covers(domain, shape):
        return shapely.segmentize(shape, step)
    if shapely.covers(shape, domain):
        return "everywhere"
    part = _of_dimension(shapely.intersection(shape, domain), shapely.get_dimensions(shape))
    return "nowhere" if part.is_empty else shapely.segmentize(part, step)


def _of_dimension(shape: shapely.Geometry, dimension: int) -> shapely.Geometry:
    """What of a collection has a dimension; an intersection may leave lines and points at its edges."""
    if shape.geom_type != "GeometryCollection":
        return shape if shapely.get_dimensions(shape) == dimension else shapely.Polygon()
    return shapely.union_all([each for each in shape.geoms if shapely.get_dimensions(each) == dimension])
