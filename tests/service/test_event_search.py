"""What happened, found by its time and by what it is about, however pages are cut; against plain Python."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from random import Random
from typing import Any
from uuid import UUID

import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from running import Service

from semap.store.event import event_search

FIRST = datetime(2026, 1, 5, 9, tzinfo=UTC)
TYPES = ("entered", "left_then_closed", "Öffnete")
PEOPLE = ("Bob", "Bo", "Ännchen", None)
ROOMS = ("kitchen", "hall")


@pytest.fixture
def events(service: Service) -> list[dict[str, Any]]:
    """Of which many have one stamp, so that their order is that of their numbers."""
    service.make_map()
    service.make_map("annex")
    rooms = {name: service.make_room(name, shapely.box(0, 0, 4, 3))["id"] for name in ROOMS}
    dice = Random(7)
    made = []
    for seq in range(1, 121):
        one = {
            "seq": seq, "event_id": str(UUID(int=seq)), "map": "annex" if seq % 10 == 0 else "office", "type": dice.choice(TYPES),
            "stamp": FIRST + timedelta(minutes=dice.randrange(20)), "track": dice.choice(PEOPLE), "room": dice.choice((*ROOMS, None)),
            "key": dice.choice(({}, {"room": "kitchen"}, {"gate": 4})), "measures": dice.choice(({}, {"who": "Bob"}, {"gap_s": 1.5})),
        }  # fmt: skip
        made.append(one)
        service.plain.execute(
            "insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, since, track_id, track_name,"
            " instance_id, instance_name, key, measures) select %(seq)s, %(event_id)s, map_id, 'visits', 1, %(type)s, %(stamp)s,"
            " %(stamp)s, case when %(track)s::text is null then null else 3 end, %(track)s, %(room_id)s, %(room)s, %(key)s, %(measures)s"
            " from semap.map where name = %(map)s",
            {**one, "room_id": rooms.get(one["room"] or ""), "key": json.dumps(one["key"]), "measures": json.dumps(one["measures"])},
        )  # fmt: skip
    service.client.patch(f"/instances/{rooms['hall']}", json={"alias": "Lobby"}).raise_for_status()
    return made


def is_wanted(one: dict[str, Any], asked: dict[str, Any]) -> bool:
    values = [*one["key"].values(), *one["measures"].values()]
    said = [
        one["type"],
        one["type"].replace("_", " "),
        "visits",
        one["track"] or "",
        one["room"] or "",
        *map(str, values),
    ]
    if one["room"] == "hall":
        said.append("Lobby")
    return (
        one["map"] == "office"
        and ("type" not in asked or one["type"] == asked["type"])
        and ("track" not in asked or one["track"] == asked["track"] or asked["track"] in values)
        and ("instance" not in asked or one["room"] == asked["instance"] or asked["instance"] in values)
        and all(any(word in each.lower() for each in said) for word in asked.get("text", "").lower().split())
        and asked.get("from", FIRST) <= one["stamp"] <= asked.get("to", FIRST + timedelta(days=1))
    )  # fmt: skip


ASKED = st.fixed_dictionaries(
    {},
    optional={
        "type": st.sampled_from([*TYPES, "never"]),
        "track": st.sampled_from(["Bob", "Bo", "nobody"]),
        "instance": st.sampled_from([*ROOMS, "nowhere"]),
        "text": st.sampled_from(["bob", "LOBBY", "then closed", "kitchen bob", "öffnete", "1.5", "visits", "%", "x_"]),
        "from": st.integers(0, 20).map(lambda m: FIRST + timedelta(minutes=m)),
    },
)  # fmt: skip


def paged(service: Service, asked: dict[str, Any], limit: int) -> list[int]:
    found, before = [], {}
    while True:
        parameters = {**asked, **before, "limit": limit}
        if "from" in asked:
            parameters["from"] = asked["from"].isoformat()
        page = service.client.get("/maps/office/events", params=parameters)
        page.raise_for_status()
        found += [each["seq"] for each in page.json()["events"]]
        if page.json()["next"] is None:
            return found
        before = {"before": page.json()["next"]}


def test_found_is_what_is_wanted_newest_first(
    service: Service, events: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    ordered = sorted(events, key=lambda one: (one["stamp"], one["seq"]), reverse=True)

    @settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(ASKED, st.integers(1, 120), st.integers(1, 130))
    def check(asked: dict[str, Any], limit: int, looked_at: int) -> None:
        monkeypatch.setattr(event_search, "LOOKED_AT", looked_at)
        assert paged(service, asked, limit) == [one["seq"] for one in ordered if is_wanted(one, asked)]

    check()


def test_what_cannot_be_asked_is_said(service: Service, events: list[dict[str, Any]]) -> None:
    ask = service.client.get
    assert ask("/maps/nowhere/events").status_code == 404
    later = {"from": "2026-01-06T00:00:00Z", "to": "2026-01-05T00:00:00Z"}
    for wrong in (later, {"before": "12"}, {"before": "-" + "9" * 17 + ".1"}, {"text": "\x00"}):
        assert ask("/maps/office/events", params=wrong).status_code == 422
