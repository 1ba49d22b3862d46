"""/descriptions and /maps/{name}/descriptions: blueprints, which instances share"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Response
from pydantic import Field
from sqlalchemy import Connection

from semap.model.source_geometry import GeometryType
from semap.store import blueprints
from semap_service.database.transaction import Database, Edit, Write, transaction
from semap_service.documents.document import (
    LARGEST_ID,
    After,
    BandDocument,
    Document,
    Id,
    Limit,
    Name,
    Next,
    PoseDocument,
    Request,
    next_after,
)
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems

router = APIRouter(tags=["descriptions"], route_class=TaggedRoute)


class DescriptionSummary(Document):
    """A description as lists show it."""

    id: int
    map: str = Field(examples=["office"])
    name: str | None = Field(description="null: it belongs to one instance alone.", examples=["chair"])
    instances: int = Field(description="How many look like it.")
    abstractions: list[str] = Field(description="Types of what is derived from its geometries.")


class DescriptionList(Document):
    descriptions: list[DescriptionSummary] = Field(description="Blueprints in the order of their ids.")
    next: Next


class GeometrySummary(Document):
    """A source geometry without its shape."""

    name: str = Field(examples=["Body"])
    type: GeometryType
    pose: PoseDocument = Field(description="description_T_geometry")
    band: BandDocument | None = Field(description="Heights of a POLYGON2D in its own frame.")


class DescriptionDocument(DescriptionSummary):
    """A description with the geometries that it consists of."""

    geometries: list[GeometrySummary] = Field(description="By name.")


class NewDescription(Request):
    """A blueprint to be made; its geometries come after."""

    name: Name = Field(examples=["chair"])


class DescriptionChanges(Request):
    name: Name = Field(description="A description of one instance becomes a blueprint by its name.")


@router.get("/maps/{name}/descriptions", operation_id="list_descriptions", responses=reads(404))
def list_descriptions(database: Database, name: str, limit: Limit = 100, after: After = 0) -> DescriptionList:
    """The blueprints of a map: what instances share that look alike."""
    with transaction(database) as connection:
        found = blueprints.list_blueprints(connection, name, after=after, limit=limit)
    return DescriptionList(
        descriptions=[DescriptionSummary(**_summary(each)) for each in found],
        next=next_after([each.description_id for each in found], limit),
    )


@router.post(
    "/maps/{name}/descriptions",
    operation_id="create_description",
    status_code=201,
    responses=problems(404, 409),
)
def create_description(
    write: Write, name: str, new: NewDescription, response: Response
) -> DescriptionDocument:
    """Make a blueprint without geometries. Put geometries into it, and let instances look like it."""
    with write.begin() as connection:
        made = blueprints.create_blueprint(connection, name, new.name)
        document = read_description(connection, made.description_id)
    response.headers["Location"] = f"/descriptions/{made.description_id}"
    return document


@router.get("/descriptions/{id}", operation_id="get_description", responses=reads(404))
def get_description(database: Database, id: Id) -> DescriptionDocument:  # noqa: A002
    """A description with the types of its geometries and of what is derived from them."""
    with transaction(database) as connection:
        return read_description(connection, id)


@router.patch("/descriptions/{id}", operation_id="change_description", responses=edits(404, 409))
def change_description(edit: Edit, id: Id, changes: DescriptionChanges) -> DescriptionDocument:  # noqa: A002
    """Rename a description."""
    with edit.begin(lambda connection: read_description(connection, id)) as connection:
        blueprints.rename_blueprint(connection, id, changes.name)
        return read_description(connection, id)


@router.delete(
    "/descriptions/{id}", operation_id="delete_description", status_code=204, responses=edits(404, 409)
)
def delete_description(
    edit: Edit,
    id: Id,  # noqa: A002
    replacement: Annotated[
        int | None,
        Query(
            ge=1, le=LARGEST_ID, description="What its instances look like from then on. [default: nothing]"
        ),
    ] = None,
) -> None:
    """Delete a description. Its instances stay and look like the replacement, or like nothing."""
    with edit.begin(lambda connection: read_description(connection, id)) as connection:
        blueprints.delete_blueprint(connection, id, replacement)


def read_description(connection: Connection, description_id: int) -> DescriptionDocument:
    """raises  NotFound"""
    found = blueprints.get_blueprint(connection, description_id)
    heads = blueprints.list_geometries(connection, description_id)
    return DescriptionDocument(
        **_summary(found), geometries=[GeometrySummary.model_validate(each) for each in heads]
    )


def _summary(found: blueprints.Blueprint) -> dict[str, Any]:
    return {
        "id": found.description_id,
        "map": found.map,
        "name": found.name,
        "instances": found.instances,
        "abstractions": list(found.abstractions),
    }
