"""What requests about rules can be made to contain: refused, never a failure of the service."""

from __future__ import annotations

import json

import pytest
import shapely
from running import Service
from semap_service.routes import rule_runs

GOOD = {"input": "track_in_room", "emit": {"began": "entered"}}
DECLARATIONS: dict[str, str] = {
    "nothing": "{}",
    "no mapping": "[]",
    "null": "null",
    "wrong kinds": '{"input": {"query": ["a"]}, "emit": {"began": 5}}',
    "no key": '{"": 1}',
    "a number that is none": '{"input": "q", "emit": {"began": "e"}, "where": NaN}',
    "a long number": '{"input": "q", "pattern": "A", "emit": "e", "within": 1%s}' % ("0" * 5000),
    "a number of 4000 digits": '{"input": "q", "pattern": "A", "emit": "e", "within": 1%s}' % ("0" * 4000),
    "infinity": '{"input": "q", "pattern": "A", "emit": "e", "within": Infinity}',
    "large": '{"input": "q", "pattern": "A", "emit": "e", "within": 1e999}',
    "NUL": '{"input": "q", "pattern": "A", "emit": "e", "measures": {"m": "\'\\u0000\'"}}',
    "half a character": '{"input": "q", "pattern": "A", "emit": "e", "measures": {"m": "\'\\ud800\'"}}',
    "half a character as a key": '{"input": {"object_state": "d"}, "emit": {"\\ud800": "e"}}',
    "deep": '{"input": %s"q"%s}' % ("[" * 900, "]" * 900),  # noqa: UP031
    "too deep": '{"input": %s"q"%s}' % ("[" * 90_000, "]" * 90_000),  # noqa: UP031
    "many": json.dumps({"input": {"object_state": "d"}, "emit": {f"s{n}": "e" for n in range(20_000)}}),
    "long": json.dumps({**GOOD, "where": "x" * 500_000}),
    "in orders": json.dumps(
        {"input": "q", "emit": "e", "pattern": f"permute({', '.join('ABCDEFGHIJKLM')})", "within": 1}
    ),
}  # fmt: skip


def send(service: Service, method: str, path: str, body: str) -> int:
    answer = service.client.request(
        method, path, content=body.encode(), headers={"Content-Type": "application/json"}
    )
    return answer.status_code


@pytest.fixture
def office(service: Service) -> Service:
    service.make_map()
    return service


def test_declarations_that_are_none(office: Service) -> None:
    office.make_room("lab", shapely.box(0, 0, 4, 4))
    made = office.client.post(
        "/rules", json={"map": "office", "name": "good", "declaration": {**GOOD, "input": "door"}}
    )
    rule = made.json()
    for name, text in DECLARATIONS.items():
        added = '{"map": "office", "name": "r", "declaration": %s}' % text  # noqa: UP031
        assert send(office, "POST", "/rules", added) == 422, name
        assert send(office, "POST", "/rules/dry-run", added) == 422, name
    assert office.get("/rules", after=1)["rules"] == [rule]
    for name, text in DECLARATIONS.items():
        changed = send(office, "PATCH", f"/rules/{rule['id']}", '{"declaration": %s}' % text)  # noqa: UP031
        assert changed == (200 if name == "null" else 422), name  # null: it stays as it is
    assert office.get(f"/rules/{rule['id']}")["version"] == 1


def test_names_and_stamps_that_are_none(office: Service) -> None:
    declared = json.dumps(GOOD)
    for name in ('"a b"', '"\\u0000"', '"\\ud800"', '""', '"' + "n" * 101 + '"', "5", "null", '"\u00e4"'):
        body = '{"map": "office", "name": %s, "declaration": %s}' % (name, declared)  # noqa: UP031
        assert send(office, "POST", "/rules", body) == 422, name
        assert send(office, "POST", "/rules/dry-run", body) == 422, name
    for name in ('"\\u0000"', '"\\ud800"', '"nowhere"', "[]"):
        body = '{"map": %s, "name": "r", "declaration": %s}' % (name, declared)  # noqa: UP031
        assert send(office, "POST", "/rules", body) in (404, 422), name
        assert send(office, "POST", "/rules/dry-run", body) in (404, 422), name
    for stamp in ("0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59-23:59", "now", "2026-01-31T12:00:00"):
        for more in ({"from": stamp}, {"to": stamp}, {"from": stamp, "to": stamp}):
            body = json.dumps({"map": "office", "declaration": GOOD, **more})
            assert send(office, "POST", "/rules/dry-run", body) in (200, 422), stamp


