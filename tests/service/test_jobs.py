"""Imports as jobs: accepted at once, done in a process of their own, or not at all."""

from __future__ import annotations

import io
import json
import os
import signal
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import numpy as np
import psycopg
import pytest
import shapely
from lasting import PATIENCE_S, lasting_service
from patience import until
from running import Service, box_mesh
from semap_service import demo
from semap_service.context.caller import ANYONE
from semap_service.jobs.failure import problem_of
from semap_service.jobs.kinds import KINDS
from semap_service.jobs.runner import JobSettings
from semap_service.jobs.task import Task
from shapely.geometry import mapping

from semap.cluster import Cluster
from semap.errors import SemapError
from semap.store.database.connection import connect, one_transaction
from semap.store.operate.jobs import KEPT_JOBS, fail_lost_jobs, forget_jobs

OFFICE = (Path(demo.__file__).parent / "office.geojson").read_bytes()
ASYNC = {"Prefer": "respond-async"}
ENDED = ("done", "failed", "cancelled")


@pytest.fixture(scope="module")
def spool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("spool")


@pytest.fixture(scope="module")
def lasting(cluster: Cluster, template: str, spool: Path) -> Iterator[Service]:
    settings = JobSettings(folder=spool, at_once=1, unfinished=3, most_bytes=80 * 1024**2)
    with lasting_service(cluster, template, job_settings=settings) as running:
        yield running


@pytest.fixture
def service(lasting: Service) -> Iterator[Service]:
    yield lasting
    for each in lasting.get("/maps")["maps"]:
        lasting.client.delete(f"/maps/{each['name']}").raise_for_status()


def send(
    service: Service, file: str, data: bytes, path: str = "/maps/import", **parameters: object
) -> httpx.Response:
    return service.client.post(path, files={"file": (file, data)}, params=parameters, headers=ASYNC)


def ended(service: Service, sent: httpx.Response) -> dict:
    """The job when it has ended."""
    assert sent.status_code == 202, sent.text
    assert sent.headers["preference-applied"] == "respond-async"
    job = sent.json()
    deadline_s = time.monotonic() + PATIENCE_S
    while job["state"] not in ENDED:
        assert time.monotonic() < deadline_s, job
        job = service.get(sent.headers["location"], wait=20)
    return job


@contextmanager
def held_back(service: Service) -> Iterator[None]:
    """Nobody else changes a map meanwhile: an import waits in the midst of a statement."""
    with psycopg.connect(service.plain.info.dsn) as other:
        other.execute("select semap.lock_regions_exclusive()")
        yield


def is_waiting(service: Service) -> bool:
    """Whether a job's statement waits for the lock of somebody else."""
    return service.plain.execute(
        "select exists (select from pg_stat_activity where application_name like 'semap job % work'"
        " and wait_event_type = 'Lock' and datname = current_database())"
    ).fetchone() == (True,)


