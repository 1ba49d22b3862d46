"""The published description says what the service does. `service.client` checks each answer against it."""

import json
import re
from pathlib import Path
from typing import Any

import httpx
import pytest
import shapely
from rule_work import running_worker
from running import PROBLEM, Service, box_mesh
from semap_service import demo
from semap_service.documents.asyncapi import asyncapi
from semap_service.serving.document_schemas import document_schemas

OFFICE = Path(demo.__file__).parent / "office.geojson"
DESCRIBED = (
    "application/geo+json",
    "application/schema+json",
    "application/vnd.oai.openapi+json;version=3.0",
    "application/cloudevents-batch+json",
    "text/event-stream",
)
"""Formats of others that have a schema here."""

METHODS = ("get", "post", "put", "patch", "delete")


def operations(described: dict) -> dict[str, dict]:
    return {
        operation["operationId"]: operation
        for methods in described["paths"].values()
        for method, operation in methods.items()
        if method in METHODS
    }


def test_every_endpoint_answers_as_published(service: Service, database: str) -> None:
    client = service.client
    service.make_map()
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3), height_m=2.5)
    service.make_room("Room08", shapely.box(4, 0, 8, 3))
    track_id = service.walk([(1, 1), (2, 2)])
    service.happen(1, 3)
    rooms = f"/rooms/{room['id']}"
    for path in [
        "/health",
        "/caller",
        "/metrics",
        "/asyncapi.json",
        "/schemas/event",
        "/rule-templates",
        "/maps",
        "/maps/office",
        "/instances",
        "/rooms",
        "/doors",
        "/tracks",
        "/track-amendments",
        "/sources",
        "/relations",
        "/queries",
        "/queries/1/result",
        "/rules",
        "/object-states",
        "/events",
        "/maps/office/events?text=room&limit=2",
        "/concepts",
    ]:
        client.get(path).raise_for_status()
    track = f"/tracks/{track_id}"
    way = f"{track}/path?from=2026-01-31T12:00:00Z&to=2026-01-31T12:00:09Z"
    use = f"{rooms}/occupancy?from=2026-01-31T00:00:00Z&to=2026-02-01T00:00:00Z&zone=Europe/Berlin"
    for path in (rooms, f"{rooms}/occupants", use, track, f"{track}/rooms", f"{track}/stays", way):
        client.get(path).raise_for_status()
    for path in geographic_paths(service, room["id"], track_id):
        client.get(path).raise_for_status()
    seen = {"instance": "Room08", "property": "light", "value": "on", "stamp": "2026-01-31T12:00:00Z"}
    client.post(
        "/object-states", json={"map": "office", "source": "lights", "states": [seen]}
    ).raise_for_status()
    came = {"track": "cat", "stamp": "2026-01-31T12:00:00Z", "x_m": 1, "y_m": 1}
    client.post("/maps/office/states", json={"source": "tags", "states": [came]}).raise_for_status()
    client.post("/concepts", json={"name": "Kitchen", "parents": ["Room"]}).raise_for_status()

    exercise_the_map(client)
    client.patch(f"/tracks/{track_id}", json={"attributes": {"kind": "forklift"}}).raise_for_status()
    source = f"/sources/{client.get('/sources').json()['sources'][0]['id']}"
    assert client.patch(source, json={"jump_m": None}).json() == client.get(source).json()

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
        if kind == "rules":
            client.get(f"{where}/versions").raise_for_status()
            client.get(f"{where}/text").raise_for_status()
            written = {"text": "name: s\ninput: track_in_room\nemit: {began: came}\n"}
            client.post("/maps/office/rules/check", json=written).raise_for_status()
            client.get(f"{where}/explanation?at=2026-01-31T12:00:00Z").raise_for_status()
            client.get(f"{where}/certificate?from=2026-01-31T12:00:00Z").raise_for_status()
            dry = {"map": "office", "declaration": rule}
            client.post("/rules/dry-run", json=dry).raise_for_status()
            client.post("/rule-templates/dwell/text", json={}).raise_for_status()
            client.get("/maps/office/rule-words").raise_for_status()
        client.delete(where).raise_for_status()
        assert client.get(where).status_code == 404
    exercise_queries(service)
    exercise_webhooks_and_jobs(service)
    exercise_tokens(service)
    exercise_what_goes_on(service, database)
    client.delete("/maps/office").raise_for_status()

    succeeded = {name for name, status in service.seen if status < 300}
    published = operations(service.described).items()
    assert succeeded == {name for name, operation in published if "operators" not in operation["tags"]}


