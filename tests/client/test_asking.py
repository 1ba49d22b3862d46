"""The client without a service: errors, pages, repeating, and that both clients are one."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from itertools import pairwise

import httpx
import pytest
from answering import Script, client_of, problem

from semap import AsyncClient, Client
from semap.client import NewObjectState, Table, Track
from semap.client import blocking as blocking_module
from semap.client.exchange import Lost, Pause, Plan, Request
from semap.client.retrying import patiently
from semap.client.values import Map
from semap.errors import (
    AccessRefused,
    ChangedMeanwhile,
    Conflict,
    InvalidInput,
    NotFound,
    SemapError,
    ServerUnavailable,
    ServiceUnreachable,
    TooLarge,
    TooManyRequests,
    UntrustedBytes,
)
from semap.timeline.stamp import parse_stamp, to_datetime

NOON = to_datetime(parse_stamp("2026-01-31T12:00:00Z"))
REFUSED = httpx.ConnectError("refused")
BROKEN = httpx.ReadError("the connection broke")


@pytest.fixture(autouse=True)
def slept(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The pauses of the client, which take no time here."""
    pauses: list[float] = []
    monkeypatch.setattr(blocking_module.time, "sleep", pauses.append)
    return pauses


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        (400, InvalidInput),
        (401, AccessRefused),
        (403, AccessRefused),
        (404, NotFound),
        (409, Conflict),
        (410, NotFound),
        (412, ChangedMeanwhile),
        (413, TooLarge),
        (418, SemapError),
        (422, InvalidInput),
        (429, TooManyRequests),
        (500, SemapError),
        (503, ServerUnavailable),
    ],
)
def test_a_problem_is_the_error_that_it_stands_for(status: int, kind: type[SemapError]) -> None:
    with pytest.raises(SemapError) as raised:
        client_of(Script([problem(status, "It is so.", "Do that.")]), retries=0).map("home")
    assert type(raised.value) is kind
    assert str(raised.value) == "It is so."
    assert raised.value.remedy == "Do that."


@pytest.mark.parametrize("content", [b"<html>Bad Gateway</html>", b"[1]", b"\xff", b"null", b""])
def test_an_error_without_a_problem_document_is_told_by_its_status(content: bytes) -> None:
    with pytest.raises(SemapError, match="status 502"):
        client_of(Script([httpx.Response(502, content=content)]), retries=0).maps()


@pytest.mark.parametrize("content", [b"<html>hello</html>", b'{"name": 3}', b"[]", b"", b"\xff"])
def test_an_answer_that_is_no_document_of_semap_is_not_trusted(content: bytes) -> None:
    with pytest.raises(UntrustedBytes):
        client_of(Script([httpx.Response(200, content=content)])).map("home")
    with pytest.raises(UntrustedBytes):
        client_of(Script([httpx.Response(200, content=content)])).maps()
    with pytest.raises(UntrustedBytes):
        client_of(Script([httpx.Response(200, content=content)])).shapes("home")
    with pytest.raises(UntrustedBytes):
        client_of(Script([httpx.Response(200, content=content)])).features("home", "Room")


def test_what_was_not_carried_out_is_asked_again_after_the_time_that_it_says(slept: list[float]) -> None:
    script = Script(
        [problem(429, Retry_After="7"), problem(503, Retry_After="2"), REFUSED, httpx.Response(200, json={})]
    )
    assert client_of(script).health() == {}
    assert len(script.asked) == 4
    assert 7 <= slept[0] <= 8.75
    assert 2 <= slept[1] <= 2.5
    assert 0.8 <= slept[2] <= 1.0


def test_what_may_have_been_carried_out_is_not_asked_twice() -> None:
    for reply in (BROKEN, problem(503)):
        script = Script([reply])
        with pytest.raises((ServiceUnreachable, ServerUnavailable)):
            client_of(script).create_map("home")
        assert len(script.asked) == 1
    for reply in (REFUSED, problem(429)):
        script = Script([reply])
        with pytest.raises((ServiceUnreachable, TooManyRequests)):
            client_of(script, retries=3).create_map("home")
        assert len(script.asked) == 4
    script = Script([BROKEN, httpx.Response(200, json={"added": 1})])
    state = NewObjectState("door", "door", "open", NOON)
    assert client_of(script).add_object_states("home", "contacts", [state]) == 1
    assert len(script.asked) == 2


