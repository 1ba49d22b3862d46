"""Optimistic concurrency: on every resource that can be read and changed, nobody overwrites what they did not see."""

from concurrent.futures import ThreadPoolExecutor

import httpx
import numpy as np
import pytest
import shapely
from running import Service, box_mesh
from semap_service.documents import shape as shape_document
from semap_service.http.etag import etag_of, names

GRID_YAML = (
    b"image: g.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
)
BLUEPRINT = {"type": "POINT3D", "shape": {"type": "Point", "coordinates": [0, 0, 1]}}

UNCONDITIONAL = {
    ("DELETE", "revoke_token"): "it goes one way, and what was revoked stays as it is",
    (
        "DELETE",
        "cancel_job",
    ): "it goes one way, and a job goes on by itself: no state that was read still holds",
    ("DELETE", "delete_dead_letters"): "it forgets a whole list, whichever it is; once empty it stays so",
}
"""What changes something and does not heed If-Match, and why."""

WAITING = (
    "select count(*) from pg_stat_activity where datname = current_database()"
    " and application_name = 'semap serve' and wait_event_type = 'Lock'"
)


def grid_files(shade: int) -> dict:
    return {"image": ("g.pgm", b"P5\n2 2\n255\n" + bytes([shade] * 4)), "yaml": ("g.yaml", GRID_YAML)}


def resources(service: Service) -> dict[str, list[tuple[str, str, dict]]]:
    """For each resource what changes it (method, path, arguments); each request changes something."""
    client = service.client
    service.make_map()
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3), height_m=2.5)
    frame = client.post("/maps/office/frames", json={"name": "dock"}).json()
    blueprint = client.post("/maps/office/descriptions", json={"name": "lamp"}).json()
    description = f"/descriptions/{blueprint['id']}"
    client.put(f"{description}/geometries/Bulb", json=BLUEPRINT).raise_for_status()
    client.put("/maps/office/anchor", json={"epsg": 25832}).raise_for_status()
    client.put("/maps/office/grids/g", files=grid_files(0)).raise_for_status()
    client.post("/concepts", json={"name": "Lamp"}).raise_for_status()
    query = client.post("/queries", json={"map": "office", "name": "q", "concept": "Door"}).json()
    emit = {"input": "q", "emit": {"began": "came"}}
    rule = client.post("/rules", json={"map": "office", "name": "r", "declaration": emit}).json()
    webhook = client.post("/webhooks", json={"url": "http://127.0.0.1:9/"}).json()
    hook = f"/webhooks/{webhook['id']}"
    track = f"/tracks/{service.walk([(1, 1), (2, 2)])}"
    source = f"/sources/{client.get('/sources').json()['sources'][0]['id']}"
    instance, bulb = f"/instances/{room['id']}", f"{description}/geometries/Bulb"
    lower = {**BLUEPRINT, "shape": {"type": "Point", "coordinates": [0, 0, 0.5]}}
    mesh = {"mesh": ("a.stl", box_mesh(1, 1, 1, "stl"))}
    return {
        instance: [
            ("PATCH", instance, {"json": {"alias": "kitchen"}}),
            ("PUT", f"{instance}/mesh", {"files": mesh}),
            ("DELETE", instance, {}),
        ],
        f"/frames/{frame['id']}": [
            ("PATCH", f"/frames/{frame['id']}", {"json": {"pose": {"x_m": 1}}}),
            ("DELETE", f"/frames/{frame['id']}", {}),
        ],
        bulb: [
            ("PUT", bulb, {"json": lower}),
            ("PUT", f"{bulb}/mesh", {"files": mesh}),
            ("DELETE", bulb, {}),
        ],
        description: [("PATCH", description, {"json": {"name": "light"}}), ("DELETE", description, {})],
        "/maps/office/anchor": [
            ("PUT", "/maps/office/anchor", {"json": {"epsg": 25833}}),
            ("DELETE", "/maps/office/anchor", {}),
        ],
        "/maps/office/grids/g": [
            ("PUT", "/maps/office/grids/g", {"files": grid_files(9)}),
            ("DELETE", "/maps/office/grids/g", {}),
        ],
        "/concepts/Lamp": [
            ("PATCH", "/concepts/Lamp", {"json": {"comment": "gives light"}}),
            ("DELETE", "/concepts/Lamp", {}),
        ],
        f"/rules/{rule['id']}": [
            ("PATCH", f"/rules/{rule['id']}", {"json": {"enabled": False}}),
            ("DELETE", f"/rules/{rule['id']}", {}),
        ],
        f"/queries/{query['id']}": [
            ("PATCH", f"/queries/{query['id']}", {"json": {"enabled": False}}),
            (
                "PUT",
                f"/queries/{query['id']}",
                {"json": {"name": "q", "concept": "Room", "predicate": "covers"}},
            ),
            ("DELETE", f"/queries/{query['id']}", {}),
        ],
        track: [("PATCH", track, {"json": {"concept": "Thing"}})],
        source: [("PATCH", source, {"json": {"lateness_s": 2.5}})],
        hook: [("PATCH", hook, {"json": {"state": "paused"}}), ("DELETE", hook, {})],
        "/maps/office": [("DELETE", "/maps/office", {})],
    }