def exercise_queries(service: Service) -> None:
    """What they do is tried in tests/relation; here, that all that can be asked is told again."""
    asked = {
        "name": "near",
        "predicate": "within_distance",
        "subject": {"kind": "track", "concept": None, "uids": None, "where": "source = 'tracker'"},
        "object": {"kind": "instance", "concept": "Room", "uids": None, "where": "attributes.seats > 4 and name like 'R%'"},
        "distance_m": 1.5,
        "abstraction": "FootprintHull",
        "dimensions": 2,
        "debounce": {
            "enter_margin_m": 0.1, "leave_margin_m": 0.2, "enter_confirm_s": 1.0, "leave_confirm_s": 2.5
        },
        "certainty": {"enter": 0.95, "leave": 0.2, "widest_std_m": 2.0},
        "between_samples": {"longest_gap_s": 10.0, "fastest_mps": 3.0},
    }  # fmt: skip
    made = service.client.post("/queries", json={"map": "office", "name": "near", "concept": "Door"})
    where = made.raise_for_status().headers["location"]
    found = service.client.put(where, json=asked).raise_for_status().json()
    said = {
        **found,
        **{side: {**found[side], "where": asked[side]["where"]} for side in ("subject", "object")},
    }
    assert {name: said[name] for name in asked} == asked
    assert found["subject"]["where"] == {"op": "=", "args": [{"property": "source"}, "tracker"]}
    assert (
        service.client.put(where, json=found | {"object": {"where": found["object"]["where"]}}).status_code
        == 422
    )
    service.client.delete(where).raise_for_status()
    sql = "select r.name, t.name from track t, room r where st_contains(r.footprint, t.position)"
    written = {"map": "office", "name": "in sql", "sql": sql, "debounce": {"enter_margin_m": 0.1}}
    told = service.client.post("/queries", json=written).raise_for_status().json()
    assert (told["sql"], told["predicate"], told["concept"]) == (sql, "contains", "Room")
    assert told["payload"] == {"room_name": "object.name", "track_name": "subject.name"}
    assert service.client.post("/queries", json=written | {"predicate": "covers"}).status_code == 422
    refused = service.client.post("/queries", json=written | {"name": "n", "sql": sql + " group by 1"}).json()
    assert "line 1, column" in refused["detail"]


def exercise_tokens(service: Service) -> None:
    client = service.client
    made = client.post("/tokens", json={"name": "robot", "scopes": ["ingest"]})
    made.raise_for_status()
    where = made.headers["location"]
    assert client.get("/tokens").json()["tokens"] == [client.get(where).json()]
    client.delete(where).raise_for_status()


def exercise_what_goes_on(service: Service, database: str) -> None:
    """A stream that does not end, of which its beginning is read; and a service that has a worker."""
    with service.client.stream("GET", "/events/stream", params={"after": 0}) as response:
        assert next(each for each in response.iter_lines() if each.startswith("event")) == "event: hello"
    with running_worker(database):
        service.until(lambda: service.client.get("/ready").status_code == 200)


def exercise_webhooks_and_jobs(service: Service) -> None:
    """What they do is tried in test_webhook_delivery and test_jobs; here, that it is as published."""
    client = service.client
    made = client.post("/webhooks", json={"url": "http://127.0.0.1:9/"})
    where = made.raise_for_status().headers["location"]
    client.patch(where, json={"state": "paused"}).raise_for_status()
    letter = service.plain.execute(
        "insert into semap.webhook_dead_letter"
        " (webhook_id, seq, event_id, map, type, body, attempts, error) values"
        " (%s, 1, gen_random_uuid(), 'office', 'entered', '{}', 1, '') returning webhook_dead_letter_id",
        [made.json()["id"]],
    ).fetchone()
    for path in ("secret", "ping", f"dead-letters/{letter[0]}/resend", "dead-letters/resend"):
        client.post(f"{where}/{path}", json={}).raise_for_status()
    for path in ("/webhooks", where, f"{where}/dead-letters", "/jobs"):
        client.get(path).raise_for_status()
    client.delete(f"{where}/dead-letters").raise_for_status()
    client.delete(where).raise_for_status()
    line = {"file": ("a.ndjson", b'{"name": "vase", "concept": "Thing"}')}
    client.post("/maps/office/instances/import", files=line).raise_for_status()
    later = {"Prefer": "respond-async"}
    job = client.post("/maps/office/instances/import", files=line, headers=later).headers["location"]
    client.delete(job).raise_for_status()
    client.get(job, params={"wait": 1}).raise_for_status()


