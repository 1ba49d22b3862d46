"""/changes and /maps/{name}/changes: who changed what, and undo"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from pydantic import Field
from sqlalchemy import Connection

from semap.store import history
from semap_service.database.transaction import Database, Write, transaction
from semap_service.documents.document import LARGEST_ID, Document, Id, Limit, Stamp
from semap_service.http.etag import TaggedRoute, reads
from semap_service.http.problem import problems

router = APIRouter(tags=["history"], route_class=TaggedRoute)


class ChangeSummary(Document):
    """What one request, import or edit changed, as a whole."""

    id: int
    made_at: Stamp
    author: str = Field(description="Semap-Author of the request, or its address.", examples=["ann"])
    message: str | None = Field(description="Semap-Message of the request.")
    undoes: int | None = Field(description="The change that it took back.")
    rows: int = Field(description="How many rows of the map it changed.")


class ChangeList(Document):
    changes: list[ChangeSummary] = Field(description="The newest first.")
    next: int | None = Field(description="`before` of the next page; null where this is the last one.")


class RowChangeDocument(Document):
    """A row that was made, changed or deleted."""

    table: str = Field(description="The kind of row.", examples=["instance"])
    name: str = Field(description="Its name, or its key where it has none.", examples=["Room07"])
    action: Literal["made", "changed", "deleted"]


class ChangeDocument(ChangeSummary):
    """A change with what it did."""

    changed: list[RowChangeDocument] = Field(description="In order; at most 1000.")


@router.get("/maps/{name}/changes", operation_id="list_changes", responses=reads(404))
def list_changes(
    database: Database,
    name: str,
    limit: Limit = 100,
    before: Annotated[int | None, Query(ge=1, le=LARGEST_ID, description="Only before this change.")] = None,
) -> ChangeList:
    """Who changed a map and when, the newest change first."""
    with transaction(database) as connection:
        found = history.list_change_sets(connection, name, before=before, limit=limit)
    return ChangeList(
        changes=[ChangeSummary(**_summary(each)) for each in found],
        next=found[-1].change_set_id if len(found) == limit else None,
    )


@router.get("/changes/{id}", operation_id="get_change", responses=reads(404))
def get_change(database: Database, id: Id) -> ChangeDocument:  # noqa: A002
    """A change with what it did, row by row."""
    with transaction(database) as connection:
        return _read(connection, id)


@router.post("/changes/{id}/undo", operation_id="undo_change", status_code=201, responses=problems(404, 409))
def undo_change(write: Write, id: Id, response: Response) -> ChangeDocument:  # noqa: A002
    """Take a change back, whole, by a change that can be undone in turn.

    Refused where something of it was changed since: undo the later change first.
    """
    with write.begin() as connection:
        made = history.undo(connection, id)
        document = _read(connection, made.change_set_id)
    response.headers["Location"] = f"/changes/{made.change_set_id}"
    return document


def _read(connection: Connection, change_set_id: int) -> ChangeDocument:
    found = history.get_change_set(connection, change_set_id)
    rows = history.rows_of(connection, change_set_id)
    return ChangeDocument(
        **_summary(found), changed=[RowChangeDocument.model_validate(each) for each in rows]
    )


def _summary(found: history.ChangeSet) -> dict[str, Any]:
    return {
        "id": found.change_set_id,
        "made_at": found.made_at,
        "author": found.author,
        "message": found.message,
        "undoes": found.undoes,
        "rows": found.rows,
    }
