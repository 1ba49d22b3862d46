"""/concepts"""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import Field

from semap.store import concept
from semap_service.document import Document, Name, Request
from semap_service.problem import problems
from semap_service.transaction import Database, transaction

router = APIRouter(tags=["concepts"])


class ConceptDocument(Document):
    """A kind of thing."""

    name: str = Field(examples=["Room"])
    parent: str | None = Field(description="null for the root only.", examples=["Space"])


class ConceptList(Document):
    concepts: list[ConceptDocument] = Field(description="The whole taxonomy, by name.")


class NewConcept(Request):
    """A concept to be made."""

    name: Name = Field(examples=["Kitchen"])
    parent: Name = Field("Thing", examples=["Room"])


@router.get("/concepts", operation_id="list_concepts", responses=problems())
def list_concepts(database: Database) -> ConceptList:
    """The taxonomy: what kinds of things there are, and what they are kinds of."""
    with transaction(database) as connection:
        found = concept.list_concepts(connection)
    return ConceptList(concepts=[ConceptDocument.model_validate(each) for each in found])


@router.post("/concepts", operation_id="create_concept", status_code=201, responses=problems(409))
def create_concept(database: Database, new: NewConcept) -> ConceptDocument:
    """Make a concept below another one. What is asked of a concept holds for those below it."""
    with transaction(database) as connection:
        return ConceptDocument.model_validate(concept.create_concept(connection, new.name, new.parent))
