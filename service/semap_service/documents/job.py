"""The document of a job."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from semap.store.jobs import Kind, State
from semap_service.documents.document import Document, Next, Stamp
from semap_service.documents.problem import Problem


class JobDocument(Document):
    """An import that runs in the background."""

    job_id: int
    kind: Kind
    map: str | None = Field(description="The map of the import, where it was given.")
    file: str = Field(description="As its sender calls it.", examples=["office.ifc"])
    state: State
    progress: Annotated[float, AfterValidator(lambda part: round(part, 4))] = Field(ge=0, le=1)
    message: str = Field(description="Its current step.", examples=["120 of 300 objects read"])
    result: dict[str, Any] | None = Field(
        description="The response that a waiting request would get; null: it is not done."
    )
    problem: Problem | None = Field(description="The same, of one that failed.")
    created_by: str
    created_at: Stamp
    finished_at: Stamp | None


class JobList(Document):
    jobs: list[JobDocument] = Field(description="The newest first.")
    next: Next = Field(description="`before` of the next page; null where this is the last one.")