def geographic_paths(service: Service, room_id: int, track_id: int) -> list[str]:
    """OGC API, looking back, and where things are."""
    track = f"/collections/office.tracks/items/{track_id}"
    piece = service.get(f"{track}/tgsequence")["geometrySequence"][0]["id"]
    of_rooms = "/collections/office.Room"
    return [
        "/",
        "/conformance",
        "/api",
        "/collections",
        of_rooms,
        *(f"{of_rooms}/{each}" for each in ("queryables", "sortables", "items", f"items/{room_id}")),
        f"{track}/tgsequence/{piece}",
        f"{track}/tgsequence/{piece}/velocity",
        f"{track}/tproperties",
        f"{track}/tproperties/speed_mps",
        f"/tracks/{track_id}/history",
        "/maps/office/extent",
        "/maps/office/moment?at=2026-01-31T12:00:01Z",
        "/maps/office/timeline?from=2026-01-31T12:00:00Z&to=2026-01-31T12:00:01Z",
        f"/instances/{room_id}/where",
        f"/instances/{room_id}/relations",
        f"/route?from=track:{track_id}&to={room_id}",
    ]


def exercise_the_map(client: httpx.Client) -> None:
    """Frames, descriptions, anchor, grids, history, exchange: each endpoint once, with success."""

    def made(response: httpx.Response) -> str:
        response.raise_for_status()
        return response.headers["location"]

    frame = made(client.post("/maps/office/frames", json={"name": "dock"}))
    blueprint = made(client.post("/maps/office/descriptions", json={"name": "lamp"}))
    box = {"mesh": ("a.stl", box_mesh(1, 1, 1, "stl"))}
    bulb = {"type": "POINT3D", "shape": {"type": "Point", "coordinates": [0, 0, 1]}}
    document = {"document": (None, '{"name": "lamp", "concept": "Thing", "description": "lamp"}')}
    lamp = made(client.post("/maps/office/instances", files=document))
    yaml = b"image: g.pgm\nresolution: 1\norigin: [0, 0]\n"
    grid = {"image": ("g.pgm", b"P5\n1 1\n255\n\0"), "yaml": ("g.yaml", yaml)}
    garden = OFFICE.read_bytes()
    for method, path, arguments in (
        ("PATCH", frame, {"json": {"name": "harbour"}}),
        ("GET", frame, {}),
        ("POST", f"{frame}/poses", {"json": {"pose": {"x_m": 1}}}),
        ("GET", f"{frame}/poses", {}),
        ("GET", "/maps/office/frames", {}),
        ("GET", "/maps/office/transform?target=map&source=harbour", {}),
        ("DELETE", frame, {}),
        ("PUT", f"{blueprint}/geometries/Bulb", {"json": bulb}),
        ("PUT", f"{blueprint}/geometries/Body/mesh", {"files": box}),
        ("GET", f"{blueprint}/geometries/Body", {}),
        ("GET", f"{blueprint}/abstractions/BoundingBox", {}),
        ("GET", f"{lamp}/abstractions/Footprint", {}),
        ("DELETE", f"{blueprint}/geometries/Bulb", {}),
        ("POST", f"{lamp}/copy", {"json": {"name": "torch"}}),
        ("PATCH", blueprint, {"json": {"name": "light"}}),
        ("GET", blueprint, {}),
        ("GET", "/maps/office/descriptions", {}),
        ("PUT", "/maps/office/anchor", {"json": {"epsg": 25832}}),
        ("GET", "/maps/office/anchor", {}),
        ("DELETE", "/maps/office/anchor", {}),
        ("PUT", "/maps/office/grids/g", {"files": grid}),
        ("GET", "/maps/office/grids", {}),
        ("GET", "/maps/office/grids/g", {}),
        ("DELETE", "/maps/office/grids/g", {}),
        ("GET", "/concepts/Kitchen", {}),
        ("PATCH", "/concepts/Kitchen", {"json": {"comment": "where one cooks"}}),
        ("DELETE", "/concepts/Kitchen", {}),
        ("GET", "/maps/office/changes", {}),
        ("GET", "/maps/office/export", {}),
        ("POST", "/maps/import?name=garden", {"files": {"file": ("garden.geojson", garden)}}),
        ("DELETE", blueprint, {}),
    ):
        client.request(method, path, **arguments).raise_for_status()
    newest = client.get("/maps/office/changes?limit=1").json()["changes"][0]["id"]
    client.get(f"/changes/{newest}").raise_for_status()
    client.post(f"/changes/{newest}/undo").raise_for_status()


