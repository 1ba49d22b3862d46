"""How much a caller may ask for, and from where; each limit with its answer."""

from __future__ import annotations

import json
import socket
from dataclasses import replace

import httpx
import pytest
from guarded import Guarded, guarded
from hypothesis import given
from hypothesis import strategies as st
from patience import PATIENCE_S, until
from semap_service.access.credentials import address_of
from semap_service.access.limits import LIMITS
from semap_service.access.loopback_host import is_loopback
from semap_service.access.rate_limit import BURST, Buckets
from semap_service.http.own_origin import require_origin
from web_socket import connect as connect_socket
from websockets.exceptions import ConnectionClosed, InvalidStatus

from semap.errors import InvalidInput
from semap.store.database.connection import connect

SITE = "https://maps.example"


@given(rate_per_s=st.floats(0.1, 1000), gaps_s=st.lists(st.floats(0, 20), max_size=60))
def test_nobody_gets_more_than_the_bucket_and_what_flows_in(rate_per_s: float, gaps_s: list[float]) -> None:
    buckets = Buckets(rate_per_s)
    now_s = granted = 0.0
    for gap_s in gaps_s:
        now_s += gap_s
        allowance = buckets.take("somebody", now_s)
        granted += allowance.wait_s == 0
        assert granted <= max(1, rate_per_s * BURST) + rate_per_s * now_s + 1e-6
        if allowance.wait_s > 0:
            later = buckets.take("somebody", now_s + allowance.wait_s + 1e-6)
            assert later.wait_s == 0
            granted += 1
            now_s += allowance.wait_s + 1e-6


def test_the_bucket_of_one_is_not_that_of_another() -> None:
    buckets = Buckets(0.25, most_callers=2)
    assert buckets.take("a", 0).wait_s == 0
    assert buckets.take("a", 0).wait_s == pytest.approx(4)
    assert buckets.take("b", 0).wait_s == 0
    assert buckets.take("c", 0).wait_s == 0  # and the one that was quiet longest is forgotten
    assert buckets.take("a", 0).wait_s == 0


def test_too_many_requests_are_told_when_to_come_again(database: str) -> None:
    # so little flows in that it is the same on a slow machine
    with guarded(database, replace(LIMITS, rate_per_s=1e-4)) as service:
        a, b = service.add_token("a", "read"), service.add_token("b", "read")
        with service.client(a) as first, service.client(b) as second:
            answers = [first.get("/maps") for _ in range(3)]
            assert [each.status_code for each in answers] == [200, 429, 429]
            assert answers[0].headers["ratelimit"].startswith('"requests";r=0;t=')
            assert answers[0].headers["ratelimit-policy"] == '"requests";q=1;w=10000'
            assert 5000 < int(answers[2].headers["retry-after"]) <= 10000
            assert answers[2].json()["type"] == "urn:semap:problem:too-many-requests"
            # a token has its own; nobody's are counted by the address, which looking up tokens was counted by
            assert second.get("/maps").status_code in (200, 429)


def test_feeds_that_are_open_are_counted(database: str) -> None:
    with guarded(database, replace(LIMITS, feeds=2)) as service:
        offered = ["semap", f"bearer.{service.add_token('a', 'read')}"]

        def follow():
            return connect_socket(service.socket_url("/events/feed"), subprotocols=offered)  # type: ignore[arg-type]

        with follow() as first, follow() as second, follow() as third, service.client("a") as client:
            assert json.loads(first.recv(timeout=PATIENCE_S))["type"] == "hello"
            assert json.loads(second.recv(timeout=PATIENCE_S))["type"] == "hello"
            assert json.loads(third.recv(timeout=PATIENCE_S))["type"] == "error"
            with pytest.raises(ConnectionClosed, match="4429"):
                third.recv(timeout=PATIENCE_S)
            refused = client.get("/events?wait=1")
            assert (refused.status_code, refused.json()["type"]) == (429, "urn:semap:problem:too-many-feeds")
            assert client.get("/events").status_code == 200
            first.close()
            until(lambda: client.get("/events?after=0&wait=0.01").status_code == 200)


def test_a_request_that_takes_the_database_too_long_is_cancelled(database: str) -> None:
    with guarded(database, replace(LIMITS, statement_s=0.3)) as service:
        service.add_token("a", "read")
        with connect(service.dsn) as owner, service.client("a") as client, owner.transaction():
            owner.execute("lock table semap.concept in access exclusive mode")
            answer = client.get("/concepts")
            assert answer.status_code == 504
            assert answer.json()["type"] == "urn:semap:problem:too-long"
            assert answer.json()["remedy"]
            waiting = owner.execute("select count(*) from pg_locks where not granted").fetchone()
            assert waiting == (0,)


def test_urls_and_headers_have_an_end(database: str) -> None:
    with guarded(database, replace(LIMITS, url_bytes=200, header_bytes=1000)) as service:
        service.add_token("a", "read")
        with service.client("a") as client:
            for answer, status in (
                (client.get("/maps", params={"after": "x" * 300}), 414),
                (client.get("/maps", headers={"X-Long": "x" * 2000}), 431),
            ):
                assert answer.status_code == status
                assert answer.headers["content-type"] == "application/problem+json"


