"""The taxonomy over HTTP."""

import shapely
from running import Service

SPACE_IRI = "https://w3id.org/bot#Space"
SCHEMA = {"type": "object", "required": ["seats"]}


def test_a_concept_is_made_changed_and_deleted(service: Service) -> None:
    service.make_map()
    client = service.client
    wanted = {
        "name": "Canteen",
        "parents": ["Agent", "Space"],
        "iris": ["https://example.org/Canteen"],
        "comment": "where one eats",
        "attribute_schema": SCHEMA,
    }
    made = client.post("/concepts", json=wanted)
    assert (made.status_code, made.json()) == (201, wanted)
    where = made.headers["location"]
    assert service.get(where) == wanted
    bare = client.post("/concepts", json={"name": "Bare"}).json()
    nothing = {"iris": [], "comment": None, "attribute_schema": None}
    assert bare == {"name": "Bare", "parents": ["Thing"], **nothing}

    room = service.make_room("hall", shapely.box(0, 0, 1, 1), concept="Canteen", attributes={"seats": 9})
    assert service.get("/instances", concept="Room")["instances"] == []
    changed = client.patch(where, json={"parents": ["Room"], "iris": [SPACE_IRI], "comment": ""}).json()
    assert (changed["parents"], changed["iris"], changed["comment"]) == (["Room"], [SPACE_IRI], "")
    assert changed["attribute_schema"] == SCHEMA
    assert [each["id"] for each in service.get("/instances", concept="Room")["instances"]] == [room["id"]]
    assert [each["name"] for each in service.get("/rooms")["rooms"]] == ["hall"]
    assert changed in service.get("/concepts")["concepts"]

    below = client.post("/concepts", json={"name": "Bar", "parents": ["Canteen"]}).json()
    assert client.patch(where, json={"parents": ["Bar"]}).status_code == 422, "no circle"
    assert client.delete(where).status_code == 409, "it has an instance"
    client.delete(f"/instances/{room['id']}").raise_for_status()
    assert client.delete(where).status_code == 204
    assert service.get(f"/concepts/{below['name']}")["parents"] == ["Room"]
    assert client.delete("/concepts/Thing").status_code == 409
    assert client.get(where).status_code == 404


def test_concepts_that_cannot_be(service: Service) -> None:
    for wrong in (
        {"name": "A", "parents": []},
        {"name": "A", "parents": ["Nothing"]},
        {"name": "A/B"},
        {"name": "A", "iris": ["no iri"]},
        {"name": "A", "attribute_schema": {"type": "no type"}},
        {"name": "A", "attribute_schema": []},
        {"name": "A", "parent": "Room"},
    ):
        response = service.client.post("/concepts", json=wrong)
        assert response.status_code == 422, wrong
        assert response.json()["remedy"]
    assert service.client.patch("/concepts/Room", json={"comment": None}).status_code == 422
    assert service.client.patch("/concepts/Nothing", json={}).status_code == 404
    assert service.client.get("/concepts/A").status_code == 404