def zipped(files: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return stream.getvalue()


def test_an_import_as_a_job_brings_in_what_one_that_waits_does(service: Service, spool: Path) -> None:
    waits = service.client.post("/maps/import", files={"file": ("office.geojson", OFFICE)}).json()
    sent = send(service, "copy.geojson", OFFICE)
    job = ended(service, sent)
    assert (job["state"], job["progress"], job["problem"]) == ("done", 1, None)
    assert job["result"] == {**waits, "map": "copy"}
    assert job["finished_at"] > job["created_at"]

    def footprints(map_name: str) -> dict[str, object]:
        listed = service.get("/maps/" + map_name + "/export", format="geojson")
        return {each["properties"]["name"]: each["geometry"] for each in listed["features"]}

    assert footprints("copy") == footprints("office")
    newest, *_ = service.get("/jobs", state="done")["jobs"]
    assert newest == job
    until(lambda: list(spool.iterdir()) == [])
    (change,) = service.get("/maps/copy/changes")["changes"]
    assert change["author"] == "127.0.0.1"


SAME = ("type", "title", "status", "detail", "remedy", "errors")


@pytest.mark.parametrize(
    ("file", "data"),
    [
        ("a.zip", b"PK nonsense"),
        ("a.zip", zipped({"../map.yaml": b"map: a"})),
        ("office.ifc", OFFICE),
        ("office.ifc", b"ISO-10303-21;\nHEADER;\n" + b" " * 2000),
        ("office.geojson", b""),
        ("office.geojson", b'{"type": "FeatureCollection", "features": [' + b"[" * 100_000),
        ("office.gml", b"<!DOCTYPE x [<!ENTITY a 'b'>]><x>&a;</x>"),
        ("office.dwg", b"AC1032"),
        ("office.yaml", b"map: {a: &a [*a, *a]}\n"),
    ],
)
def test_a_file_that_cannot_be_used_gives_the_problem_that_one_who_waits_is_told(
    service: Service, tmp_path: Path, file: str, data: bytes
) -> None:
    told = service.client.post("/maps/import", files={"file": (file, data)}).json()
    path = tmp_path / f"upload{Path(file).suffix}"
    path.write_bytes(data)
    with pytest.raises(SemapError) as refused:
        KINDS["map_import"].prepare(
            Task("", 7, "map_import", file, path, ANYONE, "x"), lambda share, message: None
        )
    found = problem_of(refused.value, 7)
    assert {key: found[key] for key in SAME} == {key: told[key] for key in SAME}
    assert told["status"] in (413, 422)
    assert told["remedy"]
    assert found["instance"] == "/jobs/7"
    assert service.get("/maps")["maps"] == []


def test_a_job_fails_with_that_problem(service: Service) -> None:
    cut_off = b"ISO-10303-21;\nHEADER;\n" + b" " * 2000
    told = service.client.post("/maps/import", files={"file": ("office.ifc", cut_off)}).json()
    job = ended(service, send(service, "office.ifc", cut_off))
    assert (job["state"], job["result"]) == ("failed", None)
    assert {key: job["problem"][key] for key in SAME} == {key: told[key] for key in SAME}


def test_a_job_is_cancelled_in_the_midst_of_a_statement(service: Service, spool: Path) -> None:
    with held_back(service):
        sent = send(service, "office.geojson", OFFICE)
        until(lambda: is_waiting(service))
        until(lambda: 0 < service.get(sent.headers["location"])["progress"] < 1)
        assert service.get(sent.headers["location"])["state"] == "running"
        second = send(service, "other.geojson", OFFICE)
        assert second.json()["state"] == "waiting"
        gone = service.client.delete(second.headers["location"]).json()
        assert gone["state"] == "cancelled", "one that waits is cancelled at once"
        third = send(service, "third.geojson", OFFICE)
        full = send(service, "fourth.geojson", OFFICE)
        fifth = full if full.status_code == 429 else send(service, "fifth.geojson", OFFICE)
        assert (fifth.status_code, "retry-after" in fifth.headers) == (429, True)
        service.client.delete(sent.headers["location"]).raise_for_status()
        assert ended(service, sent)["state"] == "cancelled"
        service.client.delete(third.headers["location"]).raise_for_status()
        if full.status_code == 202:
            service.client.delete(full.headers["location"]).raise_for_status()
        for each in (third, full):
            if each.status_code == 202:
                assert ended(service, each)["state"] == "cancelled"
    assert service.get("/maps")["maps"] == []
    again = service.client.delete(sent.headers["location"])
    assert (again.status_code, "cancelled" in again.json()["detail"]) == (409, True)
    until(lambda: list(spool.iterdir()) == [])


def test_a_job_whose_process_is_killed_has_failed(service: Service, spool: Path) -> None:
    with held_back(service):
        sent = send(service, "office.geojson", OFFICE)
        until(lambda: is_waiting(service))
        os.kill(service.app.state.jobs.processes[sent.json()["job_id"]], signal.SIGKILL)
        job = ended(service, sent)
    assert (job["state"], job["problem"]["type"]) == ("failed", "urn:semap:problem:job-lost")
    assert "signal 9" in job["problem"]["detail"]
    assert job["problem"]["remedy"]
    assert service.get("/maps")["maps"] == []
    until(lambda: list(spool.iterdir()) == [])


def test_jobs_that_nobody_holds_are_found_and_old_ones_forgotten(service: Service) -> None:
    dsn = service.plain.info.dsn
    add = "insert into semap.job (kind, file, state, created_by) values ('map_import', 'a', %s, 'x') returning job_id"
    with connect(dsn) as holder, connect(dsn) as other:
        (lost,) = other.execute(add, ["running"]).fetchone()
        with other.transaction():
            (kept,) = other.execute(add, ["waiting"]).fetchone()
            holder.execute("select semap.hold_job(%s)", [kept])
        with one_transaction(dsn, "semap_admin") as connection:
            assert fail_lost_jobs(connection) == 1
            assert fail_lost_jobs(connection) == 0
        found = service.get(f"/jobs/{lost}")
        assert (found["state"], bool(found["problem"]["remedy"])) == ("failed", True)
        assert service.get(f"/jobs/{kept}")["state"] == "waiting"
        other.execute(
            "insert into semap.job (kind, file, state, created_by, finished_at)"
            " select 'map_import', 'b', 'cancelled', 'x', now() from generate_series(1, %s)",
            [KEPT_JOBS + 5],
        )
        with one_transaction(dsn, "semap_admin") as connection:
            forget_jobs(connection)
        (finished,) = other.execute("select count(*) from semap.job where finished_at is not null").fetchone()
        assert finished == KEPT_JOBS
        assert service.get(f"/jobs/{kept}")["state"] == "waiting"
        assert service.client.get(f"/jobs/{lost}").status_code == 404
    with one_transaction(dsn, "semap_admin") as connection:
        assert fail_lost_jobs(connection) == 1
    first = service.get("/jobs", limit=2)
    second = service.get("/jobs", limit=2, before=first["next"])
    numbers = [each["job_id"] for each in (*first["jobs"], *second["jobs"])]
    assert numbers == sorted(numbers, reverse=True)


def test_a_mesh_as_a_job(service: Service) -> None:
    service.make_map()
    crate = service.make_thing("crate", footprint=mapping(shapely.box(0, 0, 9, 9)))
    where = f"/instances/{crate['id']}"

    def put(path: str, **headers: str) -> httpx.Response:
        mesh = ("crate.stl", box_mesh(1, 2, 3, "stl"))
        return service.client.put(path, files={"mesh": mesh}, headers={**ASYNC, **headers})

    stale = ended(service, put(f"{where}/mesh", **{"If-Match": '"other"'}))
    assert (stale["state"], stale["problem"]["status"]) == ("failed", 412)
    etag = service.client.get(where).headers["etag"]
    job = ended(service, put(f"{where}/mesh", **{"If-Match": etag}))
    found = service.get(where)
    assert (job["state"], job["result"]) == ("done", found), job
    assert found["has_body"]
    assert np.ptp([found["band"]["z_min_m"], found["band"]["z_max_m"]]) == pytest.approx(3)


def lines(*documents: dict) -> bytes:
    return b"\n".join(json.dumps(each).encode() for each in documents) + b"\n"


def test_many_instances_at_once(service: Service) -> None:
    service.make_map()
    service.make_room("hall", shapely.box(0, 0, 100, 100), height_m=3)
    blueprint = service.client.post("/maps/office/descriptions", json={"name": "desk"}).json()
    mesh = {"mesh": ("desk.stl", box_mesh(1, 1, 1, "stl"))}
    service.client.put(f"/descriptions/{blueprint['id']}/geometries/Body/mesh", files=mesh).raise_for_status()
    path = "/maps/office/instances/import"
    desks = [
        {
            "name": f"desk {n}",
            "concept": "Furniture",
            "description": "desk",
            "pose": {"x_m": n % 90 + 2, "y_m": n // 90 + 2},
        }
        for n in range(1200)
    ]
    door = {
        "name": "door",
        "concept": "Door",
        "joins": ["hall"],
        "footprint": mapping(shapely.box(0, 0, 1, 0.1)),
    }
    lamp = {"name": "lamp", "concept": "Thing", "frame": "desk 7", "local_pose": {"z_m": 1}}
    job = ended(service, send(service, "desks.ndjson", lines(*desks, door, lamp), path))
    assert job["state"] == "done", job
    assert job["result"] == {
        "map": "office",
        "concepts": {"Door": 1, "Furniture": 1200, "Thing": 1},
        "findings": [],
    }
    (seventh,) = service.get("/instances", map="office", name="desk 7")["instances"]
    found = service.get(f"/instances/{seventh['id']}")
    assert found["description"]["name"] == "desk"
    assert (found["pose"]["x_m"], found["has_body"]) == (9, True)
    (light,) = service.get("/instances", map="office", name="lamp")["instances"]
    assert service.get(f"/instances/{light['id']}")["pose"]["x_m"] == 9
    again = service.client.post(
        path, files={"file": ("one.ndjson", lines({"name": "x", "concept": "Thing"}))}
    )
    assert (again.status_code, again.json()["concepts"]) == (201, {"Thing": 1})
    plan = service.client.post(path, files={"file": ("wing.geojson", OFFICE)})
    assert (plan.status_code, plan.json()["concepts"]["Room"]) == (201, 6)


@pytest.mark.parametrize(
    ("data", "status", "told"),
    [
        (b"", 422, "no instance"),
        (b"{}", 422, "line 1"),
        (lines({"name": "a", "concept": "Thing"}) + b"{", 422, "line 2"),
        (lines({"name": "a", "concept": "Thing"}, {"name": "a", "concept": "Thing"}), 409, "lines 1 to 2"),
        (lines({"name": "a", "concept": "Nothing"}), 422, "Nothing"),
        (lines({"name": "a", "concept": "Thing", "storey": "ninth"}), 422, "ninth"),
        (lines({"name": "a", "concept": "Door", "joins": ["b"]}), 422, "b"),
        (lines({"name": "a", "concept": "Thing", "description": "none"}), 422, "none"),
        (lines({"name": "a", "concept": "Thing", "frame": "none"}), 422, "none"),
        (lines({"name": "a", "concept": "Thing", "height_m": 3}), 422, "line 1"),
        (lines({"name": "a", "concept": "Thing", "more": 3}), 422, "more"),
        (b'{"name": "\xff\xfe", "concept": "Thing"}', 422, "line 1"),
        (b"[" * 200_000, 422, "line 1"),
        (b" " * (5 * 1024**2), 422, "longer"),
    ],
)
def test_all_instances_or_none(service: Service, data: bytes, status: int, told: str) -> None:
    service.make_map()
    refused = service.client.post("/maps/office/instances/import", files={"file": ("a.ndjson", data)})
    assert (refused.status_code, told in refused.json()["detail"]) == (status, True), refused.text
    assert refused.json()["remedy"]
    assert "tmp" not in refused.text
    assert service.get("/instances", map="office")["instances"] == []
    nowhere = send(service, "a.ndjson", data, "/maps/nowhere/instances/import")
    assert nowhere.status_code == 404


@pytest.mark.slow
def test_how_large_a_file_may_be(service: Service, spool: Path) -> None:
    zeros = bytes(70 * 1024**2)
    waits = service.raw.post("/maps/import", files={"file": ("a.geojson", zeros)})
    assert waits.status_code == 413
    assert ended(service, send(service, "a.geojson", zeros))["problem"]["status"] == 422
    too_large = service.raw.post(
        "/maps/import", files={"file": ("a.geojson", bytes(81 * 1024**2))}, headers=ASYNC
    )
    assert too_large.status_code == 413
    until(lambda: list(spool.iterdir()) == [])
