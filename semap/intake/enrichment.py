"""What rows that are due need of the database: who acted, where the track was, what the instance covers.

At most one query of each kind for a batch. A row is due when all states up to its stamp have come, and only
those are asked, so that the answer is the same whenever it is given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import psycopg
import shapely

from semap.intake.actor import Candidate, likeliest
from semap.rules.engine.preparation import ACTOR_NEARER
from semap.rules.needs import LOOKED_UP, Needs
from semap.rules.row import Row, Value
from semap.store.database.connection import translated
from semap.timeline.stamp import to_datetime

ASKED = LOOKED_UP | {ACTOR_NEARER}
FOOTPRINTS = """
    select i.instance_id, public.st_asbinary(f.geometry)
    from semap.instance i
    join semap.abstraction f on f.description_id = i.absolute_description_id and f.type = 'Footprint'
    where i.instance_id = any (%s)
"""
POSITIONS = """
    select a.place, s.*
    from unnest(%s::integer[], %s::timestamptz[], %s::bigint[]) as a (place, stamp, track_id)
    cross join lateral (
      select s.x_m, s.y_m, s.z_m from semap.states(array[a.track_id], a.stamp, a.stamp) s) s
"""
# where each track was: its newest state, at most 2 s old, moved on by its velocity since the one before;
# later states are not asked, since whether they are there already depends on when one asks. An instance
# without an outline is where its frame is. How exact it is: on average of all directions
CANDIDATES = """
    select a.place, t.track_id, t.name, d.distance_m,
           sqrt((s.std_m::float8 ^ 2 + coalesce(s.std_across_m, s.std_m)::float8 ^ 2) / 2)::real
    from unnest(%s::integer[], %s::timestamptz[], %s::bigint[], %s::double precision[])
      as a (place, stamp, instance_id, within_m)
    join semap.instance i on i.instance_id = a.instance_id
    left join semap.abstraction f on f.description_id = i.absolute_description_id and f.type = 'Footprint'
    cross join lateral (
      select coalesce(f.geometry, (select public.st_point((r.pose).x_m, (r.pose).y_m)
                                   from semap.frames_in_root(array[i.frame_id], a.stamp) r)) as shape) h
    cross join lateral (
      select distinct on (w.track_id) w.*
      from (
        select s.track_id, s.stamp, s.x_m, s.y_m, s.std_m, s.std_across_m, s.is_last,
               lag(s.stamp) over one_track as before_stamp,
               lag(s.x_m) over one_track as before_x_m, lag(s.y_m) over one_track as before_y_m
        from semap.states_of_map(i.map_id, a.stamp - interval '2 s', a.stamp) s
        where s.stamp > a.stamp - interval '2 s'
        window one_track as (partition by s.track_id order by s.stamp)
      ) w
      order by w.track_id, w.stamp desc) s
    join semap.track t on t.track_id = s.track_id and t.map_id = %s
    cross join lateral (
      select coalesce(extract(epoch from a.stamp - s.stamp) / extract(epoch from s.stamp - s.before_stamp), 0)
               ::double precision as ahead) v
    cross join lateral (
      select public.st_distance(h.shape, public.st_point(
        s.x_m + coalesce((s.x_m - s.before_x_m) * v.ahead, 0),
        s.y_m + coalesce((s.y_m - s.before_y_m) * v.ahead, 0))) as distance_m) d
    where d.distance_m <= a.within_m and not (s.is_last and s.stamp < a.stamp)
"""


def enriched(connection: psycopg.Connection, map_id: int, rows: Sequence[Row], needs: Needs) -> list[Row]:
    """The same rows of a map with the properties that are needed."""
    found: list[dict[str, Value]] = [{} for _ in rows]
    with translated():
        if needs.actor_within_m:
            _add_actors(connection, map_id, rows, needs, found)
        if needs.position:
            _add_positions(connection, rows, needs.position, found)
        if needs.footprint or needs.position:
            _add_footprints(connection, rows, needs, found)
    return [
        row.saying({**_plain(row.values), **values}) if values or ASKED & row.values.keys() else row
        for row, values in zip(rows, found, strict=True)
    ]


def _plain(values: Mapping[str, Value]) -> Mapping[str, Value]:
    """Without what was looked up before, when not all that counts may have come."""
    return {name: value for name, value in values.items() if name not in ASKED}


def _add_actors(
    connection: psycopg.Connection,
    map_id: int,
    rows: Sequence[Row],
    needs: Needs,
    found: Sequence[dict[str, Value]],
) -> None:
    within_m = needs.actor_within_m
    asked = [
        (place, to_datetime(row.own_stamp_us), row.values["instance_id"], within_m[_input(row)])
        for place, row in enumerate(rows)
        if _input(row) in within_m and row.values.get("instance_id") is not None
    ]
    if not asked:
        return
    candidates: dict[int, list[Candidate]] = {}
    columns = [list(column) for column in zip(*asked, strict=True)]
    for place, *candidate in connection.execute(CANDIDATES, [*columns, map_id]):
        candidates.setdefault(place, []).append(Candidate(*candidate))
    for place, *_ in asked:
        near, row = candidates.get(place, []), rows[place]
        found[place] |= _actor_values(near, within_m[_input(row)])
        nearer_m = needs.actor_nearer_m.get(_input(row))
        if nearer_m and near:
            found[place][ACTOR_NEARER] = {repr(each_m): _actor_values(near, each_m) for each_m in nearer_m}


def _actor_values(near: Sequence[Candidate], within_m: float) -> dict[str, Value]:
    actor = likeliest(near, within_m)
    if actor is None:
        return {}
    return {
        "actor": actor.candidate.name,
        "actor_id": actor.candidate.track_id,
        "actor_likelihood": actor.likelihood,
        "actor_distance_m": actor.candidate.distance_m,
    }


def _add_positions(
    connection: psycopg.Connection,
    rows: Sequence[Row],
    inputs: frozenset[str],
    found: Sequence[dict[str, Value]],
) -> None:
    asked = [
        # a relation that was known later than it was is placed where it was known
        (
            place,
            to_datetime(row.stamp_us if row.source == "relation" else row.own_stamp_us),
            row.values["track_id"],
        )
        for place, row in enumerate(rows)
        if _input(row) in inputs and row.values.get("track_id") is not None
    ]
    if asked:
        columns = [list(column) for column in zip(*asked, strict=True)]
        for place, *position in connection.execute(POSITIONS, columns):
            found[place]["position"] = shapely.Point([part for part in position if part is not None])


def _add_footprints(
    connection: psycopg.Connection, rows: Sequence[Row], needs: Needs, found: Sequence[dict[str, Value]]
) -> None:
    """Footprints, and the position of an instance where no track is: the middle of its footprint."""
    instance_ids = {
        row.values["instance_id"]
        for row in rows
        if _input(row) in needs.footprint | needs.position and row.values.get("instance_id") is not None
    }
    if not instance_ids:
        return
    shapes = {
        instance_id: shapely.from_wkb(wkb)
        for instance_id, wkb in connection.execute(FOOTPRINTS, [list(instance_ids)])
    }
    for row, values in zip(rows, found, strict=True):
        footprint = shapes.get(row.values.get("instance_id"))
        if footprint is None:
            continue
        if _input(row) in needs.footprint:
            values["footprint"] = footprint
        if _input(row) in needs.position and row.values.get("track_id") is None:
            values["position"] = footprint.centroid


def _input(row: Row) -> str:
    return str(row.values["input"])
