"""Why a job failed, as a problem document: what the synchronous request would have answered."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any

from semap.errors import InvalidInput, SemapError
from semap_service.documents.problem import Place, Problem
from semap_service.http.problem import STATUS, TYPE


def problem_of(error: SemapError, job_id: int) -> dict[str, Any]:
    status, kind = next((status, kind) for class_, status, kind in STATUS if isinstance(error, class_))
    where = error.where if isinstance(error, InvalidInput) else ""
    errors = [Place(where=where, message=str(error))] if where else []
    return _problem(job_id, status, kind, str(error), error.remedy, errors)


def out_of_memory(job_id: int) -> dict[str, Any]:
    return _problem(
        job_id,
        HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
        "too-large",
        "The file needs more memory than a job may have.",
        "Split it, or leave out what is not needed.",
    )


def unreadable(job_id: int, error: Exception) -> dict[str, Any]:
    """Of a file that is nested too deeply, or has a number too large, or text that is none."""
    return _problem(
        job_id,
        HTTPStatus.UNPROCESSABLE_ENTITY,
        "invalid-input",
        f"The file cannot be read: {type(error).__name__}.",
        "Give numbers, texts and nesting of a usual size.",
    )


def unexpected(job_id: int) -> dict[str, Any]:
    return _problem(
        job_id,
        HTTPStatus.INTERNAL_SERVER_ERROR,
        "internal",
        "Something went wrong inside semap.",
        "The log of the service has the error; please report it.",
    )


def stopped(job_id: int) -> dict[str, Any]:
    return _problem(
        job_id,
        HTTPStatus.SERVICE_UNAVAILABLE,
        "job-lost",
        "The service was stopped before the job was done; nothing was imported.",
        "Send the file again.",
    )


def died(job_id: int, status: int) -> dict[str, Any]:
    """status  with which the process ended; below zero: the signal that killed it"""
    how = f"was killed by signal {-status}" if status < 0 else f"ended with status {status}"
    return _problem(
        job_id,
        HTTPStatus.INTERNAL_SERVER_ERROR,
        "job-lost",
        f"The job's process {how} before it was done; nothing was imported.",
        "Send the file again; where that does not help it is too large for the memory, or damaged.",
    )


def _problem(
    job_id: int, status: HTTPStatus, kind: str, detail: str, remedy: str, errors: list[Place] | None = None
) -> dict[str, Any]:
    return Problem(
        type=TYPE + kind,
        title=status.phrase,
        status=status,
        detail=detail,
        instance=f"/jobs/{job_id}",
        remedy=remedy,
        errors=errors or [],
        request_id="",
    ).model_dump()
