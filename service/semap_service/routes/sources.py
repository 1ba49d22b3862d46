"""/sources"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter
from pydantic import Field, model_validator
from sqlalchemy import Connection

from semap.store import sources
from semap.store.maps import get_map
from semap_service.database.transaction import Database, Edit, transaction
from semap_service.documents.document import (
    After,
    Document,
    Limit,
    MapFilter,
    Next,
    Request,
    SmallId,
    next_after,
    stored,
)
from semap_service.http.etag import TaggedRoute, edits, reads

router = APIRouter(tags=["sources"], route_class=TaggedRoute)

LATENESS = "How long rules wait for rows of it that come after others of later stamps [s]."
JUMP = (
    "A position further from the last one than this, and `jump_mps` for the time between added to it, is set"
    " aside until the next one agrees with it. null: every position is taken."
)


class SourceChanges(Request):
    """The changes; omitted members stay unchanged."""

    lateness_s: Annotated[float, Field(ge=0, le=sources.LONGEST_LATENESS_S)] | None = Field(
        None, description=LATENESS
    )
    jump_m: Annotated[float, Field(gt=0, le=sources.FARTHEST_M)] | None = Field(None, description=JUMP)
    jump_mps: Annotated[float, Field(ge=0, le=sources.FASTEST_MPS)] | None = None

    @model_validator(mode="after")
    def _some_are_never_null(self) -> SourceChanges:
        for name in ("lateness_s", "jump_mps"):
            if name in self.model_fields_set and getattr(self, name) is None:
                raise ValueError(f"{name} cannot be null; leave it out to keep it")
        return self


class SourceDocument(Document):
    """A source of states of tracks or objects, with its settings."""

    id: int = stored("source_id")
    map: str = Field(examples=["office"])
    name: str = Field(examples=["lidar"])
    lateness_s: float = stored("settings", "lateness_s", description=LATENESS)
    jump_m: float | None = stored("settings", "jump_m", description=JUMP)
    jump_mps: float = stored("settings", "jump_mps")
    late_states: int = Field(description="States that came after later ones of their track.")
    outliers: int = Field(description="Positions that were set aside, and that no other agreed with.")


class SourceList(Document):
    sources: list[SourceDocument] = Field(description="In the order of their ids.")
    next: Next


@router.get("/sources", operation_id="list_sources", responses=reads(404))
def list_sources(
    database: Database, map_name: MapFilter = None, limit: Limit = 100, after: After = 0
) -> SourceList:
    """The sources."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = sources.list_sources(connection, map_name=map_name, after=after, limit=limit)
    return SourceList(
        sources=[SourceDocument.model_validate(each) for each in found],
        next=next_after([each.source_id for each in found], limit),
    )


@router.get("/sources/{id}", operation_id="get_source", responses=reads(404))
def get_source(database: Database, id: SmallId) -> SourceDocument:  # noqa: A002
    """A source."""
    with transaction(database) as connection:
        return _read(connection, id)


@router.patch("/sources/{id}", operation_id="change_source", responses=edits(404))
def change_source(edit: Edit, id: SmallId, changes: SourceChanges) -> SourceDocument:  # noqa: A002
    """Believe a source further, or less, from its next states on."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        known = sources.get_source(connection, id)
        settings = replace(known.settings, **changes.model_dump(exclude_unset=True))
        return SourceDocument.model_validate(sources.change_source(connection, id, settings))


def _read(connection: Connection, source_id: int) -> SourceDocument:
    return SourceDocument.model_validate(sources.get_source(connection, source_id))
