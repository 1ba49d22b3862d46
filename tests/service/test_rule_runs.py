"""/rules/dry-run and /rules/{id}/explanation"""

from __future__ import annotations

import asyncio
import json
from collections.abc import MutableMapping
from typing import Any

import pytest
import shapely
from rule_work import await_progress, running_worker
from running import Service
from semap_service.routes import rule_runs
from world import World

from semap.certificate import verify
from semap.rules.matching import pattern_program

VISITS = {"input": "track_in_room", "emit": {"began": "came", "ended": "went"}}
STAYED = {
    "input": "track_in_room", "partition_by": ["track", "room"], "pattern": "B followed by L",
    "define": {"B": "type = 'began'", "L": "type = 'ended' and track <> 'bob'"}, "within": "10 s", "emit": "stay",
    "measures": {"stay_s": "seconds_between(first(B.stamp), last(L.stamp))"},
}  # fmt: skip


@pytest.fixture
def visits(world: World) -> World:
    """Ann and bob are in the kitchen for two seconds each."""

    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    for number, name in enumerate(("ann", "bob")):
        track = world.add_track(name)
        start_us = (10 + 20 * number) * 1_000_000
        world.add_states([(track, start_us, 1, 1, None), (track, start_us + 2_000_000, 9, 1, None)])
    return world


def test_a_dry_run_gives_the_events_that_would_be(visits: World, service: Service) -> None:
    asked = {"map": "world", "declaration": STAYED}
    answer = service.client.post("/rules/dry-run", json=asked).json()
    assert answer["count"] == 1
    (event,) = answer["events"]
    assert event["type"] == "stay"
    assert event["track"]["name"] == "ann"
    assert event["key"] == {"track": "ann", "room": "kitchen"}
    assert event["measures"] == {"stay_s": 2.0}
    assert [each["variable"] for each in event["evidence"]] == ["B", "L"]
    edges = {
        "map": "world",
        "declaration": VISITS,
        "from": "1970-01-01T00:00:20Z",
        "to": "1970-01-01T00:00:32Z",
    }
    answer = service.client.post("/rules/dry-run", json=edges).json()
    assert [(each["type"], each["track"]["name"]) for each in answer["events"]] == [("came", "bob")]
    assert visits.rows("select 1 from semap.event") == []


def test_a_dry_run_ends_when_whoever_asked_has_gone(visits: World, service: Service) -> None:
    """As the server tells the application: the body, and then that the connection is closed."""
    body = json.dumps({"map": "world", "declaration": VISITS}).encode()
    sent: list[MutableMapping[str, Any]] = []
    coming = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> dict[str, object]:
        return coming.pop(0) if coming else {"type": "http.disconnect"}

    async def send(message: MutableMapping[str, Any]) -> None:
        sent.append(message)

    headers = [(b"content-type", b"application/json"), (b"host", b"127.0.0.1")]
    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": "POST",
        "scheme": "http",
        "path": "/rules/dry-run",
        "raw_path": b"/rules/dry-run",
        "query_string": b"",
        "headers": headers,
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 80),
        "state": {},
    }
    asyncio.run(service.app(scope, receive, send))
    assert sent[0]["status"] == 413
    assert b"has gone" in b"".join(message.get("body", b"") for message in sent)


