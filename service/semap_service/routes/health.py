"""GET /health"""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter
from pydantic import Field
from sqlalchemy import text
from starlette.requests import Request

from semap import __version__
from semap.store.database import translated
from semap.store.schema import head_version
from semap_service.document import Document
from semap_service.problem import problems
from semap_service.transaction import Database, transaction

router = APIRouter(tags=["service"])

STATE = text("""
    select (select version_num from semap.schema_version),
           s.active, pg_wal_lsn_diff(pg_current_wal_lsn(), s.confirmed_flush_lsn)
    from (select semap.rule_slot() as name) wanted
    left join pg_replication_slots s on s.slot_name = wanted.name
""")


class WorkerHealth(Document):
    """How far the rule worker is behind the log."""

    running: bool = Field(description="Whether a worker reads the log now.")
    lag_bytes: int = Field(description="How much of the log it has not confirmed.")


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


@router.get("/health", operation_id="get_health", responses=problems())
def get_health(request: Request, database: Database) -> Health:
    """Whether the database answers, and how far the rule worker is."""
    with transaction(database) as connection, translated():
        schema_version, running, lag_bytes = connection.execute(STATE).one()
    worker = None if running is None else WorkerHealth(running=running, lag_bytes=max(0, int(lag_bytes)))
    connected: bool = request.app.state.feed.connected
    fine = schema_version == head_version() and connected and worker is not None and worker.running
    return Health(
        status="ok" if fine else "degraded",
        version=__version__,
        schema_version=schema_version,
        schema_expected=head_version(),
        feed_connected=connected,
        worker=worker,
    )