def is_documented(content: dict) -> bool:
    """Whether JSON is a document of the components or one of several, and all else is a file."""

    def is_document(schema: dict) -> bool:
        return "$ref" in schema or all("$ref" in each for each in schema.get("anyOf", [{}]))

    return bool(content) and all(
        is_document(each["schema"])
        if media_type == "application/json"
        else "schema" not in each or media_type in DESCRIBED
        for media_type, each in content.items()
    )


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
            if status == "304":
                assert "content" not in response, name
            elif int(status) >= 400:
                assert response["content"] == {PROBLEM: {"schema": {"$ref": "#/components/schemas/Problem"}}}
            elif status != "204":
                assert is_documented(response["content"]), (name, status)
    assert not {"HTTPValidationError", "ValidationError"} & set(service.described["components"]["schemas"])


def test_what_the_tests_hold_answers_against_is_published(service: Service) -> None:
    assert service.raw.get("/openapi.json").json() == service.described


def test_all_references_lead_somewhere(service: Service) -> None:
    def references(part: object) -> set[str]:
        if isinstance(part, dict):
            own = {part["$ref"]} if isinstance(part.get("$ref"), str) else set()
            return own.union(*(references(each) for each in part.values()))
        return set().union(*(references(each) for each in part)) if isinstance(part, list) else set()

    schemas = service.described["components"]["schemas"]
    wanted = {reference.removeprefix("#/components/schemas/") for reference in references(service.described)}
    assert wanted <= set(schemas)


def test_no_name_of_a_schema_says_in_which_file_it_is_written(service: Service) -> None:
    """FastAPI puts the module before the name where two documents have the same one."""
    schemas = service.app.openapi()["components"]["schemas"]
    assert [name for name in schemas if "__" in name] == []


def without_examples(part: Any) -> Any:
    """FastAPI leaves out those within a schema."""
    if isinstance(part, dict):
        return {name: without_examples(each) for name, each in part.items() if name != "examples"}
    return [without_examples(each) for each in part] if isinstance(part, list) else part


def test_the_documents_of_rest_and_of_the_feeds_are_one_schema(service: Service) -> None:
    rest = service.app.openapi()["components"]["schemas"]
    feeds = asyncapi("localhost", secure=False)["components"]["schemas"]
    assert {"EventDocument", "ShownDoorDocument"} <= rest.keys() & feeds.keys()
    described = document_schemas()["$defs"]
    assert described.keys() == rest.keys() | feeds.keys()
    for name in rest.keys() & feeds.keys():
        both = (without_examples(each[name]) for each in (rest, feeds))
        assert next(both) == next(both), name
    references = set(re.findall(r'"\$ref": "#/\$defs/([^"]+)"', json.dumps(described)))
    assert references
    assert references <= described.keys()


def test_the_index_leads_to_what_exists(service: Service) -> None:
    links = service.raw.get("/").json()["links"]
    assert {service.raw.get(link["href"]).status_code for link in links} == {200}


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
    response: httpx.Response = service.raw.get("/nothing", headers={"X-Request-ID": "mine-1"})
    assert response.headers["content-type"] == PROBLEM
    assert response.json() == {
        "type": "about:blank",
        "title": "Not Found",
        "status": 404,
        "detail": "There is nothing at /nothing.",
        "instance": "/nothing",
        "remedy": "See / for what there is.",
        "errors": [],
        "request_id": "mine-1",
    }
