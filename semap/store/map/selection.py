"""Selections: which instances of a map are meant, by what is known of them."""

from __future__ import annotations

from sqlalchemy import (
    ColumnElement,
    Connection,
    Double,
    FromClause,
    Select,
    String,
    and_,
    cast,
    func,
    literal,
    or_,
    select,
    text,
)
from sqlalchemy.dialects.postgresql import JSONB

from semap.cql2 import Call, Expression, Literal, check, parse, parts
from semap.errors import InvalidInput
from semap.model.selection import Selection, Source
from semap.store.database.connection import translated
from semap.store.database.cql2_sql import Thing, condition
from semap.store.database.tables import abstraction, concept, instance, one_of

STOREY = instance.alias("storey_instance")
FOOTPRINT = abstraction.alias("footprint")
POSITION = abstraction.alias("position")

EVERYTHING = Selection()


def selected_ids(
    connection: Connection, map_id: int, selection: Selection, place: str = ""
) -> tuple[int, ...]:
    """The ids of the instances of a map that are meant, in their order.

    place   how messages call the selection
    raises  InvalidInput for an unknown concept or a filter that cannot be read, with the place
    """
    statement = selected(map_id, selection, place)
    with translated():
        _require_concepts(connection, selection, place)
        return tuple(connection.scalars(statement.order_by(instance.c.instance_id)))


def selected(map_id: int, selection: Selection, place: str = "") -> Select[tuple[int]]:
    """The statement that gives the ids of the instances that are meant.

    raises  InvalidInput for a filter that cannot be read, with the place
    """
    wanted: list[ColumnElement[bool]] = [instance.c.map_id == map_id]
    if selection.ids is not None:
        wanted.append(one_of(instance.c.instance_id, selection.ids))
    if selection.names is not None:
        wanted.append(
            or_(one_of(instance.c.name, selection.names), one_of(instance.c.alias, selection.names))
        )
    if selection.concept is not None:
        wanted.append(_is_a(selection.concept))
    if selection.attributes is not None:
        wanted.append(instance.c.attributes.op("@>")(cast(literal(dict(selection.attributes), JSONB), JSONB)))
    if selection.filter is None:
        return select(instance.c.instance_id).where(*wanted)
    return (
        select(instance.c.instance_id)
        .select_from(_WITH_ALL)
        .where(*wanted, condition(_filter(selection.filter, place), INSTANCE))
    )


def _filter(source: Source, place: str) -> Expression:
    expression = parse(source, _within(place, "filter"))
    check(expression, INSTANCE.kinds)
    return expression


def _require_concepts(connection: Connection, selection: Selection, place: str) -> None:
    """A misspelt concept is not an empty one."""
    named = [(selection.concept, _within(place, "concept"))] if selection.concept is not None else []
    if selection.filter is not None:
        for part in parts(parse(selection.filter, _within(place, "filter"))):
            match part:
                case Call(op="isA", args=(Literal(value=str(name), place=where),)):
                    named.append((name, where))
    for name, where in named:
        if connection.scalar(select(func.semap.concept_named(name))) is None:
            raise InvalidInput(
                f"there is no concept {name}", "List the concepts to see their names and IRIs.", where
            )


def _within(place: str, part: str) -> str:
    return f"{place}.{part}" if place else part


def _is_a(name: str) -> ColumnElement[bool]:
    below = func.semap.concepts_below(func.semap.concept_named(name)).column_valued("concept_id")
    return instance.c.concept_id.in_(select(below))


def with_shapes(rows: FromClause) -> FromClause:
    """Instances with their storey, footprint and position beside them.

    absolute_description_id is unique: what a filter does not ask for is not joined, and what it asks for
    is found by the partial indexes on absolute abstractions.
    """
    rows = rows.outerjoin(STOREY, STOREY.c.instance_id == instance.c.storey_id)
    for shape, kind in ((FOOTPRINT, "Footprint"), (POSITION, "Position2D")):
        rows = rows.outerjoin(
            shape,
            and_(
                shape.c.description_id == instance.c.absolute_description_id,
                shape.c.type == text(f"'{kind}'"),
                shape.c.instance_id.is_not(None),
            ),
        )
    return rows


_WITH_ALL = with_shapes(instance.join(concept, concept.c.concept_id == instance.c.concept_id))

INSTANCE = Thing(
    kinds={
        "name": "text",
        "alias": "text",
        "concept": "text",
        "uid": "text",
        "id": "number",
        "storey": "text",
        "created_at": "instant",
        "updated_at": "instant",
        "footprint": "shape",
        "position": "shape",
        "attributes": "any",
    },
    columns={
        "name": instance.c.name,
        "alias": instance.c.alias,
        "concept": concept.c.name,
        "uid": cast(instance.c.uid, String),
        "id": cast(instance.c.instance_id, Double),
        "storey": STOREY.c.name,
        "created_at": instance.c.created_at,
        "updated_at": instance.c.updated_at,
        "footprint": FOOTPRINT.c.geometry,
        "position": POSITION.c.geometry,
        "attributes": instance.c.attributes,
    },
    is_a=_is_a,
)
"""What a filter may ask of an instance; shapes are as seen from above, in the map frame."""
