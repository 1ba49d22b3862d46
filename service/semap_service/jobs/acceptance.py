"""Files that become jobs: `Prefer: respond-async` (RFC 7240, 4.1) is answered before the work is done.

A large file is a job also where its sender waits. To read one keeps a process busy for seconds, in calls that
let no other thread of it go on, so that it is not done in the process that answers everybody.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import Depends, Header, Request, UploadFile
from fastapi.responses import JSONResponse

from semap.errors import TooManyRequests
from semap.store.operate.jobs import Job, Kind, Owner, get_job
from semap_service.context.caller import SYSTEM, acting_as, current_caller
from semap_service.context.request_id import current_request_id
from semap_service.database.shards import Shards
from semap_service.database.transaction import Writing, transaction
from semap_service.documents.job import JobDocument
from semap_service.exchange.file_name import file_name
from semap_service.http.problem import MEDIA_TYPE, problems
from semap_service.jobs.failure import stopped
from semap_service.jobs.runner import MOST_WAITING, JobRunner
from semap_service.jobs.upload_limit import wants_job

READ_AT_ONCE_BYTES = 256 * 1024
LOOK_S = 0.1
ALL = Owner(None, sees_all=True)
"""Whose jobs the service itself may see."""


@dataclass(frozen=True)
class Acceptance:
    """Takes a file on as a job, and answers at once, or when it is done.

    path  that was asked for
    """

    runner: JobRunner
    shards: Shards
    waits: bool
    path: str

    def __call__(
        self,
        kind: Kind,
        upload: UploadFile,
        writing: Writing,
        *,
        map_name: str | None = None,
        if_match: str | None = None,
        options: Mapping[str, object],
    ) -> JSONResponse:
        """raises  InvalidInput for a name without a suffix, TooManyRequests, ServerUnavailable"""
        if self.waits and not self.runner.waiting.acquire(blocking=False):
            raise TooManyRequests(
                f"{MOST_WAITING} large files are waited for already.",
                "Send it with Prefer: respond-async.",
                5,
            )
        try:
            job = self._accepted(kind, upload, writing, map_name, if_match, options)
            return self._done(job) if self.waits else _begun(job)
        finally:
            if self.waits:
                self.runner.waiting.release()

    def _accepted(
        self,
        kind: Kind,
        upload: UploadFile,
        writing: Writing,
        map_name: str | None,
        if_match: str | None,
        options: Mapping[str, object],
    ) -> Job:
        return self.runner.accept(
            kind,
            upload.file,
            given=file_name(upload),
            caller=current_caller(),
            author=writing.author,
            message=writing.message,
            map_name=map_name,
            if_match=if_match,
            options=options,
            shard_dsn=self.shards.dsn_of(writing.engine),
        )

    def _done(self, job: Job) -> JSONResponse:
        """Wait for the end of a job, and answer what the service would have answered by itself."""
        while not job.is_finished:
            time.sleep(LOOK_S)
            with acting_as(SYSTEM), transaction(self.runner.engine) as connection:
                job = get_job(connection, job.job_id, ALL)
        if job.result is None:
            problem = job.problem or stopped(job.job_id)
            told = {**problem, "instance": self.path, "request_id": current_request_id()}
            return JSONResponse(told, problem["status"], media_type=MEDIA_TYPE)
        if job.kind == "mesh_upload":
            return JSONResponse(dict(job.result), HTTPStatus.OK)
        made = quote(str(job.result["map"]), safe="")
        headers = {"Location": f"/maps/{made}"} if job.kind == "map_import" else None
        return JSONResponse(dict(job.result), HTTPStatus.CREATED, headers)


def _begun(job: Job) -> JSONResponse:
    headers = {"Location": f"/jobs/{job.job_id}", "Preference-Applied": "respond-async"}
    return JSONResponse(JobDocument.model_validate(job).model_dump(mode="json"), HTTPStatus.ACCEPTED, headers)


def _acceptance(
    request: Request,
    prefer: Annotated[
        str,
        Header(
            max_length=1000,
            description="`respond-async`: answer 202 at once, with a job to look after, for files that are "
            "large (RFC 7240).",
        ),
    ] = "",
) -> Acceptance | None:
    asked = wants_job(prefer.encode())
    announced = request.headers.get("content-length", "")
    if not asked and announced.isdigit() and int(announced) <= READ_AT_ONCE_BYTES:
        return None
    state = request.app.state
    return Acceptance(state.jobs, state.shards, not asked, request.url.path)


Later = Annotated[Acceptance | None, Depends(_acceptance)]
"""None: the file is small, and read at once."""

Responses = dict[int | str, dict[str, Any]]


def or_later(responses: Responses) -> Responses:
    """The `responses` of an endpoint that may be answered before its work is done."""
    job = {"model": JobDocument, "description": "A job; `Location` is where to look after it."}
    return {**responses, 202: job, 429: problems(429)[429]}