def test_a_body_that_stops_arriving_is_given_up(database: str) -> None:
    with guarded(database, replace(LIMITS, stall_s=0.3)) as service:
        token = service.add_token("a", "write")
        head = f"POST /maps HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n"
        with socket.create_connection(("127.0.0.1", service.port)) as client:
            client.settimeout(10)
            client.sendall(f"{head}Content-Type: application/json\r\nContent-Length: 100\r\n\r\n{{".encode())
            assert client.recv(4096).startswith(b"HTTP/1.1 408 ")


@pytest.fixture
def open_to_all(database: str):
    with guarded(database, without_tokens=True, allowed_origins=[SITE]) as service:
        yield service


def test_without_tokens_only_names_of_this_machine_are_answered(open_to_all: Guarded) -> None:
    with open_to_all.client() as client:
        for host, status in (
            ("localhost", 200), ("127.0.0.1:8000", 200), ("[::1]:80", 200), ("evil.example", 421),
            ("127.0.0.1.evil.example", 421), ("localhost.evil.example", 421), ("", 421),
        ):  # fmt: skip
            answer = client.get("/maps", headers={"Host": host})
            assert answer.status_code == status, host
    elsewhere = {"Host": "evil.example"}
    with connect_socket(open_to_all.socket_url("/events/feed"), additional_headers=elsewhere) as feed:
        assert json.loads(feed.recv(timeout=PATIENCE_S))["type"] == "error"
        with pytest.raises(ConnectionClosed, match="1008"):
            feed.recv(timeout=PATIENCE_S)


@pytest.mark.parametrize(
    ("host", "is_one"),
    [("LOCALHOST", True), ("a.localhost", True), ("127.1.2.3", True), ("0.0.0.0", False), ("10.0.0.1", False),
     ("localhost.", False), ("[::ffff:8.8.8.8]", False), ("x@localhost", True), ("localhost@x", False),
     ("[", False), ("\xff", False)],
)  # fmt: skip
def test_names_of_this_machine(host: str, is_one: bool) -> None:
    assert is_loopback(host) is is_one


def test_pages_of_other_sites_are_kept_out_unless_they_are_named(open_to_all: Guarded) -> None:
    def ask(method: str, origin: str, **headers: str) -> httpx.Response:
        with open_to_all.client() as client:
            return client.request(method, "/maps", headers={"Origin": origin, **headers})

    assert "access-control-allow-origin" not in ask("GET", "https://evil.example").headers
    assert ask("POST", "https://evil.example").status_code == 403
    assert ask("POST", "null").status_code == 403
    assert ask("GET", SITE).headers["access-control-allow-origin"] == SITE
    assert ask("POST", SITE).status_code == 422
    assert ask("POST", open_to_all.url).status_code == 422
    wanted = {"Access-Control-Request-Method": "PATCH", "Access-Control-Request-Headers": "authorization"}
    assert ask("OPTIONS", SITE, **wanted).status_code == 200
    assert ask("OPTIONS", "https://evil.example", **wanted).status_code == 400
    for origin, is_let_in in ((SITE, True), ("https://evil.example", False)):
        try:
            with connect_socket(open_to_all.socket_url("/events/feed"), origin=origin) as feed:  # type: ignore[arg-type]
                assert json.loads(feed.recv(timeout=PATIENCE_S))["type"] == "hello"
            assert is_let_in
        except InvalidStatus:
            assert not is_let_in


def test_with_tokens_a_refusal_can_be_read_by_the_page_of_a_named_site(database: str) -> None:
    with guarded(database, allowed_origins=[SITE]) as service, service.client() as client:
        answer = client.get("/maps", headers={"Origin": SITE})
        assert answer.status_code == 401
        assert answer.headers["access-control-allow-origin"] == SITE
        assert "access-control-allow-credentials" not in answer.headers


@pytest.mark.parametrize(
    ("text", "origin"),
    [
        ("https://maps.example", SITE),
        ("https://MAPS.example:443/", SITE),
        ("http://[::1]:3000", "http://[::1]:3000"),
    ],
)
def test_an_origin_is_as_browsers_send_it(text: str, origin: str) -> None:
    assert require_origin(text) == origin


@pytest.mark.parametrize(
    "text", ["*", "maps.example", "ftp://a", "https://a/b", "https://a:x", "https://u@a", ""]
)
def test_what_is_no_origin_is_refused(text: str) -> None:
    with pytest.raises(InvalidInput):
        require_origin(text)


def test_of_ipv6_the_network_counts() -> None:
    def at(host: str) -> str:
        return address_of({"client": (host, 1)})

    assert at("2001:db8::1") == at("2001:db8::ffff") != at("2001:db8:0:1::1")
    assert at("10.0.0.1") != at("10.0.0.2")
