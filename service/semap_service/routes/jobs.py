"""/jobs: imports that run beside the request that brought them"""

from __future__ import annotations

import asyncio
import time
from typing import Annotated

from fastapi import APIRouter, Query
from sqlalchemy import Engine

from semap.store import jobs
from semap_service.context.caller import SYSTEM, acting_as, current_caller
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import LARGEST_SMALL_ID, Limit, SmallId
from semap_service.documents.job import JobDocument, JobList
from semap_service.http.problem import problems

router = APIRouter(tags=["jobs"])

LONGEST_WAIT_S = 60
LOOK_S = 0.25


@router.get("/jobs", operation_id="list_jobs", responses=problems())
def list_jobs(
    database: Database,
    state: Annotated[jobs.State | None, Query(description="Only those in this state.")] = None,
    limit: Limit = 100,
    before: Annotated[
        int | None,
        Query(ge=1, le=LARGEST_SMALL_ID, description="Go on before this id: `next` of the page before."),
    ] = None,
) -> JobList:
    """The caller's jobs, the newest first; an administrator sees those of all."""
    owner = _owner()
    with acting_as(SYSTEM), transaction(database) as connection:
        found = jobs.list_jobs(connection, owner, state=state, before=before, limit=limit)
    return JobList(
        jobs=[JobDocument.model_validate(each) for each in found],
        next=found[-1].job_id if len(found) == limit else None,
    )


@router.get("/jobs/{id}", operation_id="get_job", responses=problems(404))
async def get(
    database: Database,
    id: SmallId,  # noqa: A002
    wait: Annotated[
        float,
        Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="Wait so long for it to go on [s]."),
    ] = 0,
) -> JobDocument:
    """How far a job is; with `wait` as soon as that is something else, or at once where it has ended."""
    deadline_s = time.monotonic() + wait
    owner = _owner()
    first = job = await asyncio.to_thread(_read, database, id, owner)
    while job == first and not job.is_finished and (left_s := deadline_s - time.monotonic()) > 0:
        await asyncio.sleep(min(LOOK_S, left_s))
        job = await asyncio.to_thread(_read, database, id, owner)
    return JobDocument.model_validate(job)


@router.delete("/jobs/{id}", operation_id="cancel_job", responses=problems(404, 409))
def cancel(database: Database, id: SmallId) -> JobDocument:  # noqa: A002
    """Cancel a job. One that runs stops within seconds and brings nothing in, unless it is done first."""
    owner = _owner()
    with acting_as(SYSTEM), transaction(database) as connection:
        return JobDocument.model_validate(jobs.cancel_job(connection, id, owner))


def _read(database: Engine, job_id: int, owner: jobs.Owner) -> jobs.Job:
    with acting_as(SYSTEM), transaction(database) as connection:
        return jobs.get_job(connection, job_id, owner)


def _owner() -> jobs.Owner:
    caller = current_caller()
    return jobs.Owner(caller.token_id, sees_all=caller.may("admin"))
