"""Each request has an id: in its answer, in its problem, in the log; and a line in the log without secrets."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator

import pytest
from running import Service
from web_socket import connect as open_socket

from semap.cluster import Cluster
from semap.store.database import connect

TRACE = "4bf92f3577b34da6a3ce929d0e0e4736"
PARENT = f"00-{TRACE}-00f067aa0ba902b7-01"


@pytest.fixture
def access_log(caplog: pytest.LogCaptureFixture) -> Iterator[pytest.LogCaptureFixture]:
    with caplog.at_level(logging.INFO, "semap_service"):
        yield caplog


def lines(service: Service, access_log: pytest.LogCaptureFixture, count: int) -> list[logging.LogRecord]:
    """They are written when an answer has ended, which its reader may know before."""

    def found() -> list[logging.LogRecord]:
        return [each for each in access_log.records if each.name == "semap_service.access"]

    service.until(lambda: len(found()) >= count)
    return found()


def test_the_answer_and_its_problem_have_the_id(service: Service) -> None:
    for asked, expected in (({"X-Request-ID": "mine-1"}, "mine-1"), ({"traceparent": PARENT}, TRACE)):
        answer = service.client.get("/maps/nowhere", headers=asked)
        assert answer.status_code == 404
        assert answer.headers["x-request-id"] == expected
        assert answer.json()["request_id"] == expected
    forged = service.client.get("/maps", headers={"X-Request-ID": "a b"}).headers["x-request-id"]
    assert len(forged) == 32
    assert forged != service.client.get("/maps").headers["x-request-id"]


def test_a_line_for_each_request(service: Service, access_log: pytest.LogCaptureFixture) -> None:
    service.client.get("/health")
    service.raw.get(
        "/maps/nowhere?secret=geheim", headers={"X-Request-ID": "one", "Authorization": "Bearer geheim"}
    )
    [line] = lines(service, access_log, 1)
    assert (line.route, line.method, line.status) == ("/maps/{name}", "GET", 404)
    assert line.path == "/maps/nowhere"
    assert 0 < line.duration_ms < 60_000
    assert line.client == "127.0.0.1"
    assert "geheim" not in json.dumps({name: str(value) for name, value in vars(line).items()})


def test_a_socket_has_one_too(service: Service, access_log: pytest.LogCaptureFixture) -> None:
    with open_socket(service.feed_url, additional_headers={"X-Request-ID": "two"}) as socket:
        assert socket.response is not None
        assert socket.response.headers["X-Request-ID"] == "two"
        assert json.loads(socket.recv())["type"] == "hello"
    [line] = lines(service, access_log, 1)
    assert (line.route, line.method, line.status) == ("/events/feed", "WEBSOCKET", 101)


def test_what_nobody_expected_is_answered_counted_and_logged(
    service: Service, access_log: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semap_service.routes.maps._read", lambda *_, **__: 1 / 0)
    answer = service.client.get("/maps/office", headers={"X-Request-ID": "three"})
    assert answer.status_code == 500
    assert answer.headers["x-request-id"] == answer.json()["request_id"] == "three"
    assert "ZeroDivisionError" not in answer.text
    assert lines(service, access_log, 1)[-1].status == 500
    assert [
        each for each in access_log.records if each.exc_info and each.name == "semap_service.http.problem"
    ]
    assert 'status="500"' in service.raw.get("/metrics").text


def test_ready_says_what_is_missing(service: Service, database: str, cluster: Cluster) -> None:
    from rule_work import running_worker  # noqa: PLC0415

    not_yet = service.client.get("/ready")
    assert not_yet.status_code == 503
    assert [each["where"] for each in not_yet.json()["errors"]] == ["worker"]
    assert "Retry-After" in not_yet.headers
    with running_worker(database):
        service.until(lambda: service.client.get("/ready").status_code == 200)
        assert service.client.get("/health").json()["status"] == "ok"
    service.until(lambda: service.client.get("/ready").status_code == 503)
    with connect(database) as connection:
        connection.execute("select pg_drop_replication_slot(semap.rule_slot())")
        connection.execute("update semap.schema_version set version_num = '0001'")
    said = {each["where"]: each["message"] for each in service.client.get("/ready").json()["errors"]}
    assert said.keys() == {"schema", "slot"}
    assert "semap db migrate" in said["schema"]
    assert "semap db resync" in said["slot"]