def test_explanations_of_what_never_was(office: Service) -> None:
    pattern = {
        "input": ["door", "light"], "pattern": "A B", "partition_by": ["room", "attributes.x"], "emit": "e",
        "within": "36500 d",
    }  # fmt: skip
    made = office.client.post("/rules", json={"map": "office", "name": "r", "declaration": pattern})
    assert made.status_code == 201, made.text
    path = f"/rules/{made.json()['id']}/explanation"
    keys = (
        [],
        ["room=a"],
        ["room"],
        ["=", "=="],
        ["room=a", "attributes.x=\ud83d"[:-1]],
        ["x=" + "y" * 5000],
    )
    for at in (
        "2026-01-31T12:00:00Z",
        "1800-01-01T00:00:00Z",
        "9998-12-31T00:00:00Z",
        "0001-01-01T00:00:00Z",
        "?",
    ):
        for key in keys:
            answer = office.client.get(path, params={"at": at, "key": key})
            assert answer.status_code in (200, 422), answer.text
    for odd in ("0", "-1", "99999999999999999999", "x", "%00"):
        assert office.raw.get(f"/rules/{odd}/explanation", params={"at": keys}).status_code in (404, 422)
        assert office.raw.get(f"/rules/{odd}").status_code in (404, 422)
        assert office.raw.get(f"/rules/{odd}/versions").status_code in (404, 422)


def test_filters_that_are_none(office: Service) -> None:
    for path in ("/rules", "/object-states", "/events"):
        names = office.described["paths"][path]["get"]["parameters"]
        for parameter in names:
            for value in (
                "\0",
                "\ud800".encode("utf-8", "surrogatepass"),
                "9" * 400,
                "-1",
                "",
                "nan",
                "'; --",
            ):
                answer = office.raw.get(path, params={parameter["name"]: value})
                assert answer.status_code < 500, (path, parameter["name"], value, answer.text)


def test_a_rule_that_another_has_changed(office: Service) -> None:
    made = office.client.post(
        "/rules", json={"map": "office", "name": "r", "declaration": {**GOOD, "input": "door"}}
    )
    path = f"/rules/{made.json()['id']}"
    tag = office.client.get(path).headers["etag"]
    rests = office.client.patch(path, json={"enabled": False}, headers={"If-Match": tag})
    assert rests.status_code == 200
    for stale in (tag, '"x"', "W/" + tag):
        assert (
            office.client.patch(path, json={"enabled": True}, headers={"If-Match": stale}).status_code == 412
        )
        assert office.client.delete(path, headers={"If-Match": stale}).status_code == 412
    now = office.client.get(path)
    assert now.json()["enabled"] is False
    assert office.client.delete(path, headers={"If-Match": now.headers["etag"]}).status_code == 204


def test_a_dry_run_that_makes_too_much_or_takes_too_long(
    office: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    office.make_room("lab", shapely.box(0, 0, 4, 4))
    states = [
        {"instance": "lab", "property": "lamp", "value": str(n % 2), "stamp": f"2026-01-31T12:00:{n:02}Z"}
        for n in range(14)
    ]
    assert office.client.post(
        "/object-states", json={"map": "office", "source": "s", "states": states, "watermark": "2026-01-31T13:00:00Z"}
    ).is_success  # fmt: skip
    every = {
        "input": {"object_state": "lamp"}, "pattern": "A+ any followed by any B", "after_match": "no skip",
        "within": "1 h", "emit": "e",
    }  # fmt: skip
    monkeypatch.setattr(rule_runs, "MOST_MADE", 100)
    refused = office.client.post("/rules/dry-run", json={"map": "office", "declaration": every})
    assert (refused.status_code, "events" in refused.json()["detail"]) == (413, True)
    monkeypatch.setattr(rule_runs, "LONGEST_S", 0.0)
    once = {"input": {"object_state": "lamp"}, "emit": {"0": "off", "1": "on"}}
    refused = office.client.post("/rules/dry-run", json={"map": "office", "declaration": once})
    assert (refused.status_code, "takes longer" in refused.json()["detail"]) == (413, True)
