"""A request cannot make the loop wait: what it may hold is bounded, and what is large is answered beside it."""

from __future__ import annotations

import asyncio
import inspect
import itertools
import json
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter
from running import Service
from semap_service.documents.document import Request
from semap_service.documents.json_values import MOST_VALUES, require_few_values
from semap_service.http.body_limit import LimitedBody
from semap_service.http.json_body import BESIDE_BYTES, MOST_BYTES, UPLOADS, BoundedJson
from semap_service.routes import operators
from semap_service.serving import app as app_module
from semap_service.serving.app import create_app
from starlette.exceptions import HTTPException

from semap.errors import TooLarge

JSON = {"Content-Type": "application/json"}


def post(service: Service, path: str, text: str | bytes):
    return service.client.post(path, content=text, headers=JSON)


def many_keys(count: int) -> str:
    return "{" + ",".join(f'"k{n}":1' for n in range(count)) + "}"


@pytest.mark.parametrize(
    ("path", "before", "place"),
    [
        ("/rules/dry-run", "%s", "body"),
        ("/maps/office/rules/check", "%s", "body"),
        ("/maps/office/operators/near_objects", '{"references":%s}', "body.references"),
        ("/maps/office/operators/near_objects", "%s", "body"),
    ],
)
@pytest.mark.parametrize("count", [21, 50_000])
def test_the_first_faults_are_named_and_the_others_counted(
    service: Service, path: str, before: str, place: str, count: int
) -> None:
    answer = post(service, path, before % many_keys(count))
    assert answer.status_code == 422
    problem = answer.json()
    assert [each["where"] for each in problem["errors"]] == [f"{place}.k{n}" for n in range(20)]
    assert problem["more_errors"] == count - 20
    assert len(answer.content) < 8_000


def test_a_few_faults_are_all_named(service: Service) -> None:
    answer = post(service, "/rules/dry-run", many_keys(20))
    problem = answer.json()
    assert (len(problem["errors"]), problem["more_errors"]) == (20, 2)  # `map` and `declaration` are missing
    answer = post(service, "/maps", '{"name": "", "nme": 1}')
    assert {each["where"] for each in answer.json()["errors"]} == {"body.name", "body.nme"}


def test_what_was_sent_is_not_sent_back_at_length(service: Service) -> None:
    for text in ('{"%s":1}' % ("k" * 900_000), '{"name":["%s"]}' % ("k" * 900_000)):
        answer = post(service, "/maps", text)
        assert answer.status_code == 422
        assert len(answer.content) < 8_000


def test_bodies_that_are_no_files_have_a_megabyte(service: Service) -> None:
    fits, exceeds = (f'{{"name":"{"x" * (MOST_BYTES - 11 + more)}"}}' for more in (0, 1))
    assert post(service, "/maps", fits).status_code == 422  # the name is too long
    for sent in (exceeds.encode(), iter([exceeds[:100_000].encode(), exceeds[100_000:].encode()])):
        answer = service.client.post("/maps", content=sent, headers=JSON)
        assert (answer.status_code, answer.json()["status"]) == (413, 413)


@pytest.mark.parametrize(
    "text",
    ["[" + ",".join(["[]"] * 60_000) + "]", "[" + "0," * MOST_VALUES + "0]", "[" * 200_000 + "]" * 200_000],
)
def test_documents_have_an_end_to_their_values(service: Service, text: str) -> None:
    answer = post(service, "/maps", text)
    assert (answer.status_code, answer.json()["type"]) == (413, "urn:semap:problem:too-large")
    service.make_map()
    form = {"document": (None, f'{{"name":"a","concept":"Room","attributes":{{"a":{text}}}}}')}
    answer = service.client.post("/maps/office/instances", files=form)
    assert (answer.status_code, answer.json()["type"]) == (413, "urn:semap:problem:too-large")


def test_a_document_that_is_not_in_utf8_is_refused(service: Service) -> None:
    answer = post(service, "/maps", json.dumps({"name": "x" * BESIDE_BYTES}).encode("utf-16"))
    assert (answer.status_code, "UTF-8" in answer.json()["detail"]) == (422, True)


def test_numbers_have_an_end_to_their_digits_and_texts_have_not(service: Service) -> None:
    for digits, number in (("9" * 4299, True), ("1." + "9" * 4299, True), ("9" * 400, False)):
        body = '{"name":[%s],"more":"%s"}' % (digits, "9" * BESIDE_BYTES)  # noqa: UP031
        answer = post(service, "/maps", body)
        assert (answer.status_code, "400 digits" in answer.json()["detail"]) == (422, number)


