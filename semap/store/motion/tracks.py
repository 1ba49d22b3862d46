"""Tracks with where they are now."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

import shapely
from sqlalchemy import Connection, func, literal_column, select, update

from semap.errors import NotFound
from semap.model.track_state import STATE_COLUMNS, Seen
from semap.store.database.connection import translated
from semap.store.database.tables import concept, map_, source, track, track_place
from semap.store.map.concept import check_attributes, concept_id

NEVER = literal_column("'-infinity'::timestamptz", track_place.c.stamp.type)


@dataclass(frozen=True)
class PresentState(Seen):
    """Where a track was last seen.

    footprint  the ground that it covers; None where its extent is not known
    """

    footprint: shapely.Polygon | None = None


@dataclass(frozen=True)
class Track:
    """A track; `state` is None until its first state, `live` False before that and after its end.

    concept     what kind of thing it is, if that was said; attributes what else is known
    """

    track_id: int
    uid: UUID
    map: str
    source: str
    name: str
    live: bool
    ended_at: datetime | None
    concept: str | None
    attributes: Mapping[str, Any]
    state: PresentState | None


def list_tracks(
    connection: Connection,
    *,
    map_name: str | None = None,
    name: str | None = None,
    name_part: str | None = None,
    live: bool | None = None,
    after: int = 0,
    limit: int = 100,
) -> tuple[Track, ...]:
    """At most `limit` tracks in the order of their ids, from the first after `after`.

    name_part  a part of the name, in small or large letters
    """
    found = _TRACKS.where(track.c.track_id > after).order_by(track.c.track_id).limit(limit)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    if name is not None:
        found = found.where(track.c.name == name)
    if name_part is not None:
        found = found.where(track.c.name.icontains(name_part, autoescape=True))
    if live is not None:
        found = found.where(track_place.c.live == live)
    with translated():
        return tuple(_track(row) for row in connection.execute(found))


def count_ended(connection: Connection, *, map_name: str | None = None, after: int = 0) -> int:
    """How many tracks do not live, from the first after `after`."""
    found = select(func.count()).select_from(track).join(map_, map_.c.map_id == track.c.map_id)
    found = found.join(track_place, track_place.c.track_id == track.c.track_id)
    found = found.where(track.c.track_id > after, ~track_place.c.live)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    with translated():
        return int(connection.scalar(found) or 0)


def get_track(connection: Connection, track_id: int) -> Track:
    """raises NotFound"""
    with translated():
        row = connection.execute(_TRACKS.where(track.c.track_id == track_id)).one_or_none()
    if row is None:
        raise NotFound("track", track_id, "List the tracks to see their ids.")
    return _track(row)


def describe_track(
    connection: Connection, track_id: int, concept_name: str | None, attributes: Mapping[str, object]
) -> Track:
    """Say what kind of thing a track is and what else is known of it; relations of queries that ask follow.

    raises  NotFound; InvalidInput for an unknown concept, or attributes that do not follow its schema
    """
    known = get_track(connection, track_id)
    number = described(connection, known.name, concept_name, attributes)
    with translated():
        connection.execute(
            update(track)
            .where(track.c.track_id == track_id)
            .values(concept_id=number, attributes=dict(attributes))
        )
    return get_track(connection, track_id)


def described(
    connection: Connection, name: str, concept_name: str | None, attributes: Mapping[str, object]
) -> int | None:
    """The id of the concept of what is called so, if one is said.

    raises  InvalidInput where there is none, or where the attributes do not follow its schema
    """
    if concept_name is None:
        return None
    found = concept_id(connection, concept_name)
    check_attributes(connection, [(name, concept_name, attributes)])
    return found


def _track(row: Sequence[Any]) -> Track:
    known, stamp, values, shape = row[:9], row[9], row[10:-1], row[-1]
    if stamp is None:
        return Track(*[*known, None])
    footprint = None if shape is None else shapely.from_wkb(shape)
    return Track(*[*known, PresentState(*[stamp, *values, footprint])])


_FOOTPRINT = func.semap.track_footprint(
    track_place.c.x_m,
    track_place.c.y_m,
    track_place.c.heading_rad,
    track_place.c.length_m,
    track_place.c.width_m,
)
_TRACKS = (
    select(
        track.c.track_id,
        track.c.uid,
        map_.c.name,
        source.c.name,
        track.c.name,
        track_place.c.live,
        track.c.ended_at,
        concept.c.name,
        track.c.attributes,
        func.nullif(track_place.c.stamp, NEVER),
        *(track_place.c[name] for name in STATE_COLUMNS if name not in ("stamp", "is_last")),
        func.st_asbinary(_FOOTPRINT),
    )
    .select_from(track)
    .join(track_place, track_place.c.track_id == track.c.track_id)
    .join(map_, map_.c.map_id == track.c.map_id)
    .join(source, source.c.source_id == track.c.source_id)
    .outerjoin(concept, concept.c.concept_id == track.c.concept_id)
)
