"""/concepts"""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Response
from pydantic import Field, model_validator
from sqlalchemy import Connection

from semap.store import concept
from semap_service.database.transaction import Database, Edit, Write, transaction
from semap_service.documents.document import Document, Name, Request
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems

router = APIRouter(tags=["concepts"], route_class=TaggedRoute)

Parents = Annotated[
    list[Name],
    Field(min_length=1, max_length=50, description="Concepts right above it.", examples=[["Room"]]),
]
Iris = Annotated[
    list[Annotated[str, Field(max_length=2000, pattern=r"^[a-z][a-z0-9+.-]*:[^\x00]*$")]],
    Field(
        max_length=50,
        description="IRIs in other vocabularies: IFC, BOT, Brick.",
        examples=[["https://w3id.org/bot#Space"]],
    ),
]
Comment = Annotated[str, Field(max_length=10_000, pattern=r"^[^\x00]*$")]
AttributeSchema = Annotated[
    dict[str, Any],
    Field(
        description="JSON Schema (2020-12) that attributes of its instances, and of those below, follow.",
        examples=[{"type": "object", "properties": {"seats": {"type": "integer", "minimum": 1}}}],
    ),
]


class ConceptDocument(Document):
    """A class of the taxonomy."""

    name: str = Field(examples=["Room"])
    parents: list[str] = Field(description="Concepts right above it; none for the root only.")
    iris: list[str]
    comment: str | None
    attribute_schema: AttributeSchema | None


class ConceptList(Document):
    concepts: list[ConceptDocument] = Field(description="By name.")
    next: str | None = Field(description="`after` of the next page; null where this is the last one.")


class NewConcept(Request):
    """A concept to be made."""

    name: Annotated[Name, Field(pattern=r"^[^/\x00]*$", description="Without a slash.", examples=["Kitchen"])]
    parents: Parents = Field(default_factory=lambda: [concept.ROOT])
    iris: Iris = Field(default_factory=list)
    comment: Comment | None = None
    attribute_schema: AttributeSchema | None = None


class ConceptChanges(Request):
    """The changes; omitted members stay unchanged."""

    parents: Parents | None = None
    iris: Iris | None = None
    comment: Comment | None = Field(None, description="An empty one removes it.")
    attribute_schema: AttributeSchema | None = Field(None, description="{} allows everything.")

    @model_validator(mode="after")
    def _nothing_is_null(self) -> ConceptChanges:
        for name in self.model_fields_set:
            if getattr(self, name) is None:
                raise ValueError(f"{name} cannot be null; leave it out to keep it")
        return self


@router.get("/concepts", operation_id="list_concepts", responses=reads())
def list_concepts(
    database: Database,
    limit: Annotated[int, Query(ge=1, le=10_000, description="At most so many.")] = 1000,
    after: Annotated[
        str, Query(max_length=200, pattern=r"^[^\x00]*$", description="Go on after this name.")
    ] = "",
) -> ConceptList:
    """The taxonomy: concepts and their parents."""
    with transaction(database) as connection:
        found = concept.list_concepts(connection, after=after, limit=limit)
    return ConceptList(
        concepts=[ConceptDocument.model_validate(each) for each in found],
        next=found[-1].name if len(found) == limit else None,
    )


@router.post("/concepts", operation_id="create_concept", status_code=201, responses=problems(409))
def create_concept(write: Write, new: NewConcept, response: Response) -> ConceptDocument:
    """Make a concept below others. A query for a concept includes those below it."""
    wanted = concept.Concept(
        0, new.name, tuple(new.parents), tuple(new.iris), new.comment, new.attribute_schema
    )
    with write.begin() as connection:
        made = concept.create_concept(connection, wanted)
    response.headers["Location"] = f"/concepts/{quote(made.name, safe='')}"
    return ConceptDocument.model_validate(made)


@router.get("/concepts/{name}", operation_id="get_concept", responses=reads(404))
def get_concept(database: Database, name: str) -> ConceptDocument:
    """A concept, with what is right above it."""
    with transaction(database) as connection:
        return _read(connection, name)


@router.patch("/concepts/{name}", operation_id="change_concept", responses=edits(404, 409))
def change_concept(edit: Edit, name: str, changes: ConceptChanges) -> ConceptDocument:
    """Change a concept. Where it moves in the taxonomy, relations of queries follow."""
    with edit.begin(lambda connection: _read(connection, name)) as connection:
        changed = concept.change_concept(
            connection,
            name,
            parents=changes.parents,
            iris=changes.iris,
            comment=changes.comment,
            attribute_schema=changes.attribute_schema,
        )
    return ConceptDocument.model_validate(changed)


@router.delete("/concepts/{name}", operation_id="delete_concept", status_code=204, responses=edits(404, 409))
def delete_concept(edit: Edit, name: str) -> None:
    """Delete a concept; those below it are below its parents from then on. One that is used is refused."""
    with edit.begin(lambda connection: _read(connection, name)) as connection:
        concept.delete_concept(connection, name)


def _read(connection: Connection, name: str) -> ConceptDocument:
    return ConceptDocument.model_validate(concept.get_concept(connection, name))
