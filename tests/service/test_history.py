"""Who changed what, how it was, and undo, over HTTP."""

import shapely
from running import Service
from shapely.geometry import mapping, shape

SQUARE = mapping(shapely.box(0, 0, 1, 1))


def test_each_change_is_signed_and_can_be_taken_back(service: Service) -> None:
    service.make_map()
    client = service.client
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3))
    where = f"/instances/{room['id']}"
    made_at = service.get("/maps/office/changes")["changes"][0]["made_at"]
    signed = {"Semap-Author": "Zoë".encode(), "Semap-Message": "the wall moved"}
    moved = client.patch(where, json={"footprint": SQUARE, "alias": "cell"}, headers=signed).json()
    page = service.get("/maps/office/changes")
    change, making = page["changes"][:2]
    assert (change["author"], change["message"], change["undoes"]) == ("Zoë", "the wall moved", None)
    assert making["author"] == "127.0.0.1"
    assert page["next"] is None
    assert service.get("/maps/office/changes", limit=1) == {"changes": [change], "next": change["id"]}
    assert service.get("/maps/office/changes", limit=1, before=change["id"])["changes"] == [making]
    detail = service.get(f"/changes/{change['id']}")
    assert {key: detail[key] for key in change} == change
    assert ("instance", "Room07", "changed") in {
        (each["table"], each["name"], each["action"]) for each in detail["changed"]
    }

    past = service.get(where, as_of=made_at)
    assert (past["alias"], past["as_of"]) == (None, made_at)
    assert shape(past["footprint"]).equals(shapely.box(0, 0, 4, 3))
    assert shape(service.get(where, as_of=change["made_at"])["footprint"]).equals(shape(SQUARE))
    assert client.get(where, params={"as_of": "2020-01-01T00:00:00Z"}).status_code == 404

    undone = client.post(f"/changes/{change['id']}/undo", headers={"Semap-Author": "bo"})
    assert undone.status_code == 201
    assert (undone.json()["undoes"], undone.json()["author"]) == (change["id"], "bo")
    assert service.get(undone.headers["location"]) == undone.json()
    back = service.get(where)
    assert shape(back["footprint"]).equals(shapely.box(0, 0, 4, 3))
    assert back["alias"] is None
    again = client.post(f"/changes/{change['id']}/undo")
    assert again.status_code == 409
    assert "later" in again.json()["remedy"]
    client.post(f"/changes/{undone.json()['id']}/undo").raise_for_status()
    assert shape(service.get(where)["footprint"]).equals(shape(moved["footprint"]))
    assert client.post("/changes/999/undo").status_code == 404
    assert client.get("/changes/999").status_code == 404


def test_a_map_of_the_past(service: Service) -> None:
    service.make_map()
    first, second = (service.make_room(name, shapely.box(0, 0, 1, 1)) for name in ("a", "b"))
    then = service.get("/maps/office/changes")["changes"][0]["made_at"]
    service.client.delete(f"/instances/{first['id']}").raise_for_status()
    service.client.patch(f"/instances/{second['id']}", json={"name": "c"}).raise_for_status()
    listed = service.get("/instances", map="office", as_of=then)
    assert [each["name"] for each in listed["instances"]] == ["a", "b"]
    page = service.get("/instances", map="office", as_of=then, limit=1, after=first["id"])
    assert [each["name"] for each in page["instances"]] == ["b"]
    assert service.get(f"/instances/{first['id']}", as_of=then)["name"] == "a"
    assert [each["name"] for each in service.get("/instances", map="office")["instances"]] == ["c"]
    for wrong in (
        {"as_of": then},
        {"as_of": then, "map": "office", "concept": "Room"},
        {"as_of": "yesterday"},
    ):
        assert service.client.get("/instances", params=wrong).status_code == 422, wrong
    assert service.client.get("/maps/nowhere/changes").status_code == 404


def test_a_refused_request_leaves_no_trace(service: Service) -> None:
    service.make_map()
    before = service.get("/maps/office/changes")
    assert service.post_instance({"name": "x", "concept": "Nothing"}).status_code == 422
    assert service.post_instance({"name": "map", "concept": "Room"}).status_code == 409
    assert service.get("/maps/office/changes") == before
