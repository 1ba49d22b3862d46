"""What trackers found that they had mistaken: two tracks that are one person, or that changed places."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, column, select, table

from semap.store.database.connection import translated


@dataclass(frozen=True)
class TrackAmendment:
    """What is to be known of two tracks of one source, from a stamp on.

    kind   merged: both are one person; the other is the older track;
           switched: each followed the other's person
    since  from when on
    found  the stamp of the record that told
    """

    track_amendment_id: int
    map: str
    source: str
    kind: str
    track_id: int
    track: str
    other_track_id: int
    other_track: str
    since: datetime
    found: datetime


def list_track_amendments(
    connection: Connection,
    *,
    map_name: str | None = None,
    track_name: str | None = None,
    after: int = 0,
    limit: int = 100,
) -> tuple[TrackAmendment, ...]:
    """At most `limit` amendments in the order of their commits, from the first after `after`.

    track_name  only those of a track of this name, in either place
    """
    found = select(*_AMENDED.c).where(_AMENDED.c.track_amendment_id > after)
    if map_name is not None:
        found = found.where(_AMENDED.c.map == map_name)
    if track_name is not None:
        found = found.where((_AMENDED.c.track == track_name) | (_AMENDED.c.other_track == track_name))
    with translated():
        rows = connection.execute(found.order_by(_AMENDED.c.track_amendment_id).limit(limit))
        return tuple(TrackAmendment(*row) for row in rows)


_AMENDED = table(
    "track_amended", *(column(name) for name in TrackAmendment.__dataclass_fields__), schema="semap"
)
