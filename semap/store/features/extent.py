"""How far collections reach, in space and time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import shapely
from sqlalchemy import Connection, text

from semap.store.database.connection import translated
from semap.store.features.collection import Collection
from semap.store.features.placing import CRS84, placing_of, shown_shapes

HULLS = text("""
    select i.concept_id, public.st_asbinary(public.st_convexhull(public.st_collect(a.geometry)))
    from semap.instance i
    join semap.abstraction a on a.instance_id = i.instance_id and a.type = any ('{Footprint,Position2D}')
    where i.map_id = :map_id
    group by i.concept_id
""")
CONCEPTS_ABOVE = text("""
    select u.concept_id, array(select c.name from semap.concepts_above(u.concept_id) a (concept_id)
                               join semap.concept c using (concept_id))
    from unnest(cast(:concept_ids as integer[])) u (concept_id)
""")
TRACKS = text("""
    select public.st_asbinary(public.st_convexhull(public.st_collect(public.st_makepoint(n.x_m, n.y_m)))),
           min(nullif(n.stamp, '-infinity')), max(nullif(n.stamp, '-infinity'))
    from semap.track t join semap.track_place n using (track_id)
    where t.map_id = :map_id
""")
RELATIONS = text("""
    select public.st_asbinary(public.st_convexhull(public.st_collect(public.st_makepoint(n.x_m, n.y_m)))),
           min(r.since), null
    from semap.relation r join semap.track_place n using (track_id)
    where r.map_id = :map_id and r.confirmed
""")
EVENTS = text("""
    select null,
           (select stamp from semap.event where map_id = :map_id order by stamp limit 1),
           (select stamp from semap.event where map_id = :map_id order by stamp desc limit 1)
""")


@dataclass(frozen=True)
class Extent:
    """Where and when.

    bounds  west, south, east and north [deg, CRS84]; None where nothing has a place
    first, last  None: without an end on that side
    timed   whether there is a time at all
    """

    bounds: tuple[float, float, float, float] | None = None
    timed: bool = False
    first: datetime | None = None
    last: datetime | None = None


def extents_of(connection: Connection, collections: Sequence[Collection]) -> dict[str, Extent]:
    """The extent of each collection, by its id. Where events were is not looked up for all of them."""
    found: dict[str, Extent] = {}
    by_map: dict[int, list[Collection]] = {}
    for each in collections:
        by_map.setdefault(each.map_id, []).append(each)
    for map_id, of_map in by_map.items():
        found |= _of_map(connection, map_id, of_map)
    return found


def _of_map(connection: Connection, map_id: int, collections: Sequence[Collection]) -> dict[str, Extent]:
    hulls = _hulls(connection, map_id) if any(each.kind == "instances" for each in collections) else {}
    times: dict[str, tuple[bool, datetime | None, datetime | None]] = {}
    shapes: dict[str, shapely.Geometry] = {}
    for each in collections:
        times[each.id] = (False, None, None)
        shape = hulls.get(each.concept or "")
        if each.kind != "instances":
            statement = {"tracks": TRACKS, "relations": RELATIONS, "events": EVENTS}[each.kind]
            with translated():
                wkb, first, last = connection.execute(statement, {"map_id": map_id}).one()
            shape = None if wkb is None else shapely.from_wkb(bytes(wkb))
            times[each.id] = (first is not None, first, last)
        if shape is not None and not shape.is_empty:
            shapes[each.id] = shape
    placing = placing_of(connection, map_id, collections[0].map)
    shown = shown_shapes(connection, placing, list(shapes.values()), CRS84)
    bounds: Mapping[str, tuple[float, float, float, float]] = {
        id_: shape.bounds for id_, shape in zip(shapes, shown, strict=True)
    }
    return {each.id: Extent(bounds.get(each.id), *times[each.id]) for each in collections}


def _hulls(connection: Connection, map_id: int) -> dict[str, shapely.Geometry]:
    """The hull of what is of each concept or of one below it, by the concept's name."""
    with translated():
        own = {
            concept_id: shapely.from_wkb(bytes(wkb))
            for concept_id, wkb in connection.execute(HULLS, {"map_id": map_id})
        }
        above = connection.execute(CONCEPTS_ABOVE, {"concept_ids": list(own)}).all()
    under: dict[str, list[shapely.Geometry]] = {}
    for concept_id, names in above:
        for name in names:
            under.setdefault(name, []).append(own[concept_id])
    return {name: shapely.convex_hull(shapely.geometrycollections(each)) for name, each in under.items()}
