"""The document of a job."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from semap.store.jobs import Job, Kind, State
from semap_service.document import Document, Next, Stamp
from semap_service.problem import Problem


class JobDocument(Document):
    """An import that runs in the background."""

    job_id: int
    kind: Kind
    map: str | None = Field(description="The map of the import, where it was given.")
    file: str = Field(description="As its sender calls it.", examples=["office.ifc"])
    state: State
    progress: float = Field(ge=0, le=1)
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


def job_document(job: Job) -> JobDocument:
    return JobDocument(
        job_id=job.job_id,
        kind=job.kind,
        map=job.map,
        file=job.file,
        state=job.state,
        progress=round(job.progress, 4),
        message=job.message,
        result=None if job.result is None else dict(job.result),
        problem=None if job.problem is None else Problem.model_validate(job.problem),
        created_by=job.created_by,
        created_at=job.created_at,
        finished_at=job.finished_at,
    )
