"""The taxonomy: what kinds of things there are. Every concept lies below Thing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from sqlalchemy import Connection, select
from sqlalchemy.dialects.postgresql import insert

from semap.errors import Conflict, InvalidInput
from semap.store.database import translated
from semap.store.tables import concept, one_of

ROOT = "Thing"


@dataclass(frozen=True)
class Concept:
    """A kind of thing; `parent` is None for the root only."""

    concept_id: int
    name: str
    parent: str | None


def list_concepts(connection: Connection) -> tuple[Concept, ...]:
    """All concepts by name."""
    above = concept.alias()
    with translated():
        rows = connection.execute(
            select(concept.c.concept_id, concept.c.name, above.c.name)
            .outerjoin(above, above.c.concept_id == concept.c.parent_id)
            .order_by(concept.c.name)
        )
        return tuple(Concept(*row) for row in rows)


def concept_id(connection: Connection, name: str) -> int:
    """The id of a concept.

    raises  InvalidInput if there is none
    """
    with translated():
        found = connection.scalar(select(concept.c.concept_id).where(concept.c.name == name))
    if found is None:
        raise InvalidInput(f"there is no concept {name}", "Create it first, or name another.", "concept")
    return int(found)


def create_concept(connection: Connection, name: str, parent: str = ROOT) -> Concept:
    """A new concept below `parent`.

    raises  InvalidInput if there is no such parent, Conflict if the concept exists
    """
    parent_id = concept_id(connection, parent)
    with translated():
        made = connection.scalar(
            insert(concept)
            .values(name=name, parent_id=parent_id)
            .on_conflict_do_nothing(index_elements=["name"])
            .returning(concept.c.concept_id)
        )
    if made is None:
        raise Conflict(f"There is a concept {name} already.", "Choose another name.")
    return Concept(int(made), name, parent)


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
                    .values([{"name": name, "parent_id": root_id} for name in missing])
                    .on_conflict_do_nothing(index_elements=["name"])
                    .returning(concept.c.name)
                )
            )
            known = _ids(connection, wanted)
    return known, tuple(made)


def _ids(connection: Connection, names: list[str]) -> dict[str, int]:
    rows = connection.execute(
        select(concept.c.name, concept.c.concept_id).where(one_of(concept.c.name, names))
    )
    return dict(rows.all())
