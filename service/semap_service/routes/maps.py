"""/maps"""

from __future__ import annotations

from typing import Annotated
from urllib.parse import quote
from uuid import UUID

from fastapi import APIRouter, Query, Response
from pydantic import Field
from sqlalchemy import Connection

from semap.store.map import maps
from semap_service.database.transaction import Database, Edit, Everywhere, Write, transaction
from semap_service.documents.document import Document, Limit, Name, Request, Stamp
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems

router = APIRouter(tags=["maps"], route_class=TaggedRoute)


class MapDocument(Document):
    """A map with how much is on it."""

    uid: UUID = Field(description="The same for maps of the same name, in any database.")
    name: str = Field(examples=["office"])
    cell_m: float = Field(description="Side of the cells of the region index [m].", examples=[4.0])
    instances: int
    tracks: int
    created_at: Stamp


class MapList(Document):
    maps: list[MapDocument] = Field(description="By name.")
    next: str | None = Field(description="`after` of the next page; null where this is the last one.")


class NewMap(Request):
    """A map to be made."""

    name: Annotated[Name, Field(pattern=r"^[^/\x00]*$", description="Without a slash.", examples=["office"])]
    cell_m: float = Field(4.0, ge=0.1, le=1e6, description="About the size of a room [m].")


@router.get("/maps", operation_id="list_maps", responses=reads())
def list_maps(
    database: Database,
    limit: Limit = 100,
    after: Annotated[
        str, Query(max_length=200, pattern=r"^[^\x00]*$", description="Go on after this name.")
    ] = "",
) -> MapList:
    """All maps, by name."""
    with transaction(database) as connection:
        found = maps.list_maps(connection, after=after, limit=limit)
    return MapList(
        maps=[MapDocument.model_validate(each) for each in found],
        next=found[-1].name if len(found) == limit else None,
    )


@router.post("/maps", operation_id="create_map", status_code=201, responses=problems(409))
def create_map(write: Write, new: NewMap, response: Response) -> MapDocument:
    """Make a map, with its frame `map`, a query for what is in rooms, and a rule that makes events of it."""
    with write.to(new.name, is_new=True).begin() as connection:
        made = maps.create_map(connection, new.name, new.cell_m)
    response.headers["Location"] = f"/maps/{quote(made.name, safe='')}"
    return MapDocument.model_validate(made)


@router.get("/maps/{name}", operation_id="get_map", responses=reads(404))
def get_map(database: Database, name: str) -> MapDocument:
    """A map with how much is on it."""
    with transaction(database) as connection:
        return _read(connection, name)


@router.delete("/maps/{name}", operation_id="delete_map", status_code=204, responses=edits(404))
def delete_map(edit: Edit, shards: Everywhere, name: str) -> None:
    """Delete a map with all that is on it and all that happened on it."""
    with edit.begin(lambda connection: _read(connection, name)) as connection:
        maps.delete_map(connection, name)
    shards.forget(name)


def _read(connection: Connection, name: str) -> MapDocument:
    return MapDocument.model_validate(maps.get_map(connection, name))