def test_a_dry_run_that_cannot_be(visits: World, service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = service.client.post("/rules/dry-run", json={"map": "world", "declaration": {"pattern": "A B"}})
    assert wrong.status_code == 422
    missing = service.client.post("/rules/dry-run", json={"map": "nowhere", "declaration": VISITS})
    assert missing.status_code == 404

    monkeypatch.setattr(rule_runs, "MOST_ROWS", 3)
    much = service.client.post("/rules/dry-run", json={"map": "world", "declaration": VISITS})
    assert much.status_code == 413
    assert "shorter span" in much.json()["remedy"]


def test_an_explanation_says_what_held_or_failed(visits: World, service: Service) -> None:
    new = {"map": "world", "name": "stays", "declaration": STAYED}
    rule_id = service.client.post("/rules", json=new).json()["id"]
    path = f"/rules/{rule_id}/explanation"

    def explained(track: str, at: str) -> dict:
        keys = [f"track={track}", "room=kitchen"]
        return service.client.get(path, params={"at": at, "key": keys}).json()

    why = explained("ann", "1970-01-01T00:00:12Z")
    assert why["found"]
    assert "  stay_s = 2" in [line.removesuffix(".0") for line in why["lines"]]
    why_not = explained("bob", "1970-01-01T00:00:32Z")
    assert not why_not["found"]
    assert any("track <> 'bob'" in line and line.strip().startswith("no") for line in why_not["lines"])
    assert service.client.get(path, params={"at": "1970-01-01T00:00:12Z"}).status_code == 422
    assert (
        service.client.get("/rules/99/explanation", params={"at": "1970-01-01T00:00:12Z"}).status_code == 404
    )


def test_a_certificate_over_all_keys_holds_by_itself(visits: World, service: Service) -> None:
    new = {"map": "world", "name": "stays", "declaration": STAYED}
    rule_id = service.client.post("/rules", json=new).json()["id"]
    span = {"from": "1970-01-01T00:00:05Z", "to": "1970-01-01T00:00:40Z"}
    document = service.client.get(f"/rules/{rule_id}/certificate", params=span).json()
    assert [(each["event"], each["measures"]) for each in document["events"]] == [("stay", {"stay_s": 2.0})]
    (attempt,) = document["attempts"]
    assert attempt["awaits"] == ["L"]
    said = verify(document)
    assert "An attempt came to nothing (track bob, room kitchen):" in said
    of_ann = service.client.get(f"/rules/{rule_id}/certificate", params={**span, "key": "track=ann"}).json()
    assert of_ann["attempts"] == []
    assert (
        service.client.get(f"/rules/{rule_id}/certificate", params={**span, "key": "x=1"}).status_code == 422
    )
    backwards = {"from": span["to"], "to": span["from"]}
    assert service.client.get(f"/rules/{rule_id}/certificate", params=backwards).status_code == 422


def test_what_is_given_up_is_told_with_the_rule_and_with_a_dry_run(
    visits: World, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pattern_program, "RUNS_AT_MOST", 1)
    together = {
        **STAYED, "partition_by": ["room"], "within": "1 h", "after_match": "skip to next row",
        "define": {"B": "type = 'began'", "L": "type = 'ended' and track = 'nobody'"},
    }  # fmt: skip
    answer = service.client.post("/rules/dry-run", json={"map": "world", "declaration": together}).json()
    lost = {"attempts": 1, "first": "1970-01-01T00:00:10.000000Z", "key": {"room": "kitchen"}, "matches": 0}
    assert (answer["count"], answer["given_up"]) == (0, lost)
    whole = {"map": "world", "declaration": STAYED}
    assert service.client.post("/rules/dry-run", json=whole).json()["given_up"] is None

    new = {"map": "world", "name": "together", "declaration": together}
    rule_id = service.client.post("/rules", json=new).json()["id"]
    assert service.client.get(f"/rules/{rule_id}").json()["given_up"] is None
    with running_worker(visits.dsn):
        visits.add_states([(visits.add_track(name), at_s * 1_000_000, 1, 1, None)
                           for name, at_s in (("cat", 100), ("dan", 110))])  # fmt: skip
        visits.run("update semap.source set watermark = to_timestamp(200)")
        await_progress(visits.dsn)
    lost["first"] = "1970-01-01T00:01:40.000000Z"
    told = service.client.get(f"/rules/{rule_id}")
    assert told.json()["given_up"] == lost
    assert {each["name"]: each["given_up"] for each in service.client.get("/rules?map=world").json()["rules"]} == {
        "room_visits": None, "together": lost,
    }  # fmt: skip
    explained = service.client.get(
        f"/rules/{rule_id}/explanation", params={"at": "1970-01-01T00:01:40Z", "key": ["room=kitchen"]}
    ).json()
    assert "  It was given up: too much was under way in this key." in explained["lines"]
    assert explained["lines"][-1].startswith(
        "Since version 1 is in force: It gave up 1 attempt, as more than"
    )
    headers = {"If-Match": told.headers["etag"]}
    path = f"/rules/{rule_id}"
    assert service.client.patch(path, json={"enabled": False}, headers=headers).status_code == 200


def test_a_moment_where_nothing_was_found_is_not_answered_with_another_match(
    visits: World, service: Service
) -> None:
    """Ann's stay is within the window of the moment; at the moment itself there was nothing."""
    new = {"map": "world", "name": "stays", "declaration": {**STAYED, "within": "1 min"}}
    path = f"/rules/{service.client.post('/rules', json=new).json()['id']}/explanation"
    key = {"key": ["track=ann", "room=kitchen"]}
    answer = service.client.get(path, params={"at": "1970-01-01T00:00:30Z", **key}).json()
    assert not answer["found"]
    assert answer["lines"][-1] == "The nearest that it found: stay at 1970-01-01T00:00:12Z."
    assert answer["lines"][1].startswith("it found nothing")
