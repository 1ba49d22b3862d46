"""GET /health, /ready"""

from __future__ import annotations

from http import HTTPStatus
from typing import Literal

from fastapi import APIRouter, Response
from pydantic import Field
from starlette.requests import Request

from semap import __version__
from semap.store.operate.readiness import lacks, read_state
from semap.store.operate.schema import head_version
from semap_service.context.caller import SYSTEM, acting_as
from semap_service.database.transaction import transaction
from semap_service.documents.document import Document
from semap_service.documents.problem import Place
from semap_service.http.problem import RETRY_S, problem_response, problems

router = APIRouter(tags=["service"])

STATEMENT_S = 2.0


class WorkerHealth(Document):
    """How far the rule worker is behind the log."""

    running: bool = Field(description="Whether a worker reads the log and is at work.")
    lag_bytes: int = Field(description="How much of the log it has not confirmed.")
    silent_s: float | None = Field(
        description="Since its last heartbeat, one each five seconds; null: none yet."
    )


class Health(Document):
    """Whether everything is as it should be."""

    status: Literal["ok", "degraded"] = Field(
        description="degraded: the schema is of another version, the feed is not connected, "
        "or no worker turns changes into events."
    )
    version: str = Field(description="The version of semap.", examples=["0.1.0"])
    schema_version: str = Field(description="The version of the database's schema.", examples=["0005"])
    schema_expected: str = Field(description="The version that this semap knows.", examples=["0005"])
    feed_connected: bool = Field(description="Whether new events are pushed; else they are polled for.")
    worker: WorkerHealth | None = Field(description="null where the worker's replication slot is missing.")


class Ready(Document):
    """The service does its work."""

    status: Literal["ready"]


@router.get("/health", operation_id="get_health", responses=problems())
def get_health(request: Request) -> Health:
    """Whether the database answers, and how far the rule worker is."""
    with acting_as(SYSTEM, statement_s=STATEMENT_S), transaction(request.app.state.watch) as connection:
        state = read_state(connection)
    worker = (
        None
        if state.has_reader is None
        else WorkerHealth(running=state.is_at_work, lag_bytes=state.lag_bytes, silent_s=state.silent_s)
    )
    connected: bool = request.app.state.feed.connected
    fine = state.version == head_version() and connected and worker is not None and worker.running
    return Health(
        status="ok" if fine else "degraded",
        version=__version__,
        schema_version=state.version,
        schema_expected=head_version(),
        feed_connected=connected,
        worker=worker,
    )


@router.get("/ready", operation_id="get_ready", response_model=Ready, responses=problems())
def get_ready(request: Request) -> Ready | Response:
    """Readiness: whether all parts of the service work; else 503, with the missing parts in `errors`.
    The database answers, its schema has this version, new events are pushed, and a rule worker makes them: it
    reads the log, and sent a heartbeat within half a minute. If it did not, the response includes the error
    of the database, if it cannot write.
    """
    with acting_as(SYSTEM, statement_s=STATEMENT_S), transaction(request.app.state.watch) as connection:
        missing = lacks(connection, request.app.state.feed.connected)
    if not missing:
        return Ready(status="ready")
    return problem_response(
        request.url.path,
        HTTPStatus.SERVICE_UNAVAILABLE,
        "; ".join(f"The {what} {why}" for what, why in missing) + ".",
        kind="not-ready",
        remedy="Run semap doctor where the service runs.",
        errors=[Place(where=what, message=why) for what, why in missing],
        headers={"Retry-After": RETRY_S},
    )
