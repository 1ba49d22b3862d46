"""A token for one map: on it, everything that its scopes say; elsewhere, nothing."""

from __future__ import annotations

import json

import httpx
import pytest
import shapely
from guarded import Building
from shapely.geometry import mapping

RULE = {"input": "track_in_room", "emit": {"began": "came"}}
SEEN = {"instance": "annex room", "property": "light", "value": "on", "stamp": "2026-01-31T12:00:00Z"}


def made(answer: httpx.Response) -> str:
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def test_a_writer_of_one_map_edits_all_of_it(building: Building) -> None:
    with building.service.client("annex", **{"Semap-Author": "ann"}) as client:
        square = json.loads(json.dumps(mapping(shapely.box(6, 0, 8, 2))))
        document = {"name": "den", "concept": "Room", "footprint": square, "height_m": 2.5}
        room = made(client.post("/maps/annex/instances", files={"document": (None, json.dumps(document))}))
        frame = made(client.post("/maps/annex/frames", json={"name": "dock"}))
        assert client.post(f"{frame}/poses", json={"pose": {"x_m": 1}}).status_code == 201
        blueprint = made(client.post("/maps/annex/descriptions", json={"name": "box"}))
        rule = made(client.post("/rules", json={"map": "annex", "name": "r", "declaration": RULE}))
        query = made(client.post("/queries", json={"map": "annex", "name": "q", "concept": "Door"}))
        assert client.patch(room, json={"alias": "hole"}).json()["alias"] == "hole"
        assert client.patch(frame, json={"name": "pier"}).status_code == 200
        assert client.get(f"{rule}/explanation?at=1970-01-01T00:00:02Z").status_code == 200
        dry = client.post("/rules/dry-run", json={"map": "annex", "declaration": RULE})
        assert (dry.status_code, dry.json()["count"]) == (200, 1)
        states = {"map": "annex", "source": "lights", "states": [SEEN]}
        assert client.post("/object-states", json=states).json() == {"added": 1}
        tags = {"source": "tags", "states": [{"track": "a", "stamp": SEEN["stamp"], "x_m": 1.0, "y_m": 1.0}]}
        assert client.post("/maps/annex/states", json=tags).json()["accepted"] == 1
        changes = client.get("/maps/annex/changes").json()["changes"]
        assert changes[0]["author"] == "ann (annex)"
        made(client.post(f"/changes/{changes[0]['id']}/undo"))
        assert client.get(frame).json()["name"] == "dock"
        for each in (rule, query, room, frame, blueprint):
            assert client.delete(each).status_code == 204, each
        assert client.get("/maps/annex/export?format=geojson").status_code == 200


def test_the_past_of_a_map_is_told_to_a_caller_of_one_map_as_to_all(building: Building) -> None:
    """With the names of concepts, whose versions belong to no map."""
    with building.service.client("annex") as client, building.service.client("admin") as admin:
        for each in ({"map": "annex"}, {"map": "annex", "limit": 1}):
            told = [
                by.get("/instances", params={**each, "as_of": "2100-01-01T00:00:00Z"})
                for by in (client, admin)
            ]
            assert told[0].json() == told[1].json()
            (room,) = told[0].json()["instances"]
            assert room["concept"] == "Room"
        past = {"as_of": "2100-01-01T00:00:00Z"}
        assert client.get(f"/instances/{room['id']}", params=past).json()["concept"] == "Room"
        assert client.get(f"/instances/{building.ids['instance']}", params=past).status_code == 404


def test_an_operator_answers_a_caller_of_one_map_as_it_answers_all(building: Building) -> None:
    with building.service.client("annex") as client, building.service.client("admin") as admin:
        for operator, question in (
            ("nearest", {"references": {"names": ["annex room"]}}),
            ("topology", {"parameters": {"predicate": "disjoint"}}),
            ("in_area", {"parameters": {"area": mapping(shapely.box(-1, -1, 5, 5))}}),
        ):
            path = f"/maps/annex/operators/{operator}"
            assert client.post(path, json=question).text == admin.post(path, json=question).text, operator
            assert client.post(path.replace("annex", "office"), json=question).status_code == 404
        filtered = {"references": {"filter": "S_INTERSECTS(footprint, POINT(1 1))"}}
        for each in (client, admin):
            answer = each.post("/maps/annex/operators/size", json=filtered)
            assert answer.status_code in (200, 404), answer.text


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/rules", {"map": "office", "name": "r", "declaration": RULE}),
        ("/queries", {"map": "office", "name": "q", "concept": "Door"}),
        ("/rules/dry-run", {"map": "office", "declaration": RULE}),
        ("/object-states", {"map": "office", "source": "s", "states": []}),
        ("/maps/office/states", {"source": "s", "states": []}),
        ("/maps/office/frames", {"name": "f"}),
        ("/maps/office/descriptions", {"name": "d"}),
    ],
)
def test_a_map_that_is_named_in_a_body_is_not_there_either(building: Building, path: str, body: dict) -> None:
    with building.service.client("annex") as client, building.service.client("admin") as admin:
        answer = client.post(path, json=body)
        nowhere = client.post(
            path.replace("office", "nowhere"), json={**body, **({"map": "nowhere"} if "map" in body else {})}
        )
        assert answer.status_code == nowhere.status_code == 404
        told = [{**each.json(), "instance": "", "request_id": ""} for each in (answer, nowhere)]
        assert json.dumps(told[0]).replace("office", "nowhere") == json.dumps(told[1])
        assert admin.get("/maps/office").status_code == 200


def test_things_of_two_maps_are_not_put_together(building: Building) -> None:
    """By ids, which can be guessed."""
    ids = building.ids
    with building.service.client("annex") as client:
        document = {"name": "x", "concept": "Room", "description": ids["description"], "frame": ids["frame"]}
        for wanted in (document, {"name": "x", "concept": "Thing", "description": "office lamp"}):
            answer = client.post("/maps/annex/instances", files={"document": (None, json.dumps(wanted))})
            assert answer.status_code in (404, 422), answer.text
        answer = client.post("/maps/annex/operators/nearest", json={"references": {"ids": [ids["instance"]]}})
        assert (answer.status_code, answer.json()["rows"]) == (200, [])
        assert client.post(f"/instances/{ids['instance']}/copy", json={"name": "y"}).status_code == 404
