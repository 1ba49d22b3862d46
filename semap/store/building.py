"""A building, as read from a file, becomes part of a map in the caller's transaction.

All that takes long, the shapes, is derived before the first statement, since a write keeps the writers of
track states out until the transaction ends.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from uuid import UUID

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, or_, select, text

from semap.errors import Conflict, InvalidInput
from semap.geometry.abstractions import Abstraction, derive
from semap.model.building import Building, Finding, Item, Storey
from semap.model.folding import folded
from semap.model.pose import Pose
from semap.model.source_geometry import SourceGeometry
from semap.store.anchor import place_on_earth
from semap.store.concept import check_attributes, ensure_concepts
from semap.store.database import translated
from semap.store.description import insert_descriptions, sources_of, write_descriptions
from semap.store.maps import map_id_of
from semap.store.placement import ROOT_FRAME, Placed, insert_frames, map_from_frames, normalised, pose_in
from semap.store.tables import concept, frame, instance, one_of

STOREY = "Storey"
DOOR = "Door"
NAMED_AT_MOST = 5
PROGRESS_EVERY = 50

Progress = Callable[[int, int], None]
"""Called with how many items are ready, and of how many."""

INSERT_INSTANCES = text("""
    insert into semap.instance (uid, map_id, name, alias, concept_id, frame_id, relative_description_id,
                                storey_id, attributes)
    select uid, :map_id, name, alias, concept_id, frame_id, relative_id, storey_id, cast(attributes as jsonb)
    from unnest(cast(:uid as uuid[]), cast(:name as text[]), cast(:alias as text[]),
                cast(:concept_id as integer[]), cast(:frame_id as bigint[]), cast(:relative_id as bigint[]),
                cast(:storey_id as bigint[]), cast(:attributes as text[]))
      as v (uid, name, alias, concept_id, frame_id, relative_id, storey_id, attributes)
    returning name, instance_id
""")
INSERT_JOINS = text("""
    insert into semap.door_room (door_id, room_id)
    select * from unnest(cast(:door_ids as bigint[]), cast(:room_ids as bigint[]))
    on conflict do nothing
