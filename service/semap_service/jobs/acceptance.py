"""Requests that may be answered before their work is done: `Prefer: respond-async` (RFC 7240, 4.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import Depends, Header, Request, UploadFile
from fastapi.responses import JSONResponse

from semap.store.jobs import Kind
from semap_service.access.caller import current_caller
from semap_service.file_name import file_name
from semap_service.jobs.body_limit import wants_job
from semap_service.jobs.runner import JobRunner
from semap_service.problem import problems
from semap_service.routes.job_document import JobDocument, job_document
from semap_service.transaction import Writing


@dataclass(frozen=True)
class Acceptance:
    """Takes a file on as a job, and answers at once."""

    runner: JobRunner

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
        job = self.runner.accept(
            kind,
            upload.file,
            given=file_name(upload),
            caller=current_caller(),
            author=writing.author,
            message=writing.message,
            map_name=map_name,
            if_match=if_match,
            options=options,
        )
        headers = {"Location": f"/jobs/{job.job_id}", "Preference-Applied": "respond-async"}
        return JSONResponse(job_document(job).model_dump(mode="json"), 202, headers)


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
    return Acceptance(request.app.state.jobs) if wants_job(prefer.encode()) else None


Later = Annotated[Acceptance | None, Depends(_acceptance)]
"""None: the caller waits until it is done."""

Responses = dict[int | str, dict[str, Any]]


def or_later(responses: Responses) -> Responses:
    """The `responses` of an endpoint that may be answered before its work is done."""
    job = {"model": JobDocument, "description": "A job; `Location` is where to look after it."}
    return {**responses, 202: job, 429: problems(429)[429]}
