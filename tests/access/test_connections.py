"""What a connection may take of the service before there is a request, and what is answered to what is none."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator

import pytest
from guarded import Guarded, guarded, until
from patience import PATIENCE_S
from semap_service.http.connection import HttpConnection
from semap_service.http.request_head import HEAD_BYTES

UPGRADE = (
    "Host: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
)


@pytest.fixture
def service(database: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Guarded]:
    monkeypatch.setattr(HttpConnection, "head_s", 0.4)
    monkeypatch.setattr(HttpConnection, "take_s", 0.2)
    with guarded(database, without_tokens=True) as running:
        yield running


def opened(service: Guarded, sent: str = "") -> socket.socket:
    made = socket.create_connection(("127.0.0.1", service.port), timeout=PATIENCE_S)
    made.sendall(sent.encode())
    return made


def everything(connection: socket.socket) -> bytes:
    """All that comes until the service closes; it is a failure where that does not happen."""
    received = b""
    try:
        while part := connection.recv(65536):
            received += part
    except ConnectionResetError:
        pass  # closed while more was on its way to it
    return received


def problem_in(answer: bytes) -> tuple[int, dict]:
    head, _, body = answer.partition(b"\r\n\r\n")
    assert b"application/problem+json" in head
    assert b"x-content-type-options: nosniff" in head
    return int(head.split()[1]), json.loads(body)


@pytest.mark.parametrize(
    "beginning",
    ["GET /health HTTP/1.1\r\nHost: local", "G", f"GET /events/feed HTTP/1.1\r\n{UPGRADE}", "\r\n"],
)
def test_half_a_head_is_not_waited_for_without_end(service: Guarded, beginning: str) -> None:
    connections = [opened(service, beginning) for _ in range(50)]
    for each in connections:
        status, problem = problem_in(everything(each))
        assert (status, problem["status"]) == (408, 408)
        each.close()


def test_a_connection_that_says_nothing_is_closed(service: Guarded) -> None:
    with opened(service) as connection:
        assert everything(connection) == b""


def test_the_next_head_of_a_connection_has_no_more_time(service: Guarded) -> None:
    with opened(service, "GET /health HTTP/1.1\r\nHost: localhost\r\n\r\n") as connection:
        assert connection.recv(65536).startswith(b"HTTP/1.1 200")
        connection.sendall(b"GET /health HT")
        assert b" 408 " in everything(connection)


def test_a_body_that_goes_on_after_its_answer_keeps_nothing_open(service: Guarded) -> None:
    head = "POST /maps HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000000\r\n\r\n"
    with opened(service, head) as connection:
        assert b" 413 " in connection.recv(65536)
        connection.sendall(b"x")
        assert b" 408 " in everything(connection)


@pytest.mark.parametrize("length", [8_300, 12_000, 16_000, 17_000, 30_000, 63_000, 66_000, 300_000])
@pytest.mark.parametrize(
    "more", ["Host: localhost\r\nConnection: close\r\n", UPGRADE], ids=["plain", "upgrade"]
)
def test_long_urls_are_answered(service: Guarded, length: int, more: str) -> None:
    target = "/events/feed?" if more == UPGRADE else "/maps?limit=1&"
    with opened(service, f"GET {target}x={'x' * length} HTTP/1.1\r\n{more}\r\n") as connection:
        if length < 16 * 1024:
            assert connection.recv(12) == (b"HTTP/1.1 101" if more == UPGRADE else b"HTTP/1.1 200")
        else:
            status, problem = problem_in(everything(connection))
            assert (status, problem["status"]) == (414, 414)


@pytest.mark.parametrize("lines", [1, 200], ids=["one", "many"])
@pytest.mark.parametrize(
    "more", ["Host: localhost\r\nConnection: close\r\n", UPGRADE], ids=["plain", "upgrade"]
)
def test_large_headers_are_answered(service: Guarded, lines: int, more: str) -> None:
    for length, statuses in ((20_000, (101, 200)), (40_000, (431,)), (2 * HEAD_BYTES, (431,))):
        header = f"X-Long: {'x' * (length // lines)}\r\n" * lines
        target = "/events/feed" if more == UPGRADE else "/health"
        with opened(service, f"GET {target} HTTP/1.1\r\n{more}{header}\r\n") as connection:
            assert int(connection.recv(12).split()[1]) in statuses


@pytest.mark.parametrize(
    "sent",
    [
        "HELLO\r\n\r\n", "GET / HTTP/9.9\r\n\r\n", "GET  HTTP/1.1\r\n\r\n", "GET http:// HTTP/1.1\r\n\r\n",
        "CONNECT a:b HTTP/1.1\r\n\r\n", "GET / HTTP/1.1\r\nContent-Length: x\r\n\r\n", "\x16\x03\x01\x02\x00",
        "GET / HTTP/1.1\r\n: x\r\n\r\n", "GET / HTTP/1.1\r\nTransfer-Encoding: x\r\n\r\n", "GET é HTTP/1.1\r\n\r\n",
        "GET / HTTP/1.1\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n", "GET //[ HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "POST /maps HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        f"POST /events/feed HTTP/1.1\r\n{UPGRADE}\r\n",
        f"GET /events/feed HTTP/1.1\r\n{UPGRADE.replace('13', '12')}\r\n",
        f"GET /events/feed HTTP/1.1\r\n{UPGRADE}Sec-WebSocket-Key: again\r\n\r\n",
        f"GET /events/feed HTTP/1.1\r\n{UPGRADE.replace('Key: dGhl', 'Key: ')}\r\n",
        f"GET /events/feed HTTP/1.1\r\n{UPGRADE}X\x01: 1\r\n\r\n", f"GET /events/feed HTTP/1.1\r\n{UPGRADE}X: \x01\r\n\r\n",
        f"GET /events/feed HTTP/1.1\r\n{UPGRADE}Content-Length: 3\r\n\r\nabc",
        f"GET /events/feed HTTP/1.1\r\n{UPGRADE}Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    ],
)  # fmt: skip
def test_what_is_no_request_is_answered_and_let_go(service: Guarded, sent: str) -> None:
    with opened(service, sent) as connection:
        assert int(everything(connection).split()[1]) in range(400, 501)


def test_an_answer_that_is_not_taken_is_not_kept(service: Guarded) -> None:
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", service.port))
        connection.settimeout(15)
        connection.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 20)
        until(lambda: _is_cut_off(connection))


def _is_cut_off(connection: socket.socket) -> bool:
    try:
        connection.send(b"\r\n")
    except ConnectionError:
        return True
    return False
