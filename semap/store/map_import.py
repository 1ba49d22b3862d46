"""A whole map into the database, as `semap.store.map_export` gave it or a person wrote it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from sqlalchemy import Connection, insert, select, text

from semap.errors import InvalidInput
from semap.geometry.abstractions import derive
from semap.model.building import Finding
from semap.model.continuous_query import declared
from semap.model.folding import folded
from semap.model.map_document import ConceptEntry, FrameEntry, InstanceEntry, MapDocument, StampedPose
from semap.model.pose import IDENTITY
from semap.store.anchor import set_anchor
from semap.store.concept import (
    ROOT,
    Concept,
    change_concept,
    check_attributes,
    create_concept,
    list_concepts,
)
from semap.store.database import translated
from semap.store.description import insert_descriptions, write_descriptions
from semap.store.grids import put_grid
from semap.store.maps import create_map
from semap.store.placement import PARTS, ROOT_FRAME, normalised
from semap.store.queries import columns_of
from semap.store.tables import concept, continuous_query, one_of, rule

INSERT_FRAMES = text("""
    insert into semap.frame (map_id, name)
    select :map_id, name from unnest(cast(:names as text[])) with ordinality as v (name, place) order by place
""")
SET_PARENTS = text("""
    update semap.frame f set parent_id = p.frame_id
    from unnest(cast(:names as text[]), cast(:parents as text[])) as v (name, parent)
    join semap.frame p on p.map_id = :map_id and p.name = v.parent
    where f.map_id = :map_id and f.name = v.name
""")
INSERT_POSES = text("""
    insert into semap.frame_pose (frame_id, stamp, x_m, y_m, z_m, qx, qy, qz, qw)
    select f.frame_id, coalesce(v.stamp, '-infinity'), v.x_m, v.y_m, v.z_m, v.qx, v.qy, v.qz, v.qw
    from unnest(cast(:names as text[]), cast(:stamps as timestamptz[]),
                cast(:x_m as float8[]), cast(:y_m as float8[]), cast(:z_m as float8[]),
                cast(:qx as float8[]), cast(:qy as float8[]), cast(:qz as float8[]), cast(:qw as float8[]))
      as v (name, stamp, x_m, y_m, z_m, qx, qy, qz, qw)
    join semap.frame f on f.map_id = :map_id and f.name = v.name
    on conflict (frame_id, stamp) do update
    set x_m = excluded.x_m, y_m = excluded.y_m, z_m = excluded.z_m,
        qx = excluded.qx, qy = excluded.qy, qz = excluded.qz, qw = excluded.qw
""")
INSERT_INSTANCES = text("""
    insert into semap.instance
      (uid, map_id, name, alias, concept_id, frame_id, relative_description_id, attributes)
    select v.uid, :map_id, v.name, v.alias, c.concept_id, f.frame_id, v.description_id,
           cast(v.attributes as jsonb)
    from unnest(cast(:uids as uuid[]), cast(:names as text[]), cast(:aliases as text[]),
                cast(:concepts as text[]), cast(:frames as text[]), cast(:description_ids as bigint[]),
                cast(:attributes as text[]))
      with ordinality as v (uid, name, alias, concept, frame, description_id, attributes, place)
    join semap.concept c on c.name = v.concept
    join semap.frame f on f.map_id = :map_id and f.name = v.frame
    order by v.place
""")
SET_STOREYS = text("""
    update semap.instance i set storey_id = s.instance_id
    from unnest(cast(:names as text[]), cast(:storeys as text[])) as v (name, storey)
    join semap.instance s on s.map_id = :map_id and s.name = v.storey
    where i.map_id = :map_id and i.name = v.name
""")
INSERT_JOINS = text("""
    insert into semap.door_room (door_id, room_id)
    select distinct d.instance_id, r.instance_id
    from unnest(cast(:doors as text[]), cast(:rooms as text[])) as v (door, room)
    join semap.instance d on d.map_id = :map_id and d.name = v.door
    join semap.instance r on r.map_id = :map_id and r.name = v.room
