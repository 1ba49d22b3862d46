"""Maps: made, brought in as files, taken out again; and the jobs that long imports are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from http import HTTPStatus
from pathlib import Path
from typing import Any, Literal

from semap.client.exchange import Plan, Request, Upload, ask, get, given, pages, read, segment
from semap.client.problem import error_of_document
from semap.client.table import Table
from semap.client.values import ImportReport, Job, Map
from semap.errors import Conflict, InvalidInput

Progress = Callable[[Job], None]
ExportFormat = Literal["yaml", "glb", "geojson"]

LONGEST_POLL_S = 10


def health() -> Plan[Mapping[str, Any]]:
    """Whether the service and its database answer."""
    return (yield from get(dict, "/health"))


def list_maps(*, limit: int | None = None) -> Plan[Table[Map]]:
    """All maps that may be seen, by name."""
    return Table(Map, (yield from pages(Map, "/maps", "maps", limit)))


def get_map(name: str) -> Plan[Map]:
    """A map with how much is on it. raises NotFound"""
    return (yield from get(Map, _map(name)))


def create_map(name: str) -> Plan[Map]:
    """Make an empty map. raises Conflict where there is one"""
    return (yield from ask(Request("POST", "/maps", body={"name": name}))).read(Map)


def delete_map(name: str) -> Plan[None]:
    """Delete a map with all that is on it and all that happened on it. raises NotFound"""
    yield from ask(Request("DELETE", _map(name)))


def import_map(
    file: Path | str, name: str | None = None, *, progress: Progress | None = None
) -> Plan[ImportReport]:
    """Bring in a map or a building (.yaml, .zip, .geojson, .ifc, .gml), all of it or nothing.

    name      of the map [default: what the file says, or its name]
    progress  called with the job, each time it has come further
    raises    InvalidInput for a file that semap cannot read, Conflict where the map is there already
    """
    path = _readable(file)
    request = Request(
        "POST",
        "/maps/import",
        given({"name": name}),
        files={"file": Upload(path.name, path)},
        headers={"Prefer": "respond-async"},
    )
    answer = yield from ask(request)
    if answer.status != HTTPStatus.ACCEPTED:
        return answer.read(ImportReport)
    job = yield from wait_for(answer.read(Job), progress)
    return read(ImportReport, job.result)


def export_map(name: str, format: ExportFormat = "yaml") -> Plan[bytes]:  # noqa: A002
    """The whole map as a file: a .zip of the YAML map with its meshes, a .glb, or GeoJSON in metres."""
    answer = yield from ask(Request("GET", f"{_map(name)}/export", {"format": format}))
    return answer.content


def list_jobs(*, limit: int | None = None) -> Plan[Table[Job]]:
    """The jobs that may be seen."""
    return Table(Job, (yield from pages(Job, "/jobs", "jobs", limit)))


def get_job(job_id: object) -> Plan[Job]:
    """How far a job has come. raises NotFound"""
    return (yield from get(Job, f"/jobs/{segment(job_id)}"))


def cancel_job(job_id: object) -> Plan[None]:
    """End a job; what it did is undone. raises NotFound"""
    yield from ask(Request("DELETE", f"/jobs/{segment(job_id)}"))


def wait_for(job: Job, progress: Progress | None = None) -> Plan[Job]:
    """A job once it is done.

    raises  what its problem stands for where it failed, Conflict where it was cancelled
    """
    while not job.is_over:
        if progress is not None:
            progress(job)
        path = f"/jobs/{segment(job.job_id)}"
        job = (yield from ask(Request("GET", path, {"wait": LONGEST_POLL_S}))).read(Job)
    if progress is not None:
        progress(job)
    if job.state == "cancelled":
        raise Conflict("The job was cancelled.", "Send the file again.")
    if job.state == "failed":
        problem = job.problem or {}
        raise error_of_document(int(problem.get("status", HTTPStatus.UNPROCESSABLE_ENTITY)), {}, problem)
    return job


def _map(name: str) -> str:
    return f"/maps/{segment(name)}"


def _readable(file: Path | str) -> Path:
    path = Path(file)
    if not path.is_file():
        raise InvalidInput(f"{path} is no file that can be read", "Check the path.")
    return path
