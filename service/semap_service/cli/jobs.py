"""semap job"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from semap_service.cli.output import print_json, print_rows, say
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from semap.store.operate.jobs import Job

JobId = Annotated[int, typer.Argument(metavar="JOB", min=1, max=2**31 - 1, help="Number of the job.")]


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Imports that the service runs as jobs.")
    app.command("list")(list_)
    app.command("show")(show)
    app.command("cancel")(cancel)
    return app


def list_(
    limit: Annotated[int, typer.Option(min=1, max=1000, help="At most so many, the newest first.")] = 20,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """List jobs, the newest first. Those that ended a week ago are forgotten."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.jobs import Owner, list_jobs  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        found = list_jobs(connection, Owner(None, sees_all=True), limit=limit)
    if as_json:
        print_json([vars(each) for each in found])
        return
    rows = [
        {
            "job": each.job_id,
            "file": each.file,
            "map": each.map,
            "state": each.state,
            "progress": f"{each.progress:.0%}",
            "by": each.created_by,
            "since": each.created_at,
        }
        for each in found
    ]
    print_rows(rows, as_json, "There is no job. Send a file with the header Prefer: respond-async")


def show(job: JobId, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """Say how far a job is, or what came of it."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.jobs import Owner, get_job  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        found = get_job(connection, job, Owner(None, sees_all=True))
    if as_json:
        print_json(vars(found))
        return
    for line in _lines(found):
        say(line)


def cancel(job: JobId, dsn: Dsn = None) -> None:
    """Cancel a job: nothing of its file comes in."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.jobs import Owner, cancel_job  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        found = cancel_job(connection, job, Owner(None, sees_all=True))
    told = "is cancelled" if found.is_finished else "stops within seconds"
    say(f"Job {found.job_id} ({found.file}) {told}.")


def _lines(job: Job) -> list[str]:
    lines = [f"Job {job.job_id}: {job.kind} of {job.file} by {job.created_by}: {job.state}."]
    if not job.is_finished:
        lines.append(f"  {job.progress:.0%} {job.message}")
    if job.problem is not None:
        lines += [f"  {job.problem['detail']}", f"  What to do: {job.problem['remedy']}"]
    if job.result is not None:
        lines += [f"  {key}: {value}" for key, value in job.result.items() if key != "findings"]
        lines += [f"  {e['action']}: {e['subject']}: {e['reason']}" for e in job.result["findings"]]
    return lines
