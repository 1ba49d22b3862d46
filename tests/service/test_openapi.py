"""The published description says what the service does. `service.client` checks each answer against it."""

import httpx
import pytest
import shapely
from running import PROBLEM, Service, box_mesh

METHODS = ("get", "post", "put", "patch", "delete")


def operations(described: dict) -> dict[str, dict]:
    return {
        operation["operationId"]: operation
        for methods in described["paths"].values()
        for method, operation in methods.items()
        if method in METHODS
    }


def test_every_endpoint_answers_as_published(service: Service) -> None:
    client = service.client
    service.make_map()
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3), height_m=2.5)
    service.make_room("Room08", shapely.box(4, 0, 8, 3))
    track_id = service.walk([(1, 1), (2, 2)])
    service.happen(1, 3)
    rooms = f"/rooms/{room['id']}"
    for path in [
        "/health",
        "/maps",
        "/maps/office",
        "/instances",
        "/rooms",
        "/tracks",
        "/relations",
        "/queries",
        "/rules",
        "/events",
        "/concepts",
    ]:
        client.get(path).raise_for_status()
    for path in (rooms, f"{rooms}/occupants", f"/tracks/{track_id}", f"/tracks/{track_id}/rooms"):
        client.get(path).raise_for_status()
    client.post("/concepts", json={"name": "Kitchen", "parent": "Room"}).raise_for_status()

    instance = f"/instances/{room['id']}"
    client.get(instance).raise_for_status()
    client.patch(instance, json={"alias": "kitchen"}).raise_for_status()
    mesh = {"mesh": ("a.stl", box_mesh(1, 1, 1, "stl"))}
    client.put(f"{instance}/mesh", files=mesh).raise_for_status()
    client.delete(instance).raise_for_status()

    rule = {"input": "track_in_room", "emit": {"began": "came"}}
    for kind, document, change in (
        ("queries", {"map": "office", "name": "q", "concept": "Door"}, {"enabled": False}),
        ("rules", {"map": "office", "name": "r", "declaration": rule}, {"enabled": False}),
    ):
        made = client.post(f"/{kind}", json=document)
        made.raise_for_status()
        where = made.headers["location"]
        assert client.get(where).json() == made.json()
        assert client.patch(where, json=change).json() == {**made.json(), "enabled": False}
        client.delete(where).raise_for_status()
        assert client.get(where).status_code == 404
    client.delete("/maps/office").raise_for_status()

    succeeded = {name for name, status in service.seen if status < 300}
    assert succeeded == set(operations(service.described))


def test_every_operation_is_described(service: Service) -> None:
    known = operations(service.described)
    assert len(known) == sum(
        method in METHODS for methods in service.described["paths"].values() for method in methods
    )
    for name, operation in known.items():
        assert operation["description"], name
        assert operation["summary"], name
        assert {"422", "500", "503"} <= set(operation["responses"]), name
        for status, response in operation["responses"].items():
            assert response["description"], (name, status)
            if int(status) >= 400:
                assert response["content"] == {PROBLEM: {"schema": {"$ref": "#/components/schemas/Problem"}}}
            elif status != "204":
                assert "$ref" in response["content"]["application/json"]["schema"], (name, status)
    assert not {"HTTPValidationError", "ValidationError"} & set(service.described["components"]["schemas"])


def test_all_references_lead_somewhere(service: Service) -> None:
    def references(part: object) -> set[str]:
        if isinstance(part, dict):
            own = {part["$ref"]} if isinstance(part.get("$ref"), str) else set()
            return own.union(*(references(each) for each in part.values()))
        return set().union(*(references(each) for each in part)) if isinstance(part, list) else set()

    schemas = service.described["components"]["schemas"]
    wanted = {reference.removeprefix("#/components/schemas/") for reference in references(service.described)}
    assert wanted <= set(schemas)


def test_the_index_leads_to_what_exists(service: Service) -> None:
    links = service.raw.get("/").json()["links"]
    assert {service.raw.get(link).status_code for link in links} == {200}


def test_the_documentation_loads_nothing_from_elsewhere(service: Service) -> None:
    page = service.raw.get("/docs").text
    assert "https://" not in page
    assert "http://" not in page
    for name in ("swagger-ui-bundle.js", "swagger-ui.css", "favicon.png"):
        assert f"/docs/files/{name}" in page
        assert service.raw.get(f"/docs/files/{name}").status_code == 200


@pytest.mark.parametrize(
    ("method", "path", "allow"),
    [
        ("PUT", "/maps", "GET, POST"),
        ("POST", "/instances/1", "DELETE, GET, PATCH"),
        ("POST", "/health", "GET"),
    ],
)
def test_a_wrong_method_is_told_the_right_ones(service: Service, method: str, path: str, allow: str) -> None:
    response = service.raw.request(method, path)
    assert (response.status_code, response.headers["allow"]) == (405, allow)
    assert response.headers["content-type"] == PROBLEM
    assert response.json()["type"] == "about:blank"
    assert response.json()["remedy"]


def test_an_unknown_path_is_a_problem(service: Service) -> None:
    response: httpx.Response = service.raw.get("/nothing")
    assert response.headers["content-type"] == PROBLEM
    assert response.json() == {
        "type": "about:blank",
        "title": "Not Found",
        "status": 404,
        "detail": "There is nothing at /nothing.",
        "instance": "/nothing",
        "remedy": "See / for what there is.",
        "errors": [],
    }