VALUES = st.recursive(
    st.none() | st.integers() | st.text(st.sampled_from('a"\\[{,\n'), max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=30,
)


def _count(value: object) -> int:
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return 1 + sum(_count(each) for each in inside)


@given(VALUES, st.integers(1, 80), st.integers(1, 5))
def test_values_are_counted_and_texts_are_not(value: object, most: int, at_once: int) -> None:
    """Never fewer than there are are let through as more; what texts hold does not count."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("semap_service.documents.json_values.MOST_VALUES", most)
        patched.setattr("semap_service.documents.json_values.TEXTS_AT_ONCE", at_once)
        try:
            require_few_values(json.dumps(value, ensure_ascii=False).encode())
        except TooLarge:
            assert _count(value) > most / 2
        else:
            assert _count(value) <= most + 1


def routes() -> Iterator[tuple[str, APIRoute]]:
    for module in app_module.RESOURCES:
        for route in module.router.routes:
            if isinstance(route, APIRoute):
                yield module.__name__, route


def test_what_takes_files_is_known_and_all_else_is_small() -> None:
    for path, methods in create_app("").openapi()["paths"].items():
        filled = "/".join("1" if part.startswith("{") else part for part in path.split("/"))
        for method, operation in methods.items():
            content = operation.get("requestBody", {}).get("content", {})
            if content:
                takes_files = "multipart/form-data" in content
                assert (UPLOADS.fullmatch(filled) is not None) == takes_files, (method, path)


def test_no_endpoint_of_the_loop_takes_a_document() -> None:
    for name, route in routes():
        if inspect.iscoroutinefunction(inspect.unwrap(route.endpoint)):
            assert route.body_field is None, f"{name}: {route.path}"


def _lists(schema: object) -> Iterator[dict[str, Any]]:
    if isinstance(schema, list | tuple):
        for each in schema:
            yield from _lists(each)
    elif isinstance(schema, dict):
        if schema.get("type") == "list":
            yield schema
        for each in schema.values():
            yield from _lists(each)


def test_every_list_that_is_sent_ends_at_its_first_fault() -> None:
    bodies = [route.body_field for _, route in routes() if route.body_field is not None]
    assert len(bodies) > 20
    for field in bodies:
        for schema in _lists(TypeAdapter(field.field_info.annotation).core_schema):
            assert schema.get("fail_fast"), field
    assert issubclass(operators.Question, Request)


@pytest.mark.parametrize(("size", "beside"), [(BESIDE_BYTES - 1, False), (BESIDE_BYTES, True)])
def test_what_is_large_is_answered_in_a_loop_of_its_own(size: int, beside: bool) -> None:
    seen: list[tuple[threading.Thread, asyncio.AbstractEventLoop, bytes]] = []

    async def inner(scope, receive, send) -> None:
        message = await receive()
        seen.append((threading.current_thread(), asyncio.get_running_loop(), message["body"]))
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"done"})

    body = b'"' + b"x" * (size - 2) + b'"'
    sent: list[dict] = []

    async def ask() -> None:
        parts = [body[:10], body[10:]]

        async def receive() -> dict:
            part = parts.pop(0)
            return {"type": "http.request", "body": part, "more_body": bool(parts)}

        async def send(message) -> None:
            assert threading.current_thread() is threading.main_thread()
            sent.append(message)

        await BoundedJson(inner)({"type": "http", "method": "POST", "path": "/maps"}, receive, send)
        ((thread, loop, received),) = seen
        assert received == body
        assert (loop is not asyncio.get_running_loop()) is beside
        assert (thread is not threading.main_thread()) is beside

    asyncio.run(ask())
    assert [each.get("status", each.get("body")) for each in sent] == [200, b"done"]


def test_the_description_is_made_in_a_thread(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    app: FastAPI = service.app
    made: list[threading.Thread] = []
    described = app.openapi

    def describe() -> dict:
        made.append(threading.current_thread())
        return described()

    monkeypatch.setattr(app, "openapi", describe)
    assert service.raw.put("/health").status_code == 405
    assert made == []
    for _ in range(3):
        assert service.raw.get("/openapi.json").json()["info"]["title"] == "semap"
    (thread,) = made
    assert thread.name.startswith("AnyIO")


def test_a_large_file_is_read_by_a_process_of_its_own(service: Service) -> None:
    room = {
        "type": "Feature",
        "properties": {"name": "hall", "height_m": 3, "note": "x" * 300_000},
        "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]},
    }
    plan = json.dumps({"type": "FeatureCollection", "features": [room]})
    made = service.client.post("/maps/import", files={"file": ("office.geojson", plan)})
    assert (made.status_code, made.headers["location"]) == (201, "/maps/office")
    assert made.json()["concepts"] == {"Room": 1}
    jobs = service.get("/jobs")["jobs"]
    assert [(each["kind"], each["state"]) for each in jobs] == [("map_import", "done")]
    broken = service.client.post("/maps/import", files={"file": ("broken.geojson", plan[:-1])})
    assert (broken.status_code, broken.json()["instance"]) == (422, "/maps/import")


@pytest.mark.parametrize(("part", "ends"), [(b"x", True), (b"x" * 20_000, False)], ids=["trickle", "flow"])
def test_a_body_that_trickles_is_given_up(monkeypatch: pytest.MonkeyPatch, part: bytes, ends: bool) -> None:
    """Ten seconds pass with each part, by the clock that it looks at."""
    ticks = itertools.count(0, 10)
    monkeypatch.setattr(
        "semap_service.http.body_limit.time", SimpleNamespace(monotonic=lambda: float(next(ticks)))
    )
    left = [part] * 40

    async def receive() -> dict:
        return {"type": "http.request", "body": left.pop(), "more_body": bool(left)}

    async def read_all(scope, receive, send) -> None:
        while (await receive())["more_body"]:
            pass

    async def send(message) -> None:
        raise AssertionError(message)

    reading = LimitedBody(read_all, stall_s=30)(
        {"type": "http", "method": "POST", "path": "/maps", "headers": []}, receive, send
    )
    if ends:
        with pytest.raises(HTTPException, match="408"):
            asyncio.run(reading)
        assert len(left) > 30
    else:
        asyncio.run(reading)
        assert left == []