def test_every_change_heeds_if_match(service: Service) -> None:
    client, heeding = service.client, set()
    for where, requests in resources(service).items():
        for method, path, arguments in requests:
            read = client.get(where)
            known = read.headers["etag"]
            assert client.get(where, headers={"If-None-Match": f'"x", W/{known}'}).status_code == 304
            assert client.get(where, headers={"If-None-Match": '"x"'}).content == read.content
            stale = client.request(method, path, headers={"If-Match": '"x"'}, **arguments)
            assert (stale.status_code, stale.json()["type"]) == (412, "urn:semap:problem:changed-meanwhile")
            assert "Read it again" in stale.json()["remedy"]
            assert client.get(where).headers["etag"] == known, "a refused change changes nothing"
            fresh = client.request(method, path, headers={"If-Match": f'"x", {known}'}, **arguments)
            assert fresh.is_success, fresh.text
            again = client.request(method, path, headers={"If-Match": known}, **arguments)
            assert again.status_code == (404 if method == "DELETE" else 412), "it is no longer that"
            if method == "PATCH":
                assert fresh.headers["etag"] == client.get(where).headers["etag"]
            heeding.add((method, service._operation(fresh.request)["operationId"]))
    published = {
        (method.upper(), operation["operationId"])
        for methods in service.described["paths"].values()
        for method, operation in methods.items()
        if method in ("patch", "put", "delete")
    }
    assert heeding == published - UNCONDITIONAL.keys()
    assert UNCONDITIONAL.keys() <= published


def test_what_does_not_heed_if_match_may_be_repeated(service: Service) -> None:
    client = service.client
    service.make_map()
    line = {"file": ("a.ndjson", b'{"name": "vase", "concept": "Thing"}')}
    later = {"Prefer": "respond-async"}
    job = client.post("/maps/office/instances/import", files=line, headers=later).headers["location"]
    token = client.post("/tokens", json={"name": "robot", "scopes": ["read"]}).headers["location"]
    hook = client.post("/webhooks", json={"url": "http://127.0.0.1:9/"}).headers["location"]
    for where in (token, f"{hook}/dead-letters"):
        assert client.delete(where).status_code == 204
        known = client.get(where).json()
        assert client.delete(where).status_code == 204
        assert client.get(where).json() == known
    client.delete(job)
    service.until(lambda: client.get(job).json()["finished_at"] is not None)
    known = client.get(job).json()
    assert client.delete(job).status_code == 409
    assert client.get(job).json() == known


def test_what_is_sent_meanwhile_waits_for_a_change_that_was_compared(service: Service) -> None:
    """The deliverer takes no lock but that of the row."""
    made = service.client.post("/webhooks", json={"url": "http://127.0.0.1:9/"}).json()
    where = f"/webhooks/{made['id']}"
    known = service.client.get(where).headers["etag"]
    service.plain.execute("begin")
    service.plain.execute("update semap.webhook set failed_count = failed_count + 1")
    with ThreadPoolExecutor(1) as pool:
        change = {"json": {"description": "x"}, "headers": {"If-Match": known}}
        answer = pool.submit(httpx.patch, f"{service.url}{where}", **change)
        service.until(lambda: service.plain.execute(WAITING).fetchone() == (1,))
        service.plain.execute("commit")
        assert answer.result().status_code == 412


