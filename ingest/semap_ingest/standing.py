"""What of a file of tracks stands in the database already, asked before anything of it is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from uuid import UUID, uuid5

import numpy as np
import psycopg

from semap.errors import Conflict, NotFound
from semap.store.database.connection import translated
from semap.timeline.stamp import to_datetime
from semap_ingest.track_file import Tracks

FIND_SOURCE = """
    select s.source_id, s.late_states, coalesce(r.states_done, 0)
    from semap.source s left join semap.recording r on r.source_id = s.source_id and r.fingerprint = %s
    where s.map_id = %s and s.name = %s
"""
FIND_TRACKS = """
    select k.name, case when k.source_id <> %(source)s then n.name end
    from semap.track k join semap.source n using (source_id)
    where k.source_id = %(source)s and k.name = any (%(names)s) or k.uid = any (%(uids)s)
"""
"""Tracks of a source by name, and those that it handed over to another one, with that one's name."""
FIND_STORED = """
    with new as (
      select k.track_id, f.stamp
      from unnest(%(names)s::text[], %(stamps)s::timestamptz[]) f (name, stamp)
      join semap.track k on k.source_id = %(source)s and k.name = f.name
      join semap.track_now t using (track_id)
      left join semap.source_count c on c.source_id = k.source_id
      where f.stamp between t.first_stamp and greatest(t.stamp, t.outlier_stamp, c.newest_stamp)
    )
    select k.name, s.stamp
    from semap.states(array(select distinct track_id from new), %(first)s, %(last)s) s
    join new n using (track_id, stamp) join semap.track k using (track_id)
    order by s.stamp, k.name limit 1
"""


@dataclass(frozen=True)
class Plan:
    """What to replay, and how.

    realtime   1 is the pace of the recording, 2 twice as fast; None: as fast as it goes
    keep_open  leave the tracks open at their last state, for another file that goes on with them
    concept    what kind of thing each track is; None: what is known of it stays
    attributes of each track; None: likewise
    """

    map_name: str
    source: str
    path: str
    fingerprint: str
    batch_size: int = 1000
    realtime: float | None = None
    keep_open: bool = False
    concept: str | None = None
    attributes: Mapping[str, object] | None = None


@dataclass(frozen=True)
class Standing:
    """The map, the source if it is there, the states of the file that are done, those that came late."""

    map_id: int
    source_id: int | None
    done: int
    late: int


def track_uid(map_uid: UUID, source: str, name: str) -> UUID:
    """The identity of a track: the same whenever its recording is replayed on a map of that name."""
    return uuid5(map_uid, f"{source}/{name}")


def look_up(connection: psycopg.Connection, plan: Plan, tracks: Tracks) -> Standing:
    """How far the file has come.

    raises  NotFound where there is no such map; Conflict where states of these tracks are stored at the same
            stamps, or one of them goes on at another source
    """
    with translated(), connection.transaction():
        row = connection.execute(
            "select map_id, uid from semap.map where name = %s", [plan.map_name]
        ).fetchone()
        if row is None:
            raise NotFound("map", plan.map_name, "List them: semap map list")
        map_id, map_uid = row
        found = connection.execute(FIND_SOURCE, [plan.fingerprint, map_id, plan.source]).fetchone()
        if found is None:
            return Standing(map_id, None, 0, 0)
        source_id, late, done = found
        _require_here(connection, plan, source_id, map_uid, tracks, done)
        _require_new(connection, plan, source_id, tracks, done)
    return Standing(map_id, source_id, done, late)


def stored_already(plan: Plan, what: str) -> Conflict:
    return Conflict(
        f"{plan.path}: States of the source {plan.source} are stored already: {what}",
        "Give this recording a source of its own (--source NAME).",
    )


def _require_here(
    connection: psycopg.Connection, plan: Plan, source_id: int, map_uid: UUID, tracks: Tracks, done: int
) -> None:
    names = [tracks.names[number] for number in np.unique(tracks.track[done:])]
    uids = [track_uid(map_uid, plan.source, name) for name in names]
    rows = connection.execute(FIND_TRACKS, {"source": source_id, "names": names, "uids": uids})
    for name, other in rows:
        if other is not None:
            raise Conflict(
                f"{plan.path}: The track {name} of the source {plan.source} was handed over to {other}.",
                f"Bring in what else is known of it as the source {other}.",
            )


def _require_new(
    connection: psycopg.Connection, plan: Plan, source_id: int, tracks: Tracks, done: int
) -> None:
    if done == len(tracks):
        return
    stamps = [to_datetime(int(stamp_us)) for stamp_us in tracks.stamp_us[done:]]
    names = [tracks.names[number] for number in tracks.track[done:]]
    stored = connection.execute(
        FIND_STORED,
        {"source": source_id, "names": names, "stamps": stamps, "first": stamps[0], "last": stamps[-1]},
    ).fetchone()
    if stored is not None:
        name, stamp = stored
        raise stored_already(plan, f"the track {name} has one at {stamp.isoformat()}.")
