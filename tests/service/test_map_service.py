"""Maps, instances, rooms, tracks and relations over HTTP."""

import json
from datetime import timedelta

import pytest
import shapely
from psycopg.conninfo import make_conninfo
from running import START, Service, box_mesh
from shapely.geometry import mapping, shape

from semap.store.database.connection import connect

ELL = shapely.Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])


def kind(response) -> tuple[int, str]:
    problem = response.json()
    assert problem["remedy"]
    return response.status_code, problem["type"].removeprefix("urn:semap:problem:")


@pytest.mark.parametrize("file_type", ["glb", "obj", "ply", "stl"])
def test_a_mesh_becomes_a_footprint(service: Service, file_type: str) -> None:
    service.make_map()
    mesh = (f"box.{file_type}", box_mesh(4, 3, 2.5, file_type))
    document = {"name": "Room07", "concept": "Room", "pose": {"x_m": 10, "z_m": 1}, "attributes": {"n": [1]}}
    response = service.post_instance(document, mesh)
    assert response.status_code == 201, response.text
    made = response.json()
    assert service.get(response.headers["location"]) == made
    assert shape(made["footprint"]).symmetric_difference(shapely.box(10, 0, 14, 3)).area < 1e-6
    assert made["band"] == {"z_min_m": pytest.approx(1), "z_max_m": pytest.approx(3.5)}
    assert made["pose"] == {"x_m": 10, "y_m": 0, "z_m": 1, "qx": 0, "qy": 0, "qz": 0, "qw": 1}
    assert (made["has_body"], made["attributes"]) == (True, {"n": [1]})


def test_a_concave_mesh_has_a_concave_footprint(service: Service) -> None:
    service.make_map()
    lines = [f"v {x} {y} {z}" for z in (0, 2) for x, y in ELL.exterior.coords[:-1]]
    # the two rectangles of the L, below and above
    for at in (0, 6):
        lines += [f"f {at + a} {at + b} {at + c}" for a, b, c in ((1, 2, 3), (1, 3, 4), (1, 4, 5), (1, 5, 6))]
    response = service.post_instance({"name": "ell", "concept": "Room"}, ("l.obj", "\n".join(lines).encode()))
    assert shape(response.json()["footprint"]).area == pytest.approx(ELL.area)


def test_a_footprint_with_a_height_is_a_body(service: Service) -> None:
    service.make_map()
    with_hole = shapely.box(0, 0, 9, 9).difference(shapely.box(2, 2, 3, 3))
    made = service.make_room("hall", with_hole, elevation_m=3, height_m=2.5, pose={"x_m": 5})
    assert shapely.equals(shape(made["footprint"]), with_hole)
    assert (made["band"], made["has_body"]) == ({"z_min_m": 3, "z_max_m": 5.5}, True)
    flat = service.make_room("yard", shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 2, 3, 3)]))
    assert (flat["band"], flat["has_body"], flat["footprint"]["type"]) == (None, False, "MultiPolygon")


def test_a_patch_moves_the_footprint_exactly(service: Service) -> None:
    service.make_map()
    made = service.make_room("hall", ELL, height_m=2.5)
    where = f"/instances/{made['id']}"
    moved = service.client.patch(where, json={"pose": {"x_m": 0.25, "y_m": -3, "z_m": 1}}).json()
    assert shapely.equals(shape(moved["footprint"]), shapely.affinity.translate(ELL, 0.25, -3))
    assert moved["band"] == {"z_min_m": 1, "z_max_m": 3.5}
    named = service.client.patch(where, json={"alias": "x", "name": "y"}).json()
    frame = {**moved["frame"], "name": "y"}
    assert named == {**moved, "alias": "x", "name": "y", "frame": frame, "updated_at": named["updated_at"]}
    assert service.client.patch(where, json={"alias": None}).json()["alias"] is None
    assert kind(service.client.patch(where, json={"name": None})) == (422, "invalid-input")
    assert kind(service.client.patch(where, json={"elevation_m": 1})) == (422, "invalid-input")
    mesh = {"mesh": ("a.ply", box_mesh(2, 2, 1, "ply"))}
    reshaped = service.client.put(f"{where}/mesh", files=mesh).json()
    assert shape(reshaped["footprint"]).equals(shapely.box(0.25, -3, 2.25, -1))


