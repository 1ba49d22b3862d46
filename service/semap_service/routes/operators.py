"""/operators, and operators run on a map"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field

from semap.model.selection import Selection
from semap.store.map.operator_table import OPERATORS, Operator
from semap.store.map.operators import run_operator
from semap_service.database.transaction import Write, on_whole_map
from semap_service.documents.document import LARGEST_ID, Document, Name, Request
from semap_service.http.problem import problems

router = APIRouter(tags=["operators"])

MOST = 10_000
"""So many ids or names a selection may list."""


class ParameterDocument(Document):
    """A parameter of an operator."""

    name: str = Field(examples=["strict"])
    kind: str = Field(
        description="number, integer, text, boolean, texts, attributes (JSON object), area (GeoJSON "
        "polygon), point (GeoJSON point), pose, stamp (RFC 3339); instance, frame, description: a name or id."
    )
    answers: str = Field(description="Its meaning.")
    required: bool
    default: Any = Field(description="null: none.")
    choices: list[str] = Field(description="One of these; empty: any.")


class OperatorDocument(Document):
    """An operator with its parameters and columns."""

    name: str = Field(examples=["in_objects"])
    answers: str = Field(examples=["What is in the references: completely within, or with some of it."])
    function: str = Field(description="The SQL function.", examples=["semap.in_objects"])
    takes_references: bool
    takes_targets: bool
    edits: bool = Field(description="Whether it changes the map.")
    parameters: list[ParameterDocument]
    columns: list[str] = Field(description="The meaning of a row.")
    replaces: list[str] = Field(description="Services of SEMAP in whose place it stands.")


class OperatorList(Document):
    operators: list[OperatorDocument] = Field(description="All of them.")


class SelectionDocument(Request):
    """Instances of the map that meet all that is given."""

    ids: Annotated[list[Annotated[int, Field(ge=1, le=LARGEST_ID)]], Field(max_length=MOST)] | None = None
    names: Annotated[list[Name], Field(max_length=MOST)] | None = Field(None, description="Names or aliases.")
    concept: Name | None = Field(
        None, description="This concept, by name or IRI, or one below it.", examples=["Room"]
    )
    attributes: dict[str, Any] | None = Field(
        None, description="Attributes that they have, with these values."
    )
    filter: str | dict[str, Any] | None = Field(
        None,
        description="CQL2, as text or JSON, over name, alias, concept, uid, id, storey, created_at, "
        "updated_at, footprint, position, attributes.<key> and isA('Concept').",
        examples=["isA('Room') AND attributes.seats > 4 AND s_intersects(footprint, BBOX(0, 0, 10, 10))"],
    )

    def selection(self) -> Selection:
        return Selection(
            None if self.ids is None else tuple(self.ids),
            None if self.names is None else tuple(self.names),
            self.concept,
            self.attributes,
            self.filter,
        )


class Question(Request):
    """What an operator is asked."""

    references: SelectionDocument | None = Field(
        None, description="The references; by default all instances of the map."
    )
    targets: SelectionDocument | None = Field(
        None, description="The targets; by default all instances of the map."
    )
    parameters: dict[str, Any] = Field({}, description="By name; GET /operators lists them.")
    limit: int = Field(100, ge=1, le=1000, description="At most so many rows; one that edits gives all.")
    after: Annotated[str, Field(max_length=200)] | None = Field(
        None, description="Go on after this place: `next` of the page before."
    )


class AnswerDocument(Document):
    """What an operator answers."""

    rows: list[dict[str, Any]] = Field(
        description="By column; an id of an instance is beside its name, geometries are GeoJSON in metres."
    )
    next: str | None = Field(description="`after` of the next page; null where this is the last one.")


@router.get("/operators", operation_id="list_operators", responses=problems())
def list_operators() -> OperatorList:
    """The operators, each one SQL function, with what they take and give."""
    return OperatorList(operators=[_document(each) for each in OPERATORS.values()])


@router.post(
    "/maps/{name}/operators/{operator}", operation_id="run_operator", responses=problems(400, 404, 409)
)
def run(write: Write, name: str, operator: str, question: Question) -> AnswerDocument:
    """Ask an operator about a map: many references to many targets at once."""
    with write.begin() as connection:
        answer = run_operator(
            connection,
            name,
            operator,
            None if question.references is None else question.references.selection(),
            None if question.targets is None else question.targets.selection(),
            question.parameters,
            limit=question.limit,
            after=question.after,
            when_chosen=on_whole_map,
        )
    return AnswerDocument(rows=list(answer.rows), next=answer.after)


def _document(operator: Operator) -> OperatorDocument:
    return OperatorDocument(
        name=operator.name,
        answers=operator.answers,
        function=operator.sql,
        takes_references=operator.references is not None,
        takes_targets=operator.targets is not None,
        edits=operator.edits,
        parameters=[ParameterDocument.model_validate(each) for each in operator.parameters],
        columns=[
            name
            for each in operator.columns
            for name in (
                [each.name, each.name.removesuffix("_id")] if each.gives == "instance" else [each.name]
            )
        ],
        replaces=list(operator.semap),
    )
