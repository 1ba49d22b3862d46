"""Jobs: imports that run beside the request that brought them.

A job belongs to the token that brought it. Whoever holds its advisory lock (sql/170_job.sql) lives.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, func, select, text, true, update

from semap.errors import Conflict, NotFound
from semap.store.database.connection import translated
from semap.store.database.tables import job

Kind = Literal["map_import", "instance_import", "mesh_upload"]
State = Literal["waiting", "running", "done", "failed", "cancelled"]

KEPT_DAYS = 7
KEPT_JOBS = 1000

ADD = text("""
    insert into semap.job (job_id, kind, map, file, token_id, created_by) overriding system value
    values (:job_id, :kind, :map, :file, :token_id, :created_by)
""")
CANCEL = text("""
    update semap.job
    set cancel_requested = true,
        state = case state when 'waiting' then 'cancelled' else state end,
        finished_at = case state when 'waiting' then clock_timestamp() end
    where (job_id = :job_id or token_id = :token_id) and finished_at is null
""")
HOLD = text("select semap.hold_job(:job_id)")
LET_GO = text("select pg_advisory_unlock_shared(7369, :job_id)")
FORGET = text("""
    delete from semap.job
    where finished_at < clock_timestamp() - make_interval(days => :days)
       or finished_at is not null and job_id <= (
         select job_id from semap.job where finished_at is not null order by job_id desc offset :jobs limit 1)
""")


@dataclass(frozen=True)
class Job:
    """An import, and how far it is.

    map        that it brings something into, where that is known beforehand
    file       as its sender calls it
    progress   0 to 1
    message    what it is doing
    result     what a synchronous import would have answered; None unless it is done
    problem    the same, of one that failed (RFC 9457)
    """

    job_id: int
    kind: Kind
    map: str | None
    file: str
    state: State
    progress: float
    message: str
    result: Mapping[str, Any] | None
    problem: Mapping[str, Any] | None
    created_by: str
    created_at: datetime
    finished_at: datetime | None

    @property
    def is_finished(self) -> bool:
        return self.finished_at is not None


@dataclass(frozen=True)
class Owner:
    """Whose jobs; of a service without tokens `token_id` is None.

    sees_all  an administrator, who sees those of others too
    """

    token_id: int | None
    sees_all: bool


def hold_job(connection: Connection, job_id: int) -> None:
    """Say that a job lives as long as this session, or until it lets go."""
    with translated():
        connection.execute(HOLD, {"job_id": job_id})


def let_go_of_job(connection: Connection, job_id: int) -> None:
    """Hold a job no longer."""
    with translated():
        connection.execute(LET_GO, {"job_id": job_id})


def next_job_id(connection: Connection) -> int:
    """A number that is nobody else's, so that its lock can be held before anybody sees the job."""
    sequence = func.pg_get_serial_sequence("semap.job", "job_id")
    with translated():
        return int(connection.scalar(select(func.nextval(sequence))) or 0)


def add_job(
    connection: Connection,
    job_id: int,
    kind: Kind,
    *,
    file: str,
    map_name: str | None,
    token_id: int | None,
    created_by: str,
) -> Job:
    """A job that waits."""
    with translated():
        connection.execute(
            ADD,
            {
                "job_id": job_id,
                "kind": kind,
                "map": map_name,
                "file": file,
                "token_id": token_id,
                "created_by": created_by,
            },
        )
    return get_job(connection, job_id, Owner(None, sees_all=True))


def count_unfinished(connection: Connection) -> int:
    with translated():
        return int(
            connection.scalar(select(func.count()).select_from(job).where(job.c.finished_at.is_(None))) or 0
        )


def list_jobs(
    connection: Connection,
    owner: Owner,
    *,
    state: State | None = None,
    before: int | None = None,
    limit: int = 100,
) -> tuple[Job, ...]:
    """The newest first, from the first with a number below `before`."""
    found = _JOBS.where(_seen_by(owner)).order_by(job.c.job_id.desc()).limit(limit)
    if state is not None:
        found = found.where(job.c.state == state)
    if before is not None:
        found = found.where(job.c.job_id < before)
    with translated():
        return tuple(_job(row) for row in connection.execute(found))


