"""What an instance is connected to, copied, deleted, and checked against the schema of its concept."""

import shapely
from running import Service
from shapely.geometry import mapping, shape

SEATS = {"type": "object", "properties": {"seats": {"type": "integer", "minimum": 1}}}


def names(service: Service, **filters: object) -> list[str]:
    return [each["name"] for each in service.get("/instances", **filters)["instances"]]


def test_what_carries_it(service: Service) -> None:
    service.make_map()
    table = service.make_thing("table", pose={"x_m": 5})
    square = mapping(shapely.box(0, 0, 1, 1))
    cup = service.make_thing("cup", frame="table", footprint=square)
    assert cup["frame"] == {"id": cup["frame"]["id"], "name": "cup", "parent": "table"}
    assert (cup["pose"]["x_m"], shape(cup["footprint"]).bounds) == (0, (0, 0, 1, 1)), (
        "a pose is in the map frame"
    )
    ball = service.make_thing("ball", frame="table", local_pose={"z_m": 1})
    assert (ball["pose"]["x_m"], ball["pose"]["z_m"]) == (5, 1)
    where = f"/instances/{cup['id']}"
    local = service.client.patch(where, json={"local_pose": {"x_m": 2}}).json()
    assert shape(local["footprint"]).bounds == (7, 0, 8, 1)
    free = service.client.patch(where, json={"frame": "map", "keep": "local"}).json()
    assert shape(free["footprint"]).bounds == (2, 0, 3, 1)
    back = service.client.patch(where, json={"frame": "table", "name": "mug"}).json()
    assert (back["frame"]["name"], back["frame"]["parent"]) == ("mug", "table")
    assert shape(back["footprint"]).bounds == (2, 0, 3, 1)
    for wrong in (
        {"frame": "sky"},
        {"frame": "mug"},
        {"frame": None},
        {"pose": {}, "local_pose": {}},
        {"local_pose": {"qw": 0}},
    ):
        assert service.client.patch(where, json=wrong).status_code == 422, wrong
    assert service.get(where) == back
    for wrong in (
        {"frame": "sky"},
        {"local_pose": {}, "pose": {}},
        {"local_pose": {}, "footprint": square},
        {"description": "sky"},
        {"description": "sky", "footprint": square},
    ):
        refused = service.post_instance({"name": "x", "concept": "Thing", **wrong})
        assert refused.status_code == 422, wrong

    assert service.client.delete(f"/instances/{table['id']}").status_code == 409
    kept = service.client.delete(f"/instances/{table['id']}", params={"carried": "keep"})
    assert kept.status_code == 204
    assert service.get(where)["frame"]["parent"] == "map"
    assert shape(service.get(where)["footprint"]).bounds == (2, 0, 3, 1)
    assert names(service) == ["mug", "ball"]


def test_all_that_stands_on_it_goes_with_it(service: Service) -> None:
    service.make_map()
    table = service.make_thing("table")
    service.make_thing("tray", frame="table")
    service.make_thing("cup", frame="tray")
    service.make_thing("lamp")
    gone = service.client.delete(f"/instances/{table['id']}", params={"carried": "delete"})
    assert gone.status_code == 204
    assert names(service) == ["lamp"]
    assert [each["name"] for each in service.get("/maps/office/frames")["frames"]] == ["map", "lamp"]


def test_doors_and_storeys(service: Service) -> None:
    service.make_map()
    rooms = [service.make_room(f"R{at}", shapely.box(at, 0, at + 1, 1)) for at in range(3)]
    ground = service.post_instance({"name": "ground", "concept": "Storey"}).json()
    door = service.post_instance({"name": "D", "concept": "Door", "joins": ["R0", "R1"]}).json()
    where = f"/instances/{door['id']}"
    changed = service.client.patch(where, json={"joins": ["R2", "R1", "R2"], "storey": "ground"}).json()
    assert ([each["name"] for each in changed["joins"]], changed["storey"]) == (["R1", "R2"], "ground")
    assert service.get(f"/instances/{rooms[0]['id']}")["joins"] == []
    assert service.get(f"/instances/{rooms[2]['id']}")["joins"] == [{"id": door["id"], "name": "D"}]
    for wrong in (
        {"joins": ["R9"]},
        {"joins": ["D"]},
        {"joins": None},
        {"storey": "R1"},
        {"storey": "attic"},
    ):
        assert service.client.patch(where, json=wrong).status_code == 422, wrong
    cleared = service.client.patch(where, json={"joins": [], "storey": None}).json()
    assert (cleared["joins"], cleared["storey"]) == ([], None)
    assert service.get(f"/instances/{ground['id']}")["name"] == "ground"


def test_a_copy_looks_the_same(service: Service) -> None:
    service.make_map()
    hall = service.make_room("hall", shapely.box(0, 0, 2, 1), alias="big", attributes={"n": 1})
    made = service.client.post(f"/instances/{hall['id']}/copy", json={"name": "annex"})
    assert made.status_code == 201
    copy = made.json()
    assert service.get(made.headers["location"]) == copy
    same = ("concept", "alias", "attributes", "footprint", "band", "pose", "storey", "has_body")
    assert {key: copy[key] for key in same} == {key: hall[key] for key in same}
    assert (copy["name"], copy["frame"]["name"], copy["uid"] != hall["uid"]) == ("annex", "annex", True)
    moved = service.client.patch(made.headers["location"], json={"pose": {"x_m": 5}}).json()
    assert shape(moved["footprint"]).bounds == (5, 0, 7, 1)
    assert service.get(f"/instances/{hall['id']}")["footprint"] == hall["footprint"]
    assert service.client.post(f"/instances/{hall['id']}/copy", json={"name": "annex"}).status_code == 409
    assert service.client.post("/instances/999/copy", json={"name": "x"}).status_code == 404


def test_attributes_follow_the_schema_of_the_concept(service: Service) -> None:
    service.make_map()
    client = service.client
    client.post("/concepts", json={"name": "Seating", "attribute_schema": SEATS}).raise_for_status()
    client.post("/concepts", json={"name": "Sofa", "parents": ["Seating", "Furniture"]}).raise_for_status()
    wrong = service.post_instance({"name": "s", "concept": "Sofa", "attributes": {"seats": 0}})
    assert (wrong.status_code, wrong.json()["errors"][0]["where"]) == (422, "attributes.seats")
    assert "Seating" in wrong.json()["remedy"]
    sofa = service.make_thing("s", concept="Sofa", attributes={"seats": 3, "color": "red"})
    where = f"/instances/{sofa['id']}"
    assert client.patch(where, json={"attributes": {"seats": "many"}}).status_code == 422
    assert service.get(where)["attributes"] == {"seats": 3, "color": "red"}
    other = service.make_thing("o", concept="Furniture", attributes={"seats": "none"})
    assert client.patch(f"/instances/{other['id']}", json={"concept": "Sofa"}).status_code == 422
    assert client.patch(f"/instances/{other['id']}", json={"concept": "Sofa", "attributes": {}}).is_success


def test_a_schema_fetches_nothing(service: Service) -> None:
    service.make_map()
    for name, target in (("Odd", "http://127.0.0.1:9/schema.json"), ("Even", "#/$defs/nothing")):
        schema = {"properties": {"n": {"$ref": target}}}
        service.client.post("/concepts", json={"name": name, "attribute_schema": schema}).raise_for_status()
        refused = service.post_instance({"name": "x", "concept": name, "attributes": {"n": 1}})
        assert (refused.status_code, "not in it" in refused.json()["detail"]) == (422, True)
