"""Every operation, asked by every kind of caller: the status that the policy says, before anything is read."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache

import httpx
import pytest
from guarded import Building
from patience import PATIENCE_S
from semap_service.access.policy import POLICY, demand_of
from semap_service.context.caller import INCLUDED
from semap_service.serving.app import create_app
from sqlalchemy import event
from web_socket import connect

from semap.store.map.operator_table import OPERATORS

USELESS = (None, "wrong", "revoked", "expired")
KINDS = ("read", "write", "ingest", "admin")
SOCKETS = {"/events/feed": "read", "/maps/{name}/live": "read", "/maps/{name}/states/live": "ingest"}
"""With the scope that each needs."""
PROBLEM = "application/problem+json"

Operation = tuple[str, str]


@cache
def published() -> dict:
    return create_app("").openapi()


def operations() -> list[Operation]:
    return sorted(
        (method.upper(), path) for path, methods in published()["paths"].items() for method in methods
    )


def guarded_operations() -> list[Operation]:
    return [each for each in operations() if demand_of(*each).scope is not None]


def filled(path: str, **values: object) -> str:
    """A path with these values, and what nothing has for the others."""
    given = {"name": "office", **values}
    return re.sub(r"{(\w+)(:\w+)?}", lambda found: str(given.get(found[1], 2**31 - 1)), path)


def ask(client: httpx.Client, method: str, path: str) -> tuple[int, str, str]:
    """Status, media type and text of an answer; of one that does not end only its beginning."""
    body = {} if method in ("GET", "DELETE") else {"json": {}}
    with client.stream(method, path, **body) as answer:
        is_endless = answer.headers.get("content-type", "").startswith("text/event-stream")
        text = "" if is_endless else answer.read().decode(errors="replace")
        return answer.status_code, answer.headers.get("content-type", ""), text


def test_the_policy_is_what_it_was_meant_to_be() -> None:
    open_to_all = {path for method, path in operations() if demand_of(method, path).scope is None}
    assert open_to_all <= {
        "/",
        "/api",
        "/health",
        "/ready",
        "/conformance",
        "/openapi.json",
        "/asyncapi.json",
    }
    by_scope: dict[str | None, set[Operation]] = {}
    for method, path in operations():
        by_scope.setdefault(demand_of(method, path).scope, set()).add((method, path))
    assert by_scope["ingest"] == {("POST", "/object-states"), ("POST", "/maps/{name}/states")}
    assert {path.split("/")[1] for _, path in by_scope["admin"]} <= {"tokens", "webhooks", "metrics"}
    assert {each for each in by_scope["read"] if each[0] != "GET"} == {
        ("POST", "/rules/dry-run"),
        ("POST", "/rule-templates/{name}/text"),
        ("POST", "/maps/{name}/rules/check"),
        ("POST", "/maps/{name}/operators/{operator}"),
    }
    editing = {each.name for each in OPERATORS.values() if each.edits}
    asking = {name: demand_of("POST", f"/maps/office/operators/{name}").scope for name in OPERATORS}
    assert asking == {name: "write" if name in editing else "read" for name in OPERATORS}
    assert demand_of("HEAD", "/tokens").scope == "admin"
    assert demand_of("POST", "/what/nobody/has/made/yet").scope == "write"


def test_every_row_of_the_policy_is_of_a_route() -> None:
    app = create_app("")
    known = {path for _, path in operations()} | {getattr(route, "path", "") for route in app.routes}
    known |= {"/docs/{file:path}", "/page/{file:path}", "/favicon.ico", *SOCKETS}
    for _, path, _ in POLICY:
        generic = re.sub(r"/operators/\w+$", "/operators/{operator}", path).removesuffix("/{rest:path}")
        assert generic in known or any(each.startswith(generic) for each in known), path


@pytest.mark.parametrize("token", USELESS)
def test_nobody_comes_in_without_a_token_that_counts(building: Building, token: str | None) -> None:
    with building.service.client(token) as client, database_is_left_alone(building, token):
        for method, path in guarded_operations():
            status, media_type, text = ask(client, method, filled(path, **building.ids))
            assert (status, media_type) == (401, PROBLEM), (method, path, text)
            assert json.loads(text)["remedy"]
        answer = client.get("/maps")
        assert answer.headers["www-authenticate"].startswith("Bearer")


@pytest.mark.parametrize("kind", KINDS)
def test_a_token_allows_what_its_scope_says(building: Building, kind: str) -> None:
    with building.service.client(kind) as client:
        client.get("/maps")
        for method, path in guarded_operations():
            may = demand_of(method, path).scope in INCLUDED[kind]
            status, media_type, text = ask(client, method, filled(path, name="nowhere"))
            assert (status == 403) is not may, (method, path, text)
            assert status < 500 or path == "/ready", (method, path, text)
            if not may:
                assert media_type == PROBLEM
                assert json.loads(text)["type"] == "urn:semap:problem:forbidden"


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_refused_reads_nothing(building: Building, kind: str) -> None:
    with building.service.client(kind) as client:
        assert client.get("/maps").status_code == 200  # the token is known from here on
        with database_is_left_alone(building, None):
            for method, path in guarded_operations():
                if demand_of(method, path).scope not in INCLUDED[kind]:
                    body = iter([b"{", b'"never": "read"}'])
                    answer = client.request(method, filled(path), content=body)
                    assert answer.status_code == 403, (method, path)


def test_another_map_is_as_if_it_were_not_there(building: Building) -> None:
    """By a token that may write `annex`: nothing of the office is told, and nothing of it changes."""
    with building.service.client("admin") as admin, building.service.client("annex") as client:
        before = [admin.get(path).text for path in ("/instances?map=office", "/rules?map=office")]
        for method, path in guarded_operations():
            demand = demand_of(method, path)
            if demand.scope == "admin":
                continue
            status, _, text = ask(client, method, filled(path, **ids_of(building, path)))
            assert "office person" not in text, (method, path)
            assert "office room" not in text, (method, path)
            assert "office lamp" not in text, (method, path)
            assert status < 500, (method, path, text)
            if demand.all_maps:
                assert status == 403, (method, path, text)
            elif "{" in path and method in ("GET", "DELETE") and not path.startswith("/concepts"):
                assert status in (404, 422), (method, path, status, text)
        assert before == [admin.get(path).text for path in ("/instances?map=office", "/rules?map=office")]


def test_a_list_has_what_is_on_the_maps_of_a_token(building: Building) -> None:
    with building.service.client("annex") as client, building.service.client("admin") as admin:
        assert [each["name"] for each in client.get("/maps").json()["maps"]] == ["annex"]
        for path in (
            "/instances", "/rooms", "/tracks", "/queries", "/rules", "/relations", "/events", "/object-states",
            "/doors",
        ):  # fmt: skip
            (key,) = (name for name, value in admin.get(path).json().items() if isinstance(value, list))
            seen = {each["map"] for each in client.get(path).json()[key]}
            assert seen <= {"annex"}, path
            assert {each["map"] for each in admin.get(path).json()[key]} >= seen
            assert client.get(path, params={"map": "office"}).status_code == 404, path
        assert client.get("/rooms").json()["rooms"][0]["name"] == "annex room"


@pytest.mark.parametrize("path", SOCKETS)
@pytest.mark.parametrize(
    ("token", "code"),
    [(None, 4401), ("wrong", 4401), ("revoked", 4401), ("read", None), ("write", None), ("ingest", None)],
)
def test_a_socket_asks_for_a_token(
    building: Building, path: str, token: str | None, code: int | None
) -> None:
    offered = ["semap"]
    if token is not None:
        offered.append(f"bearer.{building.service.tokens[token]}")
    url = building.service.socket_url(filled(path))
    if code is None and SOCKETS[path] == "ingest" != token:
        code = 4403
    with connect(f"{url}?source=tags", subprotocols=offered) as socket:
        assert socket.subprotocol == "semap"
        first = json.loads(socket.recv(timeout=PATIENCE_S))
        if code is None:
            assert first["type"] in ("hello", "snapshot")
            return
        assert first["type"] == "error"
        with pytest.raises(Exception, match=str(code)):
            socket.recv(timeout=PATIENCE_S)


def ids_of(building: Building, path: str) -> dict[str, object]:
    """What is in the office, for the parameters of a path."""
    ids = building.ids
    kind = path.split("/")[1]
    of_kind = {
        "frames": "frame", "descriptions": "description", "instances": "instance", "rooms": "instance",
        "doors": "instance", "tracks": "track", "queries": "query", "rules": "rule", "changes": "change",
    }  # fmt: skip
    concept = {"name": "Room"} if kind == "concepts" else {}
    return {
        "id": ids.get(of_kind.get(kind, ""), 2**31 - 1),
        "type": "Footprint", "geometry": "body", "operator": "topology", "quantity": "velocity", "tPropertyName": "speed_mps",
        "collection": "office.Room", "collection_id": "office.Room", **concept,
    }  # fmt: skip


class database_is_left_alone:  # noqa: N801  (it reads as a statement)
    """No connection is taken while a block runs, but for looking a token up once in a while."""

    def __init__(self, building: Building, token: str | None) -> None:
        self.engine = building.service.app.state.engine
        self.is_asked = token is not None
        self.taken = 0

    def __enter__(self) -> None:
        event.listen(self.engine, "checkout", self._count)

    def __exit__(self, *_: object) -> None:
        event.remove(self.engine, "checkout", self._count)
        assert self.taken <= (10 if self.is_asked else BACKGROUND)

    def _count(self, *_: object) -> None:
        self.taken += 1


BACKGROUND = 10
"""What the feed and the webhooks may look for meanwhile."""


@pytest.fixture(autouse=True)
def _concepts(building: Building) -> Iterator[None]:
    """What all maps share stays as it was too."""
    with building.service.client("admin") as admin:
        before = admin.get("/concepts?limit=1000").text
        yield
        assert admin.get("/concepts?limit=1000").text == before