def test_what_is_not_there_matches_nothing(service: Service) -> None:
    service.make_map()
    anchor = {"json": {"epsg": 25832}, "headers": {"If-Match": "*"}}
    assert service.client.put("/maps/office/anchor", **anchor).status_code == 412
    service.client.put("/maps/office/anchor", json={"epsg": 25832}).raise_for_status()
    assert service.client.put("/maps/office/anchor", **anchor).status_code == 200
    assert service.client.delete("/instances/9", headers={"If-Match": "*"}).status_code == 404


def test_a_mesh_may_be_known_by_the_file_that_was_read(service: Service) -> None:
    service.make_map()
    made = service.client.post("/maps/office/descriptions", json={"name": "box"}).json()
    where = f"/descriptions/{made['id']}/geometries/Body"
    tags = set()
    for side_m, form in ((1, "glb"), (2, "ply"), (3, "json")):
        mesh = {"mesh": ("a.stl", box_mesh(side_m, 1, 1, "stl"))}
        service.client.put(f"{where}/mesh", files=mesh).raise_for_status()
        known = service.client.get(where, params={"format": form}).headers["etag"]
        other = {"mesh": ("a.stl", box_mesh(9, 1, 1, "stl"))}
        service.client.put(f"{where}/mesh", files=other, headers={"If-Match": known}).raise_for_status()
        again = service.client.put(f"{where}/mesh", files=mesh, headers={"If-Match": known})
        assert again.status_code == 412
        tags.add(known)
    assert len(tags) == 3


def test_a_mesh_too_large_for_json_is_known_by_its_files(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    service.make_map()
    monkeypatch.setattr(shape_document, "MAX_JSON_FACES", 11)
    made = service.client.post("/maps/office/descriptions", json={"name": "box"}).json()
    where = f"/descriptions/{made['id']}/geometries/Body"
    mesh = {"mesh": ("a.stl", box_mesh(1, 1, 1, "stl"))}
    service.client.put(f"{where}/mesh", files=mesh).raise_for_status()
    refused = service.client.get(where)
    assert (refused.status_code, "format=glb" in refused.json()["remedy"]) == (413, True)
    known = service.client.get(where, params={"format": "ply"}).headers["etag"]
    assert service.client.delete(where, headers={"If-Match": '"x"'}).status_code == 412
    assert service.client.delete(where, headers={"If-Match": known}).status_code == 204


@pytest.mark.parametrize("count", [8])
def test_of_many_who_saw_the_same_one_wins(service: Service, count: int) -> None:
    service.make_map()
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3))
    where = f"{service.url}/instances/{room['id']}"
    known = httpx.get(where).headers["etag"]

    def rename(number: int) -> int:
        return httpx.patch(where, json={"alias": f"a{number}"}, headers={"If-Match": known}).status_code

    with ThreadPoolExecutor(count) as pool:
        answers = list(pool.map(rename, range(count)))
    assert sorted(answers) == [200] + [412] * (count - 1)
    assert httpx.get(where).json()["alias"] == f"a{answers.index(200)}"


def test_the_grid_is_what_was_drawn(service: Service) -> None:
    service.make_map()
    pixels = np.arange(6, dtype=np.uint8).reshape(2, 3)
    files = {"image": ("g.pgm", b"P5\n3 2\n255\n" + pixels.tobytes()), "yaml": ("g.yaml", GRID_YAML)}
    made = service.client.put("/maps/office/grids/floor", files=files).json()
    assert (made["name"], made["width"], made["height"], made["resolution_m"]) == ("floor", 3, 2, 0.1)
    assert service.get("/maps/office/grids") == {"grids": [made], "next": None}
    assert service.get("/maps/office/grids/floor") == made
    for asked in ({"params": {"format": "pgm"}}, {"headers": {"Accept": "image/x-portable-graymap"}}):
        image = service.client.get("/maps/office/grids/floor", **asked)
        assert image.content.endswith(pixels.tobytes())
    outside = {**files, "yaml": ("g.yaml", GRID_YAML.replace(b"g.pgm", b"../../etc/passwd"))}
    assert service.client.put("/maps/office/grids/floor", files=outside).status_code == 422
    assert service.client.put("/maps/nowhere/grids/floor", files=files).status_code == 404


def test_names() -> None:
    tag = etag_of(b"x")
    assert tag != etag_of(b"y")
    assert names(f'"a", {tag}', tag)
    assert names("*", tag)
    assert not names(f"W/{tag}", tag)
    assert names(f"W/{tag}", tag, weakly=True)
    assert not names(tag.strip('"'), tag)
