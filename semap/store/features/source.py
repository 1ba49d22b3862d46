"""What each kind of collection is made of: its rows, properties, place and time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import (
    Boolean,
    ColumnElement,
    Double,
    FromClause,
    Select,
    String,
    and_,
    case,
    cast,
    column,
    false,
    func,
    literal_column,
    null,
    select,
    text,
)

from semap.cql2 import Kind
from semap.model.track_state import MEASURES
from semap.store.database.cql2_sql import Thing
from semap.store.database.tables import (
    STAMP,
    concept,
    event,
    event_amendment,
    event_number,
    instance,
    one_of,
    region,
    relation,
    source,
    track,
    track_place,
)
from semap.store.features.collection import Collection
from semap.store.map.selection import FOOTPRINT, INSTANCE, POSITION, with_shapes

Sql = ColumnElement[Any]
GEOMETRY = "geometry"


@dataclass(frozen=True)
class Source:
    """A kind of collection in SQL.

    rows    what is selected from; with a condition, only of the map and concept
    keys    by which a row is known, and in whose order features come
    thing   what a filter may ask; its property `geometry` is the shape seen from above, in the map frame
    shape   the shape that is given out, with heights where they are known, in the map frame
    low, high    heights of it [m]; null where they are not known
    start, end   when it was; both null: that does not matter to it
    complete     properties that nothing lacks
    unindexed    ids of the things whose shape is not in the indexes of shapes; None where no shape is
    """

    rows: FromClause
    where: Sql
    keys: Mapping[str, Sql]
    thing: Thing
    shape: Sql
    low: Sql
    high: Sql
    complete: frozenset[str]
    start: Sql | None = None
    end: Sql | None = None
    unindexed: Select[tuple[int]] | None = None

    @property
    def properties(self) -> tuple[str, ...]:
        return tuple(name for name in self.thing.kinds if name not in (GEOMETRY, "position", "footprint"))


def source_of(collection: Collection) -> Source:
    match collection.kind:
        case "instances":
            return _instances(collection)
        case "tracks":
            return replace(_TRACKS, where=track.c.map_id == collection.map_id)
        case "relations":
            return replace(_RELATIONS, where=relation.c.map_id == collection.map_id)
        case "events":
            return replace(_EVENTS, where=event.c.map_id == collection.map_id)


def _instances(collection: Collection) -> Source:
    of_map = instance.c.map_id == collection.map_id
    shapeless = select(_SHAPELESS.c.instance_id).where(
        _SHAPELESS.c.map_id == collection.map_id, _SHAPELESS.c.relative_description_id.is_(None)
    )
    if collection.concept != "Thing":
        of_map = and_(of_map, one_of(instance.c.concept_id, collection.concept_ids))
    return replace(_INSTANCES, where=of_map, unindexed=shapeless)


def _point(x_m: Sql, y_m: Sql, z_m: Sql) -> Sql:
    """With its height where that is known."""
    flat, full = func.public.st_makepoint(x_m, y_m), func.public.st_makepoint(x_m, y_m, z_m)
    return func.coalesce(full, flat, type_=None)


def _of_instance(name: str, instance_id: Sql) -> Sql:
    of_concept = select(instance.c.instance_id).where(
        instance.c.instance_id == instance_id, INSTANCE.is_a(name)
    )
    return of_concept.exists()


_SHAPELESS = instance.alias("shapeless")
_ORIGIN = case(  # of what has no description, such as a door that was drawn as a line
    (instance.c.relative_description_id.is_(None), func.semap.origin_in_root(instance.c.frame_id, type_=None))
)
_SHAPE = func.coalesce(FOOTPRINT.c.geometry, POSITION.c.geometry, type_=None)
_FLAT_INSTANCE = func.coalesce(_SHAPE, func.public.st_force2d(_ORIGIN), type_=None)
_LOW = func.coalesce(FOOTPRINT.c.z_min_m, POSITION.c.z_min_m)
_HIGH = func.coalesce(FOOTPRINT.c.z_max_m, POSITION.c.z_max_m)
_INSTANCES = Source(
    # outer joins throughout, so that what is not asked for is not joined
    rows=with_shapes(instance.outerjoin(concept, concept.c.concept_id == instance.c.concept_id)),
    where=false(),
    keys={"id": instance.c.instance_id},
    thing=Thing(
        kinds={
            **INSTANCE.kinds,
            "z_min_m": "number",
            "z_max_m": "number",
            GEOMETRY: "shape",
        },
        columns={
            **INSTANCE.columns,
            "z_min_m": _LOW,
            "z_max_m": _HIGH,
            GEOMETRY: _FLAT_INSTANCE,
        },
        is_a=INSTANCE.is_a,
    ),
    shape=func.coalesce(func.public.st_force3dz(_SHAPE, _LOW), _SHAPE, _ORIGIN, type_=None),
    low=_LOW,
    high=_HIGH,
    complete=frozenset({"name", "concept", "uid", "id", "created_at", "updated_at"}),
)

_NEVER = literal_column("'-infinity'::timestamptz", STAMP)
_SEEN_AT = func.nullif(track_place.c.stamp, _NEVER, type_=STAMP)
_TRACK_KINDS: dict[str, Kind] = {
    "id": "number",
    "uid": "text",
    "name": "text",
    "source": "text",
    "live": "boolean",
    "ended_at": "instant",
    "stamp": "instant",
    **dict.fromkeys(MEASURES, "number"),
    GEOMETRY: "shape",
}
_TRACKS = Source(
    rows=track.join(track_place, track_place.c.track_id == track.c.track_id).join(
        source, source.c.source_id == track.c.source_id
    ),
    where=false(),
    keys={"id": track.c.track_id},
    thing=Thing(
        kinds=_TRACK_KINDS,
        columns={
            "id": cast(track.c.track_id, Double),
            "uid": cast(track.c.uid, String),
            "name": track.c.name,
            "source": source.c.name,
            "live": track_place.c.live,
            "ended_at": track.c.ended_at,
            "stamp": _SEEN_AT,
            **{name: cast(track_place.c[name], Double) for name in MEASURES},
            GEOMETRY: func.public.st_makepoint(track_place.c.x_m, track_place.c.y_m),
        },
        is_a=lambda _: false(),
    ),
    shape=_point(track_place.c.x_m, track_place.c.y_m, track_place.c.z_m),
    low=track_place.c.z_m,
    high=track_place.c.z_m,
    complete=frozenset({"id", "uid", "name", "source", "live"}),
    start=_SEEN_AT,
    end=_SEEN_AT,
)

_RELATIONS = Source(
    rows=relation.join(
        region,
        and_(region.c.query_id == relation.c.query_id, region.c.instance_id == relation.c.instance_id)
        & relation.c.confirmed,
    )
    .join(track, track.c.track_id == relation.c.track_id)
    .join(track_place, track_place.c.track_id == relation.c.track_id),
    where=false(),
    keys={"track_id": relation.c.track_id, "region_id": region.c.region_id},
    thing=Thing(
        kinds={
            "query": "text",
            "track_id": "number",
            "track": "text",
            "instance_id": "number",
            "instance": "text",
            "since": "instant",
            GEOMETRY: "shape",
        },
        columns={
            "query": region.c.query_name,
            "track_id": cast(relation.c.track_id, Double),
            "track": track.c.name,
            "instance_id": cast(relation.c.instance_id, Double),
            "instance": region.c.instance_name,
            "since": relation.c.since,
            GEOMETRY: func.public.st_makepoint(track_place.c.x_m, track_place.c.y_m),
        },
        is_a=lambda name: _of_instance(name, relation.c.instance_id),
    ),
    shape=_point(track_place.c.x_m, track_place.c.y_m, track_place.c.z_m),
    low=track_place.c.z_m,
    high=track_place.c.z_m,
    complete=frozenset({"query", "track_id", "track", "instance_id", "instance", "since"}),
    start=relation.c.since,
    end=null(),
)

_PAST = (
    func.semap.states(func.array_fill(event.c.track_id, text("array[1]")), event.c.stamp, event.c.stamp)
    .table_valued(column("x_m", Double), column("y_m", Double), column("z_m", Double))
    .alias("past")
)
_AT_INSTANCE = (
    select(POSITION.c.geometry)
    .where(POSITION.c.instance_id == event.c.instance_id, POSITION.c.type == text("'Position2D'"))
    .scalar_subquery()
)
_HEIGHT = select(_PAST.c.z_m).scalar_subquery()
_EVENTS = Source(
    rows=event.join(event_number, event_number.c.event_id == event.c.event_id).outerjoin(
        event_amendment, event_amendment.c.event_id == event.c.event_id
    ),
    where=false(),
    keys={"id": event_number.c.number},
    thing=Thing(
        kinds={
            "id": "number",
            "event_id": "text",
            "type": "text",
            "stamp": "instant",
            "since": "instant",
            "cause": "text",
            "rule": "text",
            "rule_version": "number",
            "track_id": "number",
            "track": "text",
            "instance_id": "number",
            "instance": "text",
            "confidence": "number",
            "by_batch": "boolean",
            "verdict": "text",
            "key": "any",
            "measures": "any",
            GEOMETRY: "shape",
        },
        columns={
            "id": cast(event_number.c.number, Double),
            "event_id": cast(event.c.event_id, String),
            "type": event.c.type,
            "stamp": event.c.stamp,
            "since": event.c.since,
            "cause": event.c.cause,
            "rule": event.c.rule_name,
            "rule_version": cast(event.c.rule_version, Double),
            "track_id": cast(event.c.track_id, Double),
            "track": event.c.track_name,
            "instance_id": cast(event.c.instance_id, Double),
            "instance": event.c.instance_name,
            "confidence": event.c.confidence,
            "by_batch": event.c.by_batch,
            "verdict": event_amendment.c.verdict,
            "key": event.c.key,
            "measures": event.c.measures,
            GEOMETRY: func.coalesce(
                select(func.public.st_makepoint(_PAST.c.x_m, _PAST.c.y_m)).scalar_subquery(),
                _AT_INSTANCE,
                type_=None,
            ),
        },
        is_a=lambda name: _of_instance(name, event.c.instance_id),
    ),
    shape=func.coalesce(
        select(_point(_PAST.c.x_m, _PAST.c.y_m, _PAST.c.z_m)).scalar_subquery(),
        _AT_INSTANCE,
        type_=None,
    ),
    low=_HEIGHT,
    high=_HEIGHT,
    complete=frozenset({"id", "event_id", "type", "stamp", "since", "rule", "rule_version", "by_batch"}),
    start=event.c.stamp,
    end=event.c.stamp,
)

TYPES: Mapping[Kind, Any] = {"number": Double, "text": String, "instant": STAMP, "boolean": Boolean}
"""Of what can be sorted by."""
