"""States of objects over HTTP: told once or twice, they are there once."""

from __future__ import annotations

import shapely
from running import Service

OPEN = {"instance": "Door07", "property": "door", "value": "open", "stamp": "2026-01-31T12:00:00Z"}
CLOSED = {**OPEN, "value": "closed", "stamp": "2026-01-31T12:00:05Z", "attributes": {"by": "hand"}}


def tell(service: Service, *states: dict, **more: object) -> object:
    told = {"map": "office", "source": "contacts", "states": list(states), **more}
    response = service.client.post("/object-states", json=told)
    return response.json().get("added", response.json()) if response.is_success else response


def test_states_are_told_and_listed(service: Service) -> None:
    service.make_map()
    door = service.make_room("Door07", shapely.box(0, 0, 1, 1))
    assert tell(service, CLOSED, OPEN, watermark="2026-01-31T12:00:06Z") == 2
    assert tell(service, OPEN, {**OPEN, "property": "light", "value": "on"}) == 1
    first, second, third = service.get("/object-states")["object_states"]
    assert first == {
        "id": 1, "uid": first["uid"], "map": "office", "source": "contacts", "instance_id": door["id"],
        "instance": "Door07", "property": "door", "value": "open", "previous": None, "since": None,
        "stamp": "2026-01-31T12:00:00.000000Z", "attributes": {},
    }  # fmt: skip
    assert second == {
        **first, "id": 2, "uid": second["uid"], "value": "closed", "previous": "open", "since": first["stamp"],
        "stamp": "2026-01-31T12:00:05.000000Z", "attributes": {"by": "hand"},
    }  # fmt: skip
    assert service.get("/object-states", property="light")["object_states"] == [third]
    assert service.get("/object-states", map="office", instance="Door07", limit=1, after=1) == {
        "object_states": [second], "next": 2,
    }  # fmt: skip
    assert service.plain.execute(
        "select name, watermark from semap.source where watermark = '2026-01-31T12:00:06Z'"
    ).fetchone()[0] == "contacts"  # fmt: skip


def test_what_cannot_be_told_changes_nothing(service: Service) -> None:
    service.make_map()
    service.make_room("Door07", shapely.box(0, 0, 1, 1))
    for states, status in (
        ([OPEN, {**OPEN, "instance": "Door08"}], 404),
        ([{**OPEN, "stamp": "2026-01-31T12:00:00"}], 422),
        ([{**OPEN, "stamp": "1700-01-01T00:00:00Z"}], 422),
        ([{**OPEN, "value": 1}], 422),
        ([{**OPEN, "attributes": {"text": "\0"}}], 422),
        ([{**OPEN, "property": ""}], 422),
        ([OPEN] * 1001, 422),
    ):
        refused = tell(service, *states)
        assert refused.status_code == status, refused.text
    assert tell(service, OPEN, map="nowhere").status_code == 404
    assert service.client.get("/object-states?map=nowhere").status_code == 404
    assert service.get("/object-states") == {"object_states": [], "next": None}
    assert service.plain.execute("select count(*) from semap.source").fetchone() == (0,)
