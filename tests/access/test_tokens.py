"""Tokens over REST and by the command line: shown once, kept as a hash, of no use when they are over."""

from __future__ import annotations

import hashlib
import json
import socket
import subprocess
import sys
import threading
from contextlib import closing, suppress
from datetime import UTC, datetime, timedelta

import httpx
import pytest
from guarded import Building, Guarded
from patience import PATIENCE_S, until
from semap_service.cli import commands
from typer.testing import CliRunner
from web_socket import connect as connect_socket
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from semap.errors import Conflict, InvalidInput, NotFound
from semap.store.database.connection import connect, one_transaction
from semap.store.operate.tokens import add_token, has_tokens, revoke_token


def stored(service: Guarded) -> str:
    """All that the database knows of tokens, as text."""
    with connect(service.dsn) as owner:
        return str(owner.execute("select t::text, encode(hash, 'hex') from semap.token t").fetchall())


def test_a_token_is_shown_once_and_kept_as_a_hash(building: Building) -> None:
    service = building.service
    with service.client("admin") as admin:
        made = admin.post("/tokens", json={"name": "once", "scopes": ["read"]})
        assert made.status_code == 201
        assert made.headers["cache-control"] == "no-store"
        secret = made.json()["token"]
        where = made.headers["location"]
        shown = admin.get(where).text + admin.get("/tokens?limit=1000").text + stored(service)
        assert secret not in shown
        assert hashlib.sha256(secret.encode()).hexdigest() in stored(service)
        assert admin.get(where).json() == {
            key: value for key, value in made.json().items() if key != "token"
        } | {"last_used_at": None}
        with service.client(secret) as holder:
            assert holder.get("/maps").status_code == 200
            assert admin.get(where).json()["last_used_at"] is not None
            assert admin.delete(where).status_code == 204
            assert holder.get("/maps").status_code == 401  # at once, by the process that revoked it
        assert admin.get(where).json()["revoked_at"] is not None
        assert admin.delete(where).status_code == 204


def test_a_token_tells_what_it_allows(building: Building) -> None:
    service = building.service
    for kind, scopes in (
        ("read", ["read"]),
        ("write", ["read", "write"]),
        ("admin", ["read", "write", "ingest", "admin"]),
    ):
        with service.client(kind) as client:
            assert client.get("/caller").json() == {"name": kind, "scopes": scopes, "maps": None}
    with service.client("annex") as client:
        told = client.get("/caller").json()
        assert (told["scopes"], told["maps"]) == (["read", "write", "ingest"], ["annex"])
    with service.client() as client:
        assert client.get("/caller").status_code == 401


def test_that_a_token_is_used_is_written_once_a_minute(building: Building) -> None:
    service = building.service
    secret = service.add_token("busy", "read")
    stamps = set()
    with service.client(secret) as client, connect(service.dsn) as owner:
        for _ in range(3):
            assert client.get("/maps").status_code == 200
            service.app.state.token_cache.forget(client_id(service, "busy"))
            stamps |= set(
                owner.execute("select last_used_at from semap.token where name = 'busy'").fetchall()
            )
        assert len(stamps) == 1


def client_id(service: Guarded, name: str) -> int:
    with connect(service.dsn) as owner:
        found = owner.execute("select token_id from semap.token where name = %s", [name]).fetchone()
    assert found is not None
    return found[0]


def test_a_feed_ends_when_its_token_is_revoked(building: Building) -> None:
    """By somebody else than this process, so that it has to find out; a stream is ended, a socket told why."""
    service = building.service
    secret = service.add_token("leaving", "read")
    offered = ["semap", f"bearer.{secret}"]
    with (
        connect_socket(service.socket_url("/events/feed"), subprotocols=offered) as feed,  # type: ignore[arg-type]
        service.client(secret) as client,
        client.stream("GET", "/events/stream") as stream,
    ):
        assert json.loads(feed.recv(timeout=PATIENCE_S))["type"] == "hello"
        lines = stream.iter_lines()
        assert any(line.startswith("event: hello") for line in lines)
        with connect(service.dsn) as owner:
            owner.execute("update semap.token set revoked_at = now() where name = 'leaving'")
        assert rest_of(feed)[-1]["type"] == "error"
        assert feed.close_code == 4401
        list(lines)  # ends


def rest_of(feed: ClientConnection) -> list[dict]:
    """All messages until it is closed."""
    messages = []
    with suppress(ConnectionClosed):
        while True:
            messages.append(json.loads(feed.recv(timeout=PATIENCE_S)))
    return messages


def test_a_poll_that_waits_ends_when_its_token_is_revoked(building: Building) -> None:
    service = building.service
    secret = service.add_token("waiting", "read")
    with service.client(secret) as client:
        answers = []
        with connect(service.dsn) as owner:
            newest = owner.execute("select coalesce(max(seq), 0) from semap.event").fetchone()[0]
            waiting = threading.Thread(
                target=lambda: answers.append(client.get(f"/events?after={newest}&wait=15"))
            )
            waiting.start()
            until(lambda: service.app.state.token_cache.is_known(secret))
            owner.execute("update semap.token set revoked_at = now() where name = 'waiting'")
        waiting.join()
        assert [each.status_code for each in answers] == [401]


