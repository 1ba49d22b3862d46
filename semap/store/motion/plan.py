"""What a plan shows: the things of a map as shapes, and where tracks went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
import shapely
from sqlalchemy import Connection, text

from semap.errors import TooLarge
from semap.model.plan import Kind, Thing, Way
from semap.store.database.connection import translated
from semap.store.map.maps import map_id_of
from semap.store.map.placement import map_from_frames

MOST_POINTS = 500_000

THINGS = text("""
    select i.instance_id, i.name, i.frame_id, s.name as storey, i.attributes, a.shape,
           case when i.concept_id in (select semap.concepts_below(semap.concept_named('Room'))) then 'room'
                when i.concept_id in (select semap.concepts_below(semap.concept_named('Window'))) then 'thing'
                when i.concept_id in (select semap.concepts_below(semap.concept_named('Opening')))
                  or i.concept_id in (select semap.concepts_below(semap.concept_named('Door'))) then 'door'
                else 'thing' end as kind
    from semap.instance i
    join semap.concept c using (concept_id)
    left join semap.instance s on s.instance_id = i.storey_id
    left join lateral (
      select public.st_asbinary(geometry) as shape from semap.abstraction
      where description_id = i.absolute_description_id and type = 'Footprint') a on true
    where i.map_id = :map_id and c.name <> 'Storey'
    order by i.instance_id
""")
WAYS = text("""
    select t.track_id, t.name, s.stamp, s.x_m, s.y_m
    from semap.states_of_map(:map_id, :from, :to) s join semap.track t using (track_id)
    where s.stamp < :to
      and (cast(:tracks as text[]) is null or t.name = any (:tracks))
    order by t.track_id, s.stamp limit :limit
""")


def things(connection: Connection, map_name: str, storey: str | None = None) -> tuple[Thing, ...]:
    """Everything on a map seen from above: areas, doors as lines, and what has no outline as points.

    storey  only what is on it; None: everything
    raises  NotFound if there is no such map
    """
    map_id = map_id_of(connection, map_name)
    with translated():
        rows = [row for row in connection.execute(THINGS, {"map_id": map_id}) if storey in (None, row.storey)]
    matrices = map_from_frames(connection, sorted({row.frame_id for row in rows if row.shape is None}))
    return tuple(
        Thing(row.instance_id, row.name, Kind(row.kind), _shape(row, matrices))
        for row in rows
        if row.shape is not None or row.frame_id in matrices
    )


def ways(
    connection: Connection,
    map_name: str,
    start: datetime,
    end: datetime,
    tracks: Sequence[str] | None = None,
) -> tuple[Way, ...]:
    """Where each track was, from `start` to before `end`, by its stamps.

    tracks  only those with these names; None: all
    raises  NotFound if there is no such map, TooLarge where that is more than a picture can show
    """
    asked = {"map_id": map_id_of(connection, map_name), "from": start, "to": end, "limit": MOST_POINTS + 1}
    with translated():
        rows = connection.execute(WAYS, {**asked, "tracks": None if tracks is None else list(tracks)}).all()
    if len(rows) > MOST_POINTS:
        raise TooLarge(
            f"More than {MOST_POINTS} states: a picture cannot show that many.",
            "Ask for a shorter time, or for some of the tracks.",
        )
    found: dict[int, list[Any]] = {}
    for row in rows:
        found.setdefault(row.track_id, []).append(row)
    return tuple(
        Way(states[0].name, np.array([(each.x_m, each.y_m) for each in states])) for states in found.values()
    )


def _shape(row: Any, matrices: Mapping[int, Any]) -> shapely.Geometry:
    """[m, map frame]"""
    if row.shape is not None:
        return shapely.force_2d(shapely.from_wkb(bytes(row.shape)))
    matrix = matrices[row.frame_id]
    middle = matrix[:2, 3]
    width_m = row.attributes.get("width_m")
    if row.kind != "door" or not isinstance(width_m, int | float) or width_m <= 0:
        return shapely.Point(middle)
    along = matrix[:2, 0] * float(width_m) / 2
    return shapely.LineString([middle - along, middle + along])