def test_who_is_where(service: Service) -> None:
    service.make_map()
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3))
    service.make_room("Room08", shapely.box(4, 0, 8, 3))
    track_id = service.walk([(-1, 1), (1, 1), (2, 2)])
    since = (START + timedelta(seconds=1)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    relation = {
        "map": "office",
        "query": "track_in_room",
        "track_id": track_id,
        "track": "person",
        "subject_instance_id": None,
        "subject_instance": None,
        "instance_id": room["id"],
        "instance": "Room07",
        "object_track_id": None,
        "object_track": None,
        "since": since,
        "until": None,
        "duration_s": None,
        "probability": None,
    }
    page = {"relations": [relation], "next": None}
    assert service.get("/relations", map="office", track="person", room="Room07") == page
    assert (
        service.get("/relations", query="track_in_room") == service.get(f"/tracks/{track_id}/rooms") == page
    )
    assert service.get("/relations", room="Room08")["relations"] == []
    occupant = {"track_id": track_id, "name": "person", "since": since}
    assert service.get(f"/rooms/{room['id']}/occupants")["occupants"] == [occupant]
    rooms = service.get("/rooms", map="office")["rooms"]
    assert [(each["name"], each["occupants"]) for each in rooms] == [("Room07", 1), ("Room08", 0)]
    assert service.get(f"/rooms/{room['id']}") == {**service.get(f"/instances/{room['id']}"), "occupants": 1}
    (track,) = service.get("/tracks", live=True)["tracks"]
    stamp = (START + timedelta(seconds=2)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    unknown = (
        "z_m", "std_m", "heading_rad", "speed_mps", "length_m", "width_m", "std_across_m", "std_yaw_rad", "footprint",
    )  # fmt: skip
    assert track["state"] == {"stamp": stamp, "x_m": 2, "y_m": 2, **dict.fromkeys(unknown)}
    assert service.get(f"/tracks/{track_id}") == track
    assert service.get("/tracks", live=False)["tracks"] == []

    assert service.client.delete(f"/instances/{room['id']}").status_code == 204
    assert service.get(f"/tracks/{track_id}/rooms")["relations"] == []
    assert service.client.get(f"/rooms/{room['id']}/occupants").status_code == 404


def test_a_track_without_a_state_has_none(service: Service) -> None:
    service.make_map()
    track = service.get(f"/tracks/{service.walk([])}")
    assert (track["live"], track["state"], track["ended_at"]) == (False, None, None)


def test_lists_go_on_where_they_ended(service: Service) -> None:
    service.make_map()
    for number in range(5):
        service.make_room(f"r{number}", shapely.box(number, 0, number + 1.5, 1))
        service.walk([(number + 0.5, 0.5)], f"t{number}")
    service.make_map("other")
    for path, key in (
        ("/instances", "instances"),
        ("/rooms", "rooms"),
        ("/tracks", "tracks"),
        ("/relations", "relations"),
        ("/maps", "maps"),
        ("/queries", "queries"),
        ("/rules", "rules"),
    ):
        everything = service.get(path)
        assert everything["next"] is None
        collected, after = [], {}
        while True:
            page = service.get(path, limit=2, **after)
            collected += page[key]
            if page["next"] is None:
                break
            after = {"after": page["next"]}
        assert collected == everything[key], path


def test_each_kind_of_error(service: Service) -> None:
    client = service.client
    service.make_map()
    room = {"name": "Room07", "concept": "Room"}
    assert service.post_instance(room).status_code == 201
    square = mapping(shapely.box(0, 0, 1, 1))
    bow_tie = {"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]]}
    for response, expected in (
        (client.get("/maps/nowhere"), (404, "not-found")),
        (client.delete("/maps/nowhere"), (404, "not-found")),
        (client.get("/rooms", params={"map": "nowhere"}), (404, "not-found")),
        (client.get("/instances/999"), (404, "not-found")),
        (client.get("/tracks/999/rooms"), (404, "not-found")),
        (client.get("/instances/x"), (422, "invalid-input")),
        (client.get(f"/instances/{10**30}"), (422, "invalid-input")),
        (client.get(f"/rules/{2**40}"), (422, "invalid-input")),
        (client.get("/instances?limit=1001"), (422, "invalid-input")),
        (client.get("/relations?after=1"), (422, "invalid-input")),
        (client.post("/maps", json={"name": "office"}), (409, "conflict")),
        (client.post("/maps", json={"name": ""}), (422, "invalid-input")),
        (client.post("/maps", json={"name": "a\0b"}), (422, "invalid-input")),
        (client.post("/maps", json={"name": "a/b"}), (422, "invalid-input")),
        (client.post("/maps", json={"name": "x", "color": 1}), (422, "invalid-input")),
        (client.post("/maps", content=b'{"name": "x", "cell_m": NaN}'), (422, "invalid-input")),
        (
            client.post("/maps", content=b"{", headers={"content-type": "application/json"}),
            (422, "invalid-input"),
        ),
        (service.post_instance(room), (409, "conflict")),
        (service.post_instance(room, map_name="nowhere"), (404, "not-found")),
        (service.post_instance({**room, "name": "map"}), (409, "conflict")),
        (service.post_instance({"name": "a"}), (422, "invalid-input")),
        (service.post_instance({"name": "a", "concept": "Nothing"}), (422, "invalid-input")),
        (service.post_instance({**room, "name": "a", "footprint": bow_tie}), (422, "invalid-input")),
        (service.post_instance({**room, "name": "a", "height_m": 2}), (422, "invalid-input")),
        (
            service.post_instance({**room, "name": "a", "footprint": square, "elevation_m": 2}),
            (422, "invalid-input"),
        ),
        (service.post_instance({**room, "name": "a"}, ("a.txt", b"x")), (422, "invalid-input")),
        (service.post_instance({**room, "name": "a"}, ("a.stl", b"nonsense")), (422, "invalid-input")),
        (client.post("/maps/office/instances", files={"document": (None, "{")}), (422, "invalid-input")),
        (client.post("/maps/office/instances"), (422, "invalid-input")),
        (
            client.post("/queries", json={"map": "office", "name": "track_in_room", "concept": "Room"}),
            (409, "conflict"),
        ),
        (
            client.post("/queries", json={"map": "office", "name": "q", "concept": "Nothing"}),
            (422, "invalid-input"),
        ),
        (client.delete(f"/queries/{service.get('/queries')['queries'][0]['id']}"), (409, "conflict")),
        (
            client.post("/rules", json={"map": "office", "name": "r", "declaration": {}}),
            (422, "invalid-input"),
        ),
        (client.post("/concepts", json={"name": "Room"}), (409, "conflict")),
    ):
        assert kind(response) == expected, response.request.url
    assert [each["name"] for each in service.get("/instances")["instances"]] == ["Room07"]


def test_the_places_of_errors_are_named(service: Service) -> None:
    problem = service.client.post("/maps", json={"name": "", "cell_m": 0}).json()
    assert [each["where"] for each in problem["errors"]] == ["body.name", "body.cell_m"]
    service.make_map()
    problem = service.post_instance({"name": "a", "concept": "Nothing"}).json()
    assert [each["where"] for each in problem["errors"]] == ["concept"]


def test_too_large_an_upload_is_refused_announced_or_not(service: Service) -> None:
    service.make_map()
    document = json.dumps({"name": "a", "concept": "Room"})
    files = {"document": (None, document), "mesh": ("a.stl", b"\0" * (64 * 1024**2))}
    announced = service.client.post("/maps/office/instances", files=files)
    assert kind(announced) == (413, "too-large")

    whole = service.client.build_request("POST", "/maps/office/instances", files=files)

    def pieces():
        data = whole.read()
        yield from (data[at : at + 2**20] for at in range(0, len(data), 2**20))

    headers = {"content-type": whole.headers["content-type"]}
    streamed = service.client.post("/maps/office/instances", content=pieces(), headers=headers)
    assert kind(streamed)[0] == 413
    assert service.get("/instances")["instances"] == []


def test_the_service_answers_while_the_database_does_not(service: Service, database: str) -> None:
    service.make_map()
    name = service.plain.info.dbname
    with connect(make_conninfo(database, dbname="postgres")) as elsewhere:
        elsewhere.execute(f"alter database {name} allow_connections false")
        elsewhere.execute(
            "select pg_terminate_backend(pid) from pg_stat_activity"
            " where datname = %s and application_name in ('semap serve', 'semap feed')",
            [name],
        )
        try:
            for path in ("/health", "/maps", "/events"):
                response = service.client.get(path)
                assert kind(response) == (503, "database-unavailable")
                assert response.headers["retry-after"] == "1"
        finally:
            elsewhere.execute(f"alter database {name} allow_connections true")
    assert [each["name"] for each in service.get("/maps")["maps"]] == ["office"]
    service.until(lambda: service.get("/health")["feed_connected"])


def test_a_page_of_another_site_may_not_write(service: Service) -> None:
    foreign = service.raw.post("/maps", json={"name": "yard"}, headers={"Origin": "http://elsewhere.example"})
    assert foreign.status_code == 403
    assert foreign.headers["content-type"] == "application/problem+json"
    assert (
        service.raw.post("/maps", json={"name": "yard"}, headers={"Origin": service.url}).status_code == 201
    )
    assert service.raw.get("/maps", headers={"Origin": "http://elsewhere.example"}).status_code == 200
