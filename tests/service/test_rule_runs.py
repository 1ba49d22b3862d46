"""/rules/dry-run and /rules/{id}/explanation"""

from __future__ import annotations

import pytest
import shapely
from running import Service
from semap_service.routes import rule_runs
from world import World

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