def test_waits_grow_up_to_a_bound() -> None:
    def asking() -> Plan[None]:
        yield Request("GET", "/")

    plan = patiently(asking(), 12, spread=lambda: 0.0)
    steps = [next(plan)] + [plan.send(Lost("gone", unsent=True)) for _ in range(24)]
    waits = [step.seconds for step in steps if isinstance(step, Pause)]
    assert waits[:5] == [0.2, 0.4, 0.8, 1.6, 3.2]
    assert waits[5:] == [5.0] * 7
    assert [isinstance(step, Pause) for step in steps] == [False, True] * 12 + [False]


def test_lists_are_read_page_by_page_up_to_the_limit() -> None:
    names = [f"map {n:04}" for n in range(2500)]

    def answer(request: httpx.Request) -> httpx.Response:
        query = dict(request.url.params)
        rest = [name for name in names if name > query.get("after", "")][: int(query["limit"])]
        entries = [
            {"uid": "64971cef-b4ba-41c9-a3ed-2a6445a84c2c", "name": name, "instances": 0, "tracks": 0,
             "created_at": "2026-01-31T12:00:00Z", "cell_m": 4, "new_in_a_later_version": True}
            for name in rest
        ]  # fmt: skip
        return httpx.Response(
            200, json={"maps": entries, "next": rest[-1] if len(rest) == int(query["limit"]) else None}
        )

    client = client_of(answer)
    assert [each.name for each in client.maps()] == names
    assert [each.name for each in client.maps(limit=1001)] == names[:1001]
    assert len(client.maps(limit=0)) == 0
    first, second = client.maps(limit=2)
    assert first.created_at == NOON
    assert (first.name, second.name) == ("map 0000", "map 0001")


def test_the_token_goes_with_each_request_and_nowhere_else(monkeypatch: pytest.MonkeyPatch) -> None:
    script = Script([httpx.Response(200, json={})])
    client_of(script, token="semap_secret").health()
    monkeypatch.setenv("SEMAP_TOKEN", "semap_other")
    client_of(script).health()
    monkeypatch.delenv("SEMAP_TOKEN")
    client_of(script).health()
    assert [request.headers.get("authorization") for request in script.asked] == [
        "Bearer semap_secret",
        "Bearer semap_other",
        None,
    ]
    assert not any("secret" in str(request.url) for request in script.asked)
    with pytest.raises(InvalidInput) as raised:
        Client(token="semap_sécret\n")
    assert "semap_s" not in str(raised.value)


@pytest.mark.parametrize("url", ["localhost:8000", "ftp://host", "http://", "/x", "http://a:b"])
def test_an_address_that_is_none_is_said_at_once(url: str) -> None:
    with pytest.raises(InvalidInput, match="address"):
        Client(url)


def test_names_are_written_into_addresses_whole() -> None:
    script = Script([problem(404)])
    for name in ("a/b", "..", "a?b#c", "ü ü", "%2F"):
        with pytest.raises(NotFound):
            client_of(script).delete_map(name)
    paths = [request.url.raw_path.decode() for request in script.asked]
    assert paths == ["/maps/a%2Fb", "/maps/%2E%2E", "/maps/a%3Fb%23c", "/maps/%C3%BC%20%C3%BC", "/maps/%252F"]


def test_a_stamp_without_a_time_zone_is_refused() -> None:
    client = client_of(Script([httpx.Response(200, json={})]))
    naive = NOON.replace(tzinfo=None)
    with pytest.raises(InvalidInput, match="no time zone"):
        client.explain_rule(1, naive)
    with pytest.raises(InvalidInput, match="no time zone"):
        client.add_object_states("home", "s", [NewObjectState("d", "door", "open", naive)])


def test_a_file_that_is_not_there_is_said_before_anything_is_sent() -> None:
    script = Script([httpx.Response(200, json={})])
    for call in (lambda c: c.import_map("/nowhere.ifc"), lambda c: c.put_mesh(1, "/nowhere.stl")):
        with pytest.raises(InvalidInput, match=r"/nowhere\.\w+"):
            call(client_of(script))
    assert script.asked == []