""")


def import_map(connection: Connection, document: MapDocument) -> tuple[Finding, ...]:
    """A new map of a document. Concepts that are missing are made; those that are there stay as they are.

    returns what was made of its concepts

    raises  Conflict if there is such a map, InvalidInput if the document names what it does not have
    """
    _require_whole(document)
    derived = [(each, derive(each.geometries)) for each in document.descriptions]
    notes = _make_concepts(connection, document.concepts)
    made = create_map(connection, document.name, document.cell_m, with_visits=False)
    if document.anchor is not None:
        set_anchor(connection, document.name, document.anchor)
    _insert_frames(connection, made.map_id, document.frames)
    ids = insert_descriptions(
        connection, made.map_id, [each.key if each.is_shared else None for each in document.descriptions]
    )
    write_descriptions(
        connection, [(id_, each.geometries, parts) for id_, (each, parts) in zip(ids, derived, strict=True)]
    )
    by_key = {each.key: id_ for id_, each in zip(ids, document.descriptions, strict=True)}
    _insert_instances(connection, made.map_id, document.instances, by_key)
    _insert_queries(connection, made.map_id, document)
    for grid in document.grids:
        put_grid(connection, document.name, grid)
    return notes


def _require_whole(document: MapDocument) -> None:
    """raises InvalidInput where one part of a document names another that is not there"""
    frames = {each.name for each in document.frames}
    names = {each.name for each in document.instances}
    keys = {each.key for each in document.descriptions}
    queries = {each.name for each in document.queries}
    missing = [
        *(
            ("frame", e.parent, e.name)
            for e in document.frames
            if e.parent is not None and e.parent not in frames
        ),
        *(("frame", e.frame, e.name) for e in document.instances if e.frame not in frames),
        *(
            ("description", e.description, e.name)
            for e in document.instances
            if e.description not in keys | {None}
        ),
        *(("storey", e.storey, e.name) for e in document.instances if e.storey not in names | {None}),
        *(
            ("other instance", j, e.name)
            for e in document.instances
            for j in e.joins
            if j not in names - {e.name}
        ),
        *(("query", q, e.name) for e in document.rules for q in e.queries if q not in queries),
    ]
    for kind, name, owner in missing:
        raise InvalidInput(f"{owner} names the {kind} {name}, which is not there", f"Add the {kind}.", owner)
    if ROOT_FRAME not in frames:
        raise InvalidInput("there is no root frame `map`", "Add a frame `map` without a parent.", "frames")
    root = next(each for each in document.frames if each.name == ROOT_FRAME)
    if root.parent is not None or any(each != StampedPose(IDENTITY) for each in root.poses):
        raise InvalidInput(
            "the root frame `map` has a parent or a pose",
            "Leave them out, and put what should move on a frame below it.",
            "frames",
        )


def _make_concepts(connection: Connection, entries: Sequence[ConceptEntry]) -> tuple[Finding, ...]:
    """Make the concepts that are missing; says which, and which stay other than the document has them."""
    known = {each.name: each for each in list_concepts(connection)}
    new = [each for each in entries if each.name not in known]
    notes = [
        Finding("note", each.name, f"a new concept, put below {', '.join(each.parents or (ROOT,))}")
        for each in new
    ]
    notes += [
        Finding("note", each.name, "the concept stays as the database has it, which is not as in the file")
        for each in entries
        if each.name in known and _differs(each, known[each.name])
    ]
    for each in new:
        create_concept(connection, Concept(0, each.name, (), each.iris, each.comment, each.attribute_schema))
    for each in new:
        change_concept(connection, each.name, parents=each.parents or (ROOT,))
    return folded(notes)


def _differs(entry: ConceptEntry, known: Concept) -> bool:
    """Whether a document says something of a concept that is not so; what it leaves out it does not say."""
    return any(
        said and said != present
        for said, present in (
            (sorted(entry.parents), sorted(known.parents)),
            (sorted(entry.iris), sorted(known.iris)),
            (entry.comment, known.comment),
            (entry.attribute_schema, known.attribute_schema),
        )
    )


def _insert_frames(connection: Connection, map_id: int, entries: Sequence[FrameEntry]) -> None:
    new = [each.name for each in entries if each.name != ROOT_FRAME]
    below = [each for each in entries if each.parent is not None]
    poses = [(each.name, stamped) for each in entries for stamped in each.poses]
    placed = [normalised(stamped.pose) for _, stamped in poses]
    with translated():
        connection.execute(INSERT_FRAMES, {"map_id": map_id, "names": new})
        connection.execute(
            SET_PARENTS,
            {
                "map_id": map_id,
                "names": [each.name for each in below],
                "parents": [each.parent for each in below],
            },
        )
        connection.execute(
            INSERT_POSES,
            {
                "map_id": map_id,
                "names": [name for name, _ in poses],
                "stamps": [stamped.stamp for _, stamped in poses],
                **{part: [float(getattr(pose, part)) for pose in placed] for part in PARTS},
            },
        )


def _insert_instances(
    connection: Connection, map_id: int, entries: Sequence[InstanceEntry], ids: Mapping[str, int]
) -> None:
    if not entries:
        return
    storeys = [each for each in entries if each.storey is not None]
    joins = [(each.name, room) for each in entries for room in each.joins]
    with translated():
        known = set(
            connection.scalars(
                select(concept.c.name).where(one_of(concept.c.name, {each.concept for each in entries}))
            )
        )
        for each in entries:
            if each.concept not in known:
                raise InvalidInput(
                    f"there is no concept {each.concept}",
                    "Add it to the concepts of the document.",
                    each.name,
                )
        check_attributes(connection, ((each.name, each.concept, each.attributes) for each in entries))
        connection.execute(
            INSERT_INSTANCES,
            {
                "map_id": map_id,
                "uids": [each.uid for each in entries],
                "names": [each.name for each in entries],
                "aliases": [each.alias for each in entries],
                "concepts": [each.concept for each in entries],
                "frames": [each.frame for each in entries],
                "description_ids": [
                    None if each.description is None else ids[each.description] for each in entries
                ],
                "attributes": [json.dumps(dict(each.attributes)) for each in entries],
            },
        )
        if storeys:
            connection.execute(
                SET_STOREYS,
                {
                    "map_id": map_id,
                    "names": [each.name for each in storeys],
                    "storeys": [each.storey for each in storeys],
                },
            )
        if joins:
            connection.execute(
                INSERT_JOINS,
                {"map_id": map_id, "doors": [d for d, _ in joins], "rooms": [r for _, r in joins]},
            )


def _insert_queries(connection: Connection, map_id: int, document: MapDocument) -> None:
    with translated():
        query_ids: dict[str, int] = {}
        for query in document.queries:
            asked = declared(query.name, query.predicate, query.concept, query.options)
            query_ids[query.name] = connection.scalar(
                insert(continuous_query)
                .values(map_id=map_id, enabled=query.enabled, **columns_of(connection, map_id, asked))
                .returning(continuous_query.c.query_id)
            )
        for each in document.rules:
            connection.execute(
                insert(rule).values(
                    map_id=map_id,
                    name=each.name,
                    queries={name: query_ids[name] for name in each.queries},
                    declaration=dict(each.declaration),
                    enabled=each.enabled,
                )
            )
