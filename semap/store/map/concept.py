"""The taxonomy: what kinds of things there are. Every concept lies below Thing."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, delete, func, null, select, text, update
from sqlalchemy.dialects.postgresql import aggregate_order_by, insert

from semap.errors import Conflict, InvalidInput, NotFound
from semap.store.database.connection import translated
from semap.store.database.name import require_name
from semap.store.database.tables import concept, concept_iri, concept_parent, one_of

LIFT_CHILDREN = text("""
    insert into semap.concept_parent (concept_id, parent_id)
    select below.concept_id, above.parent_id
    from semap.concept_parent below join semap.concept_parent above on above.concept_id = below.parent_id
    where below.parent_id = :concept_id
    on conflict do nothing
""")
SCHEMAS_ABOVE = text("""
    select below.name, above.name, above.attribute_schema
    from semap.concept below
    cross join lateral semap.concepts_above(below.concept_id) a (concept_id)
    join semap.concept above on above.concept_id = a.concept_id
    where below.name = any (cast(:names as text[])) and above.attribute_schema is not null
    order by below.name, above.name
""")

ROOT = "Thing"


@dataclass(frozen=True)
class Concept:
    """A kind of thing.

    parents           concepts right above it; none for the root only
    iris              what it is called elsewhere: IFC classes, BOT, Brick
    attribute_schema  JSON Schema of the attributes of its instances and of those of concepts below it
    """

    concept_id: int
    name: str
    parents: tuple[str, ...]
    iris: tuple[str, ...] = ()
    comment: str | None = None
    attribute_schema: Mapping[str, object] | None = None


def list_concepts(
    connection: Connection, *, after: str = "", limit: int | None = None
) -> tuple[Concept, ...]:
    """Concepts by name, from the first name after `after`; all, or at most `limit`."""
    found = _CONCEPTS.where(after < _NAME).order_by(_NAME).limit(limit)
    with translated():
        return tuple(_concept(tuple(row)) for row in connection.execute(found))


def get_concept(connection: Connection, name: str) -> Concept:
    """raises NotFound"""
    with translated():
        row = connection.execute(_CONCEPTS.where(concept.c.name == name)).one_or_none()
    if row is None:
        raise NotFound("concept", name, "List the concepts to see their names.")
    return _concept(tuple(row))


def concept_id(connection: Connection, name: str) -> int:
    """The id of a concept.

    raises  InvalidInput if there is none
    """
    with translated():
        found = connection.scalar(select(concept.c.concept_id).where(concept.c.name == name))
    if found is None:
        raise InvalidInput(f"there is no concept {name}", "Create it first, or name another.", "concept")
    return int(found)


def create_concept(connection: Connection, new: Concept) -> Concept:
    """A new concept below its parents, the root where it names none; its id is ignored.

    raises  InvalidInput if a parent is unknown or the schema is no JSON Schema, Conflict if it exists
    """
    require_name(new.name)
    require_schema(new.attribute_schema)
    parent_ids = [concept_id(connection, parent) for parent in new.parents or (ROOT,)]
    with translated():
        made = connection.scalar(
            insert(concept)
            .values(name=new.name, comment=new.comment, attribute_schema=_json(new.attribute_schema))
            .on_conflict_do_nothing(index_elements=["name"])
            .returning(concept.c.concept_id)
        )
        if made is None:
            raise Conflict(f"There is a concept {new.name} already.", "Choose another name.")
        _write_parents(connection, made, parent_ids)
        _write_iris(connection, made, new.iris)
    return get_concept(connection, new.name)


def change_concept(
    connection: Connection,
    name: str,
    *,
    parents: Sequence[str] | None = None,
    iris: Sequence[str] | None = None,
    comment: str | None = None,
    attribute_schema: Mapping[str, object] | None = None,
) -> Concept:
    """Change what is given, None leaves a thing as it is; regions of queries follow a change of parents.

    raises  NotFound, InvalidInput for an unknown parent, a circle, or a schema that is none
    """
    known = get_concept(connection, name)
    require_schema(attribute_schema)
    with translated():
        if parents is not None:
            parent_ids = [concept_id(connection, parent) for parent in parents]
            _write_parents(connection, known.concept_id, parent_ids)
        if iris is not None:
            _write_iris(connection, known.concept_id, iris)
        values: dict[str, object] = {}
        if comment is not None:
            values["comment"] = comment
        if attribute_schema is not None:
            values["attribute_schema"] = _json(attribute_schema)
        if values:
            connection.execute(
                update(concept).where(concept.c.concept_id == known.concept_id).values(**values)
            )
    return get_concept(connection, name)


def delete_concept(connection: Connection, name: str) -> None:
    """Delete a concept; those below it lie below its parents from then on.

    raises  NotFound, Conflict if there are instances or queries of it, or if it is the root
    """
    known = get_concept(connection, name)
    if not known.parents:
        raise Conflict(f"{name} is the root of the taxonomy.", "Delete a concept below it.")
    with translated():
        connection.execute(LIFT_CHILDREN, {"concept_id": known.concept_id})
        connection.execute(delete(concept).where(concept.c.concept_id == known.concept_id))


def check_attributes(connection: Connection, things: Iterable[tuple[str, str, Mapping[str, object]]]) -> None:
    """See that attributes follow the schemas of their concept and of all concepts above it.

    things  name, concept and attributes of each
    raises  InvalidInput with the place in the first that do not
    """
    given = list(things)
    with translated():
        rows = connection.execute(SCHEMAS_ABOVE, {"names": sorted({kind for _, kind, _ in given})}).all()
    if not rows:
        return
    from jsonschema import Draft202012Validator  # noqa: PLC0415  slow to import, and rarely needed
    from referencing import Registry  # noqa: PLC0415
    from referencing.exceptions import Unresolvable  # noqa: PLC0415

    # An empty registry: a schema never makes the service fetch what another host offers.
    checks: dict[str, list[tuple[str, Any]]] = {}
    for kind, owner, schema in rows:
        checks.setdefault(kind, []).append((owner, Draft202012Validator(schema, registry=Registry())))
    for name, kind, attributes in given:
        for owner, validator in checks.get(kind, ()):
            remedy = f"See the attribute schema of the concept {owner}."
            try:
                wrong = next(
                    validator.iter_errors(json.loads(json.dumps(dict(attributes), default=str))), None
                )
            except Unresolvable as error:
                raise InvalidInput(
                    f"{name}: the schema refers to {error.ref}, which is not in it", remedy, "attributes"
                ) from error
            if wrong is not None:
                place = ".".join(["attributes", *(str(part) for part in wrong.absolute_path)])
                raise InvalidInput(f"{name}: {wrong.message}", remedy, place)


def require_schema(schema: Mapping[str, object] | None) -> None:
    """raises InvalidInput if it is no JSON Schema (draft 2020-12), or has regular expressions

    One expression can keep a whole process busy for years, and nothing here could stop it.
    """
    if schema is None:
        return
    for word in ("pattern", "patternProperties"):
        if _has_keyword(schema, word):
            raise InvalidInput(
                f"a schema with {word}: regular expressions are not evaluated",
                "Say it with enum, const, minLength or maxLength.",
                "attribute_schema",
            )
    from jsonschema import Draft202012Validator, SchemaError  # noqa: PLC0415

    try:
        Draft202012Validator.check_schema(dict(schema))
    except SchemaError as error:
        raise InvalidInput(
            f"no JSON Schema: {error.message}", "See https://json-schema.org.", "attribute_schema"
        ) from error


def _has_keyword(part: object, word: str) -> bool:
    """Whether a schema has a keyword; a property of that name is none."""
    if isinstance(part, Mapping):
        return word in part or any(
            any(_has_keyword(each, word) for each in inner.values())
            if key in ("properties", "$defs", "definitions", "dependentSchemas")
            and isinstance(inner, Mapping)
            else _has_keyword(inner, word)
            for key, inner in part.items()
            if key not in ("enum", "const", "default", "examples")
        )
    return isinstance(part, list) and any(_has_keyword(each, word) for each in part)


def ensure_concepts(connection: Connection, names: Iterable[str]) -> tuple[dict[str, int], tuple[str, ...]]:
    """The id of each concept, and the names that were missing and are now below Thing, sorted."""
    wanted = sorted(set(names))
    root_id = concept_id(connection, ROOT)
    with translated():
        made: list[str] = []
        known = _ids(connection, wanted)
        missing = [name for name in wanted if name not in known]
        if missing:
            made = sorted(
                connection.scalars(
                    insert(concept)
                    .values([{"name": name} for name in missing])
                    .on_conflict_do_nothing(index_elements=["name"])
                    .returning(concept.c.name)
                )
            )
            known = _ids(connection, wanted)
            if made:
                rows = [{"concept_id": known[name], "parent_id": root_id} for name in made]
                connection.execute(insert(concept_parent).values(rows))
    return known, tuple(made)


def _ids(connection: Connection, names: list[str]) -> dict[str, int]:
    rows = connection.execute(
        select(concept.c.name, concept.c.concept_id).where(one_of(concept.c.name, names))
    )
    return dict(rows.all())


def _write_parents(connection: Connection, id_: int, parent_ids: Sequence[int]) -> None:
    others = concept_parent.c.parent_id.not_in(list(parent_ids))
    connection.execute(delete(concept_parent).where(concept_parent.c.concept_id == id_, others))
    if parent_ids:
        rows = [{"concept_id": id_, "parent_id": parent_id} for parent_id in dict.fromkeys(parent_ids)]
        connection.execute(insert(concept_parent).values(rows).on_conflict_do_nothing())


def _write_iris(connection: Connection, id_: int, iris: Sequence[str]) -> None:
    connection.execute(
        delete(concept_iri).where(concept_iri.c.concept_id == id_, concept_iri.c.iri.not_in(list(iris)))
    )
    if iris:
        rows = [{"concept_id": id_, "iri": iri} for iri in dict.fromkeys(iris)]
        connection.execute(insert(concept_iri).values(rows).on_conflict_do_nothing())


def _json(schema: Mapping[str, object] | None) -> object:
    return null() if schema is None else dict(schema)


def _concept(row: Sequence[Any]) -> Concept:
    id_, name, parents, iris, comment, schema = row
    return Concept(id_, name, tuple(parents or ()), tuple(iris or ()), comment, schema)


_NAME = concept.c.name.collate("C")  # so that lists of several databases are in one order
_ABOVE = concept.alias("above")
_CONCEPTS = select(
    concept.c.concept_id,
    concept.c.name,
    select(func.array_agg(aggregate_order_by(_ABOVE.c.name, _ABOVE.c.name)))
    .join(concept_parent, concept_parent.c.parent_id == _ABOVE.c.concept_id)
    .where(concept_parent.c.concept_id == concept.c.concept_id)
    .scalar_subquery(),
    select(func.array_agg(aggregate_order_by(concept_iri.c.iri, concept_iri.c.iri)))
    .where(concept_iri.c.concept_id == concept.c.concept_id)
    .scalar_subquery(),
    concept.c.comment,
    concept.c.attribute_schema,
)