def test_a_job_is_awaited_and_its_progress_told(tmp_path) -> None:
    (tmp_path / "home.geojson").write_text("{}")
    job = {"job_id": "7", "kind": "import", "message": "", "result": None, "problem": None,
           "created_at": "2026-01-31T12:00:00Z", "finished_at": None}  # fmt: skip
    report = {"map": "home", "concepts": {"Room": 2}, "doors": [], "findings": []}
    told: list[float] = []
    running = [
        httpx.Response(202, json={**job, "state": "waiting", "progress": 0}),
        httpx.Response(200, json={**job, "state": "running", "progress": 0.5}),
    ]
    done = httpx.Response(200, json={**job, "state": "done", "progress": 1, "result": report})
    client = client_of(Script([*running, done]))
    made = client.import_map(tmp_path / "home.geojson", progress=lambda each: told.append(each.progress))
    assert dict(made.concepts) == {"Room": 2}
    assert told == [0, 0.5, 1]
    failed = {"status": 422, "detail": "It is no GeoJSON.", "remedy": "Send another."}
    replies = [
        *running,
        httpx.Response(200, json={**job, "state": "failed", "progress": 0.5, "problem": failed}),
    ]
    with pytest.raises(InvalidInput, match=r"It is no GeoJSON\.") as raised:
        client_of(Script(replies)).import_map(tmp_path / "home.geojson")
    assert raised.value.remedy == "Send another."
    with pytest.raises(Conflict, match="cancelled"):
        client_of(
            Script([httpx.Response(202, json={**job, "state": "cancelled", "progress": 0})])
        ).import_map(tmp_path / "home.geojson")


def public(kind: type) -> dict[str, object]:
    return {name: inspect.getattr_static(kind, name) for name in dir(kind) if not name.startswith("_")}


def test_both_clients_have_the_same_operations() -> None:
    blocking, awaiting = public(Client), public(AsyncClient)
    assert blocking.keys() == awaiting.keys()
    plans = {name: getattr(each, "plan", None) for name, each in blocking.items()}
    assert plans == {name: getattr(each, "plan", None) for name, each in awaiting.items()}
    assert all(plan is None or plan.__doc__ for plan in plans.values())
    for name in ("events", "__init__"):
        given = [list(inspect.signature(getattr(kind, name)).parameters) for kind in (Client, AsyncClient)]
        assert given[0] == given[1]


def test_a_table_has_the_same_columns_whatever_is_in_it() -> None:
    columns = list(Table(Track, ()).to_pandas().columns)
    assert columns[:8] == ["id", "uid", "map", "source", "name", "live", "ended_at", "state_stamp"]
    track = {"id": 1, "uid": "64971cef-b4ba-41c9-a3ed-2a6445a84c2c", "map": "home", "source": "s", "name": "cat",
             "live": True, "ended_at": None, "state": None}  # fmt: skip
    state = {"stamp": "2026-01-31T12:00:00Z", "x_m": 1, "y_m": 2, "z_m": None, "std_m": None,
             "heading_rad": None, "speed_mps": None, "length_m": None, "width_m": None}  # fmt: skip
    answer = {"tracks": [track, {**track, "id": 2, "state": state}], "next": None}
    tracks = client_of(Script([httpx.Response(200, json=answer)])).tracks()
    assert list(tracks.to_pandas().columns) == columns
    assert columns[-2:] == ["concept", "attributes"]
    frame = tracks.to_geopandas()
    assert frame.geometry.isna().tolist() == [True, False]
    assert (frame.geometry[1].x, frame.geometry[1].y) == (1, 2)
    with pytest.raises(InvalidInput, match="no shapes"):
        Table(Map, ()).to_geopandas()
    assert tracks[0:1][0] == tracks[0]


def test_importing_semap_imports_neither_httpx_nor_pandas() -> None:
    code = "import sys, semap; print(sorted({'httpx', 'pydantic', 'pandas', 'numpy'} & set(sys.modules)))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "[]\n"
    code = "import sys; from semap import Client; print(sorted({'pandas', 'psycopg', 'sqlalchemy', 'fastapi'} & set(sys.modules)))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "[]\n"


def test_states_are_sent_in_parts_and_the_watermark_with_the_last() -> None:
    script = Script([httpx.Response(200, json={"added": 3})])
    states = [NewObjectState("door", "door", "open", NOON)] * 2001
    assert client_of(script).add_object_states("home", "contacts", states, watermark=NOON) == 9
    bodies = [json.loads(request.content) for request in script.asked]
    assert [len(body["states"]) for body in bodies] == [1000, 1000, 1]
    assert [body["watermark"] for body in bodies] == [None, None, NOON.isoformat()]
    assert all(left["source"] == right["source"] for left, right in pairwise(bodies))