def get_job(connection: Connection, job_id: int, owner: Owner) -> Job:
    """raises NotFound, also for a job of somebody else"""
    with translated():
        row = connection.execute(_JOBS.where(job.c.job_id == job_id, _seen_by(owner))).one_or_none()
    if row is None:
        raise NotFound("job", job_id, "List the jobs; those that ended a week ago are forgotten.")
    return _job(row)


def cancel_job(connection: Connection, job_id: int, owner: Owner) -> Job:
    """Cancel a job that waits, or ask the one who runs it to stop.

    raises  NotFound, Conflict if it has ended
    """
    get_job(connection, job_id, owner)
    with translated():
        asked = connection.execute(CANCEL, {"job_id": job_id, "token_id": None})
    found = get_job(connection, job_id, owner)
    if asked.rowcount == 0:
        raise Conflict(f"The job {job_id} has ended: {found.state}.", "There is nothing left to cancel.")
    return found


def cancel_jobs_of(connection: Connection, token_id: int) -> None:
    """Cancel all jobs of a token that have not ended."""
    with translated():
        connection.execute(CANCEL, {"job_id": None, "token_id": token_id})


def start_job(connection: Connection, job_id: int) -> bool:
    """Let a waiting job run; whether it still waits."""
    with translated():
        started = connection.execute(
            update(job).where(job.c.job_id == job_id, job.c.state == "waiting").values(state="running")
        )
    return started.rowcount == 1


def fail_job(connection: Connection, job_id: int, problem: Mapping[str, Any]) -> None:
    """End a job that has not ended."""
    _end(connection, job_id, state="failed", problem=dict(problem))


def stop_job(connection: Connection, job_id: int) -> None:
    """End a job that has not ended, as cancelled."""
    _end(connection, job_id, state="cancelled")


def fail_lost_jobs(connection: Connection) -> int:
    """Mark those whose process is gone; returns how many."""
    with translated():
        return int(connection.scalar(select(func.semap.fail_lost_jobs())) or 0)


def forget_jobs(connection: Connection) -> None:
    """Delete what ended long ago, and the oldest where there are many."""
    with translated():
        connection.execute(FORGET, {"days": KEPT_DAYS, "jobs": KEPT_JOBS})


def report(connection: Connection, job_id: int, progress: float, message: str) -> bool:
    """Say how far a running job is; whether it is to stop."""
    with translated():
        asked = connection.scalar(
            update(job)
            .where(job.c.job_id == job_id, job.c.state == "running")
            .values(progress=progress, message=message)
            .returning(job.c.cancel_requested)
        )
    return asked is not False


def finish_job(connection: Connection, job_id: int, result: Mapping[str, Any]) -> None:
    """Say in the transaction of an import that its job is done."""
    with translated():
        connection.execute(
            text("select semap.finish_job(:job_id, cast(:result as jsonb))"),
            {"job_id": job_id, "result": json.dumps(result)},
        )


def _end(connection: Connection, job_id: int, **values: object) -> None:
    with translated():
        connection.execute(
            update(job)
            .where(job.c.job_id == job_id, job.c.finished_at.is_(None))
            .values(message="", finished_at=func.clock_timestamp(), **values)
        )


def _seen_by(owner: Owner) -> ColumnElement[bool]:
    return true() if owner.sees_all else job.c.token_id == owner.token_id


def _job(row: Sequence[Any]) -> Job:
    return Job(*row)


_JOBS = select(
    job.c.job_id,
    job.c.kind,
    job.c.map,
    job.c.file,
    job.c.state,
    job.c.progress,
    job.c.message,
    job.c.result,
    job.c.problem,
    job.c.created_by,
    job.c.created_at,
    job.c.finished_at,
)