""")


@dataclass(frozen=True)
class ImportReport:
    """What an import brought into the map.

    concepts  number of instances of each concept
    doors     number of doors for each number of rooms that they join
    findings  what the file's reader and the import had to change or leave out
    """

    map: str
    concepts: Mapping[str, int]
    doors: Mapping[int, int]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, eq=False)
class Described:
    """The source geometries of an item in its own frame, and what is derived from them."""

    sources: tuple[SourceGeometry, ...] = ()
    derived: tuple[Abstraction, ...] = ()

    @property
    def has_footprint(self) -> bool:
        return any(each.type == "Footprint" for each in self.derived)


@dataclass(frozen=True)
class StoreyPlace:
    """A storey on the map: its instance, its frame, and `pose`, map_T_storey (4, 4)."""

    instance_id: int
    frame_id: int
    pose: NDArray[np.float64]


def import_building(
    connection: Connection, map_name: str, building: Building, progress: Progress | None = None
) -> ImportReport:
    """Bring all storeys and items of a building into a map.

    raises  NotFound if there is no such map, Conflict if a name or uid is on the map already, or if the map
            lies elsewhere on the earth, InvalidInput if a name or uid occurs twice in the building
    """
    map_id = map_id_of(connection, map_name)
    building = place_on_earth(connection, map_name, building)
    _require_new(connection, map_id, map_name, building)
    described, notes = _describe_all(building.items, progress)
    wanted = {STOREY, *(item.concept for item in building.items)}
    concept_ids, made = ensure_concepts(connection, wanted)
    notes += [Finding("note", name, "a new concept, put below Thing") for name in made]
    _insert_storeys(connection, map_id, building, concept_ids[STOREY])
    notes += insert_items(connection, map_id, building.items, described, concept_ids)
    concepts = Counter(item.concept for item in building.items)
    concepts.update({STOREY: len(building.storeys)} if building.storeys else {})
    doors = Counter(len(set(item.joins)) for item in building.items if item.concept == DOOR or item.joins)
    return ImportReport(
        map_name,
        dict(sorted(concepts.items())),
        dict(sorted(doors.items())),
        folded((*building.findings, *notes)),
    )


def insert_items(
    connection: Connection,
    map_id: int,
    items: Sequence[Item],
    described: Sequence[Described],
    concept_ids: Mapping[str, int],
) -> list[Finding]:
    """Write items with their frames and descriptions; what they name must be on the map already.

    returns  what was left out: unknown storeys and unknown rooms that a door joins
    """
    if not items:
        return []
    check_attributes(connection, ((item.name, item.concept, item.attributes) for item in items))
    storeys, notes = _storeys_of(connection, map_id, items)
    frame_ids = _insert_item_frames(connection, map_id, items, storeys)
    shaped = [each for each in described if each.sources]
    made_ids = insert_descriptions(connection, map_id, [None] * len(shaped))
    write_descriptions(
        connection,
        [(id_, each.sources, each.derived) for id_, each in zip(made_ids, shaped, strict=True)],
    )
    left = iter(made_ids)
    relative_ids = [next(left) if each.sources else None for each in described]
    columns = {
        "uid": [item.uid for item in items],
        "name": [item.name for item in items],
        "alias": [item.alias for item in items],
        "concept_id": [concept_ids[item.concept] for item in items],
        "frame_id": [frame_ids[item.name] for item in items],
        "relative_id": relative_ids,
        "storey_id": [storeys[item.storey].instance_id if item.storey in storeys else None for item in items],
        "attributes": [json.dumps(dict(item.attributes), default=str) for item in items],
    }
    with translated():
        made = connection.execute(INSERT_INSTANCES, {"map_id": map_id, **columns}).all()
    notes += _insert_joins(connection, map_id, items, dict(made))
    return notes


def describe(item: Item) -> Described:
    """What an item looks like, in its own frame.

    raises  InvalidInput for an outline that is not an area, or heights of nothing
    """
    sources = sources_of(normalised(item.pose).matrix(), item.body, item.footprint, item.band)
    return Described(sources, derive(sources) if sources else ())


def _describe_all(items: Sequence[Item], progress: Progress | None) -> tuple[list[Described], list[Finding]]:
    done: list[Described] = []
    notes: list[Finding] = []
    for count, item in enumerate(items, 1):
        try:
            done.append(describe(item))
            if done[-1].sources and not done[-1].has_footprint:
                notes.append(
                    Finding("note", item.name, "without a footprint: it has no area seen from above")
                )
        except InvalidInput as error:
            notes.append(Finding("note", item.name, f"without its heights or outline: {error}"))
            done.append(describe(replace(item, footprint=None, band=None)))
        if progress is not None and (count % PROGRESS_EVERY == 0 or count == len(items)):
            progress(count, len(items))
    return done, notes


def _require_new(connection: Connection, map_id: int, map_name: str, building: Building) -> None:
    parts: list[Storey | Item] = [*building.storeys, *building.items]
    for what, values in (("name", [part.name for part in parts]), ("uid", [part.uid for part in parts])):
        repeated = [str(value) for value, count in Counter(values).items() if count > 1]
        if repeated:
            raise InvalidInput(
                f"the {what} {_first(repeated)} occurs more than once", f"Give every part its own {what}."
            )
    names: list[str] = [part.name for part in parts]
    uids: list[UUID] = [part.uid for part in parts]
    with translated():
        taken = list(
            connection.scalars(
                select(instance.c.name)
                .where(instance.c.map_id == map_id)
                .where(or_(one_of(instance.c.name, names), one_of(instance.c.uid, uids)))
                .order_by(instance.c.instance_id)
            )
        )
        frames = connection.scalars(
            select(frame.c.name)
            .where(frame.c.map_id == map_id, one_of(frame.c.name, names))
            .order_by(frame.c.frame_id)
        )
        known = set(taken)
        taken += [name for name in frames if name not in known]
    if taken:
        raise Conflict(
            f"The map {map_name} has {_first(taken)} already.",
            "Import into another map, or delete that map first to replace what is on it.",
        )


def _first(names: Sequence[str]) -> str:
    rest = len(names) - NAMED_AT_MOST
    return ", ".join(names[:NAMED_AT_MOST]) + (f" and {rest} more" if rest > 0 else "")


def _insert_storeys(connection: Connection, map_id: int, building: Building, concept_id: int) -> None:
    if not building.storeys:
        return
    root_id = root_frame_id(connection, map_id)
    frame_ids = insert_frames(
        connection,
        map_id,
        [Placed(each.name, root_id, Pose(z_m=each.elevation_m)) for each in building.storeys],
    )
    nothing = [None] * len(building.storeys)
    with translated():
        connection.execute(
            INSERT_INSTANCES,
            {
                "map_id": map_id,
                "uid": [each.uid for each in building.storeys],
                "name": [each.name for each in building.storeys],
                "alias": nothing,
                "concept_id": [concept_id for _ in building.storeys],
                "frame_id": [frame_ids[each.name] for each in building.storeys],
                "relative_id": nothing,
                "absolute_id": nothing,
                "storey_id": nothing,
                "attributes": ["{}" for _ in building.storeys],
            },
        )


def root_frame_id(connection: Connection, map_id: int) -> int:
    """The id of the frame in which everything on the map stands in the end."""
    with translated():
        return int(
            connection.scalar(
                select(frame.c.frame_id).where(frame.c.map_id == map_id, frame.c.name == ROOT_FRAME)
            )
            or 0
        )


def _storeys_of(
    connection: Connection, map_id: int, items: Sequence[Item]
) -> tuple[dict[str | None, StoreyPlace], list[Finding]]:
    wanted = {item.storey for item in items if item.storey is not None}
    with translated():
        rows = connection.execute(
            select(instance.c.name, instance.c.instance_id, instance.c.frame_id)
            .join(concept, concept.c.concept_id == instance.c.concept_id)
            .where(instance.c.map_id == map_id, concept.c.name == STOREY, one_of(instance.c.name, wanted))
        ).all()
    matrices = map_from_frames(connection, [frame_id for _, _, frame_id in rows])
    storeys: dict[str | None, StoreyPlace] = {
        name: StoreyPlace(instance_id, frame_id, matrices[frame_id]) for name, instance_id, frame_id in rows
    }
    return storeys, [
        Finding("note", item.name, f"there is no storey {item.storey}; it stands in the map frame")
        for item in items
        if item.storey is not None and item.storey not in storeys
    ]


def _insert_item_frames(
    connection: Connection, map_id: int, items: Sequence[Item], storeys: Mapping[str | None, StoreyPlace]
) -> dict[str, int]:
    root_id = root_frame_id(connection, map_id)
    placed = []
    for item in items:
        storey = storeys.get(item.storey)
        if storey is None:
            placed.append(Placed(item.name, root_id, item.pose))
        else:
            placed.append(Placed(item.name, storey.frame_id, pose_in(storey.pose, item.pose)))
    return insert_frames(connection, map_id, placed)


def _insert_joins(
    connection: Connection, map_id: int, items: Sequence[Item], instance_ids: Mapping[str, int]
) -> list[Finding]:
    wanted = {name for item in items for name in item.joins}
    elsewhere = wanted - instance_ids.keys()
    rooms = dict(instance_ids)
    if elsewhere:
        with translated():
            rows = connection.execute(
                select(instance.c.name, instance.c.instance_id).where(
                    instance.c.map_id == map_id, one_of(instance.c.name, elsewhere)
                )
            ).all()
            rooms.update(dict(rows))
    pairs = [
        (instance_ids[item.name], rooms[name])
        for item in items
        for name in item.joins
        if name in rooms and name != item.name
    ]
    if pairs:
        with translated():
            connection.execute(
                INSERT_JOINS, {"door_ids": [a for a, _ in pairs], "room_ids": [b for _, b in pairs]}
            )
    return [
        Finding("skipped", item.name, f"it joins {name}, which is not there")
        for item in items
        for name in item.joins
        if name not in rooms
    ]
