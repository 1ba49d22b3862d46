"""/queries"""

from __future__ import annotations

from fastapi import APIRouter, Response
from pydantic import Field
from sqlalchemy import Connection

from semap.store import queries
from semap.store.maps import get_map
from semap_service.document import (
    After,
    Document,
    Limit,
    MapFilter,
    Name,
    Next,
    Request,
    SmallId,
    next_after,
)
from semap_service.etag import TaggedRoute, edits, reads
from semap_service.problem import problems
from semap_service.transaction import Database, Edit, Write, transaction

router = APIRouter(tags=["queries"], route_class=TaggedRoute)


class QueryDocument(Document):
    """A continuous query: each track is related to every instance of the concept that contains it."""

    id: int
    map: str = Field(examples=["office"])
    name: str = Field(examples=["track_in_room"])
    predicate: str = Field(examples=["contains"])
    concept: str = Field(examples=["Room"])
    enabled: bool


class QueryList(Document):
    queries: list[QueryDocument] = Field(description="In the order of their ids.")
    next: Next


class NewQuery(Request):
    """A continuous query to be kept from now on."""

    map: Name = Field(examples=["office"])
    name: Name = Field(examples=["track_at_door"])
    concept: Name = Field(examples=["Door"], description="This concept and those below it.")


class QueryChanges(Request):
    enabled: bool = Field(description="false ends all its relations; true keeps them again.")


@router.get("/queries", operation_id="list_queries", responses=reads(404))
def list_queries(
    database: Database, map_name: MapFilter = None, limit: Limit = 100, after: After = 0
) -> QueryList:
    """Continuous queries: which relations are kept."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = queries.list_queries(connection, map_name=map_name, after=after, limit=limit)
    return QueryList(
        queries=[_document(each) for each in found], next=next_after([each.query_id for each in found], limit)
    )


@router.post("/queries", operation_id="add_query", status_code=201, responses=problems(404, 409))
def add_query(write: Write, new: NewQuery, response: Response) -> QueryDocument:
    """Keep relations to another kind of thing. Those that hold now hold with the answer."""
    with write.begin() as connection:
        made = queries.add_query(connection, new.map, new.name, new.concept)
    response.headers["Location"] = f"/queries/{made.query_id}"
    return _document(made)


@router.get("/queries/{id}", operation_id="get_query", responses=reads(404))
def get_query(database: Database, id: SmallId) -> QueryDocument:  # noqa: A002
    """A continuous query."""
    with transaction(database) as connection:
        return _read(connection, id)


@router.patch("/queries/{id}", operation_id="change_query", responses=edits(404))
def change_query(edit: Edit, id: SmallId, changes: QueryChanges) -> QueryDocument:  # noqa: A002
    """Let a query rest, or work again."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        return _document(queries.enable_query(connection, id, changes.enabled))


@router.delete("/queries/{id}", operation_id="delete_query", status_code=204, responses=edits(404, 409))
def delete_query(edit: Edit, id: SmallId) -> None:  # noqa: A002
    """Delete a query; its relations end. One that a rule reads is refused."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        queries.delete_query(connection, id)


def _read(connection: Connection, query_id: int) -> QueryDocument:
    return _document(queries.get_query(connection, query_id))


def _document(query: queries.Query) -> QueryDocument:
    return QueryDocument(
        id=query.query_id,
        map=query.map,
        name=query.name,
        predicate=query.predicate,
        concept=query.concept,
        enabled=query.enabled,
    )