def test_a_map_that_is_deleted_leaves_its_tokens_and_does_not_return_by_name(building: Building) -> None:
    service = building.service
    with service.client("admin") as admin:
        assert admin.post("/maps", json={"name": "shed"}).status_code == 201
        secret = service.add_token("shed keeper", "write", maps=["shed"])
        with service.client(secret) as keeper:
            assert keeper.get("/maps/shed").status_code == 200
            assert keeper.delete("/maps/shed").status_code == 204
            assert admin.post("/maps", json={"name": "shed"}).status_code == 201
            time_is_over(service, "shed keeper")
            assert keeper.get("/maps/shed").status_code == 404
            assert keeper.get("/maps").json()["maps"] == []
        assert admin.delete("/maps/shed").status_code == 204


def time_is_over(service: Guarded, name: str) -> None:
    """What is remembered of a token is asked again."""
    service.app.state.token_cache.forget(client_id(service, name))


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"scopes": []}, InvalidInput), ({"scopes": ["root"]}, InvalidInput), ({"name": ""}, InvalidInput),
        ({"name": "\0"}, InvalidInput), ({"maps": ["nowhere"]}, NotFound), ({"maps": []}, InvalidInput),
        ({"maps": ["annex"], "scopes": ["admin"]}, InvalidInput), ({"name": "read"}, Conflict),
        ({"expires_at": datetime.now(UTC) - timedelta(seconds=1)}, InvalidInput),
        ({"expires_at": datetime(2999, 1, 1)}, InvalidInput),  # noqa: DTZ001  (that is the point)
    ],
)  # fmt: skip
def test_a_token_that_makes_no_sense_is_refused(
    building: Building, changes: dict, error: type[Exception]
) -> None:
    wanted = {"name": "x", "scopes": ["read"], **changes}
    with (
        pytest.raises(error),
        one_transaction(building.service.dsn, "semap_admin") as connection,
    ):
        add_token(connection, wanted.pop("name"), wanted.pop("scopes"), created_by="test", **wanted)


def answers(client: httpx.Client, path: str) -> bool:
    try:
        return client.get(path).status_code == 200
    except httpx.TransportError:
        return False


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_whether_anybody_has_a_token(database: str) -> None:
    def has_any() -> bool:
        with one_transaction(database, "semap_admin") as connection:
            return has_tokens(connection)

    assert not has_any()
    with one_transaction(database, "semap_admin") as connection:
        made, _ = add_token(connection, "a", ["read"], created_by="test")
    assert has_any()
    with one_transaction(database, "semap_admin") as connection:
        revoke_token(connection, made.token_id)
    assert not has_any()
    with one_transaction(database, "semap_admin") as connection:
        soon = datetime.now(UTC) + timedelta(days=1)
        add_token(connection, "a", ["read"], expires_at=soon, created_by="test")
    assert has_any()
    with connect(database) as owner:
        owner.execute("update semap.token set expires_at = now()")
    assert not has_any()


def test_a_service_that_starts_without_tokens_says_how_to_make_one(database: str) -> None:
    port = free_port()
    arguments = ["serve", "--port", str(port), "--dsn", database]
    with subprocess.Popen(
        [sys.executable, "-m", "semap_service", *arguments], stderr=subprocess.PIPE, text=True
    ) as serving:
        assert serving.stderr is not None
        try:
            assert "There is no token yet" in serving.stderr.readline()
            assert "semap token add" in serving.stderr.readline()
            with httpx.Client(base_url=f"http://127.0.0.1:{port}") as client:
                until(lambda: answers(client, "/health"))
                assert client.get("/maps").status_code == 401
                made = CliRunner().invoke(commands(), ["token", "add", "me", "--dsn", database])
                client.headers["Authorization"] = f"Bearer {made.stdout.strip()}"
                assert client.get("/maps").status_code == 200
        finally:
            serving.terminate()


def test_tokens_by_the_command_line(building: Building) -> None:
    service, run = building.service, CliRunner()

    def semap(*arguments: str):
        return run.invoke(commands(), ["token", *arguments, "--dsn", service.dsn])

    before = datetime.now(UTC)
    made = semap("add", "robot", "--scope", "ingest", "--map", "office", "--expires", "90d")
    secret = made.stdout.strip()
    assert made.exit_code == 0
    with service.client(secret) as robot:
        assert [each["name"] for each in robot.get("/maps").json()["maps"]] == ["office"]
    (row,) = (each for each in json.loads(semap("list", "--json").stdout) if each["name"] == "robot")
    assert (row["scopes"], row["maps"]) == (["ingest"], ["office"])
    life = timedelta(days=90)
    assert before + life <= datetime.fromisoformat(row["expires_at"]) <= datetime.now(UTC) + life
    assert secret.startswith(row["begins"])
    assert "robot" in semap("list").stdout
    assert semap("revoke", "robot").exit_code == 0
    with closing(service.client(secret)) as robot:
        until(lambda: robot.get("/maps").status_code == 401)
    assert isinstance(semap("revoke", "robot").exception, NotFound)
    assert isinstance(semap("add", "x", "--expires", "soon").exception, InvalidInput)
