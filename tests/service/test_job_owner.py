"""A job is seen by the token that sent it, and by administrators; it brings things into that token's maps only."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from lasting import lasting_service
from running import Service
from semap_service import demo

from semap.cluster import Cluster
from semap.store.database.connection import one_transaction
from semap.store.operate.tokens import add_token

OFFICE = (Path(demo.__file__).parent / "office.geojson").read_bytes()
LINE = json.dumps({"name": "desk", "concept": "Thing"}).encode()


class Speaker:
    """A client with a token of its own."""

    def __init__(self, service: Service, name: str, *scopes: str, maps: list[str] | None = None) -> None:
        with one_transaction(service.plain.info.dsn, "semap_admin") as connection:
            _, token = add_token(connection, name, scopes, maps=maps, created_by="test")
        self.client = httpx.Client(
            base_url=service.url, headers={"Authorization": f"Bearer {token}"}, timeout=60
        )

    def send(self, path: str, file: str, data: bytes) -> httpx.Response:
        return self.client.post(path, files={"file": (file, data)}, headers={"Prefer": "respond-async"})

    def ended(self, where: str) -> dict:
        deadline_s = time.monotonic() + 90
        job = self.client.get(where).json()
        while job["finished_at"] is None:
            assert time.monotonic() < deadline_s
            job = self.client.get(where, params={"wait": 20}).json()
        return job


@pytest.fixture
def service(cluster: Cluster, template: str) -> Iterator[Service]:
    with lasting_service(cluster, template, without_tokens=False) as running:
        yield running


@pytest.fixture
def speaker(service: Service) -> Iterator[Callable[..., Speaker]]:
    made: list[Speaker] = []

    def speaker(name: str, *scopes: str, maps: list[str] | None = None) -> Speaker:
        made.append(Speaker(service, name, *scopes, maps=maps))
        return made[-1]

    yield speaker
    for each in made:
        each.client.close()


@contextmanager
def held_up(service: Service) -> Iterator[None]:
    """Jobs come as far as to bring in what they read."""
    with service.plain.transaction():
        service.plain.execute("lock table semap.instance in share mode")
        yield


def test_whose_job_it_is(speaker: Callable[..., Speaker]) -> None:
    admin = speaker("root", "admin")
    writer = speaker("writer", "write")
    other = speaker("other", "write")
    assert admin.client.post("/maps", json={"name": "office"}).status_code == 201
    assert admin.client.post("/maps", json={"name": "secret"}).status_code == 201
    guest = speaker("guest", "write", maps=["office"])
    reader = speaker("reader", "read")

    sent = writer.send("/maps/import", "tower.geojson", OFFICE)
    assert sent.status_code == 202, sent.text
    where = sent.headers["location"]
    for stranger in (other, guest, reader):
        assert stranger.client.get(where).status_code == 404
        assert stranger.client.get("/jobs").json()["jobs"] == []
    for stranger, status in ((other, 404), (guest, 404), (reader, 403)):
        assert stranger.client.delete(where).status_code == status
    assert writer.ended(where)["state"] == "done"
    (seen,) = writer.client.get("/jobs").json()["jobs"]
    assert admin.client.get("/jobs").json()["jobs"] == [seen]
    assert seen["created_by"] == "writer"
    (change,) = admin.client.get("/maps/tower/changes").json()["changes"]
    assert change["author"] == "writer"

    into = "/maps/{}/instances/import"
    assert guest.send(into.format("secret"), "a.ndjson", LINE).status_code == 404
    assert reader.send(into.format("office"), "a.ndjson", LINE).status_code == 403
    assert (
        guest.ended(guest.send(into.format("office"), "a.ndjson", LINE).headers["location"])["state"]
        == "done"
    )
    (desk,) = guest.client.get("/instances").json()["instances"]
    assert (desk["map"], desk["name"]) == ("office", "desk")
    for refused in (writer, guest, reader):
        assert refused.client.get("/webhooks").status_code == 403
    assert admin.client.get("/webhooks").json() == {"webhooks": [], "next": None}
    private = admin.client.post("/webhooks", json={"url": "http://127.0.0.1:9/"})
    assert (private.status_code, "private" in private.json()["detail"]) == (422, True)


def test_the_jobs_of_a_revoked_token_are_cancelled(service: Service, speaker: Callable[..., Speaker]) -> None:
    admin = speaker("root", "admin")
    leaving, staying = speaker("leaving", "write"), speaker("staying", "write")
    with held_up(service):
        sent = [
            leaving.send("/maps/import", "a.geojson", OFFICE),
            staying.send("/maps/import", "b.geojson", OFFICE),
        ]
        numbers = {each["name"]: each["id"] for each in admin.client.get("/tokens").json()["tokens"]}
        assert admin.client.delete(f"/tokens/{numbers['leaving']}").status_code == 204
    ends = [admin.ended(each.headers["location"]) for each in sent]
    assert [each["state"] for each in ends] == ["cancelled", "done"], ends


def test_a_job_that_was_cancelled_as_its_process_began_brings_nothing_in(
    service: Service, speaker: Callable[..., Speaker]
) -> None:
    """It may be done before it first looks whether it is to stop."""
    writer = speaker("writer", "write")
    assert writer.client.post("/maps", json={"name": "office"}).status_code == 201
    with held_up(service):
        where = writer.send("/maps/office/instances/import", "a.ndjson", LINE).headers["location"]
        while writer.client.get(where).json()["state"] == "waiting":
            pass
        assert writer.client.delete(where).status_code in (200, 202, 204)
    assert writer.ended(where)["state"] == "cancelled"
    assert writer.client.get("/instances").json()["instances"] == []
