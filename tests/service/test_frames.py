"""The tree of frames over HTTP; what stands on a frame moves with it."""

import math

import numpy as np
import pytest
import shapely
from running import Service
from shapely.geometry import shape

from semap.model.pose import Pose

TURN = {"qz": math.sqrt(0.5), "qw": math.sqrt(0.5)}


def matrix(pose: dict) -> np.ndarray:
    return Pose(**pose).matrix()


def frame_of(service: Service, thing: dict) -> str:
    return f"/frames/{thing['frame']['id']}"


def test_frames_make_a_tree(service: Service) -> None:
    service.make_map()
    made = service.client.post("/maps/office/frames", json={"name": "dock", "pose": {"x_m": 2, **TURN}})
    assert made.status_code == 201
    dock = made.json()
    assert service.get(made.headers["location"]) == dock
    assert (dock["map"], dock["name"], dock["parent"], dock["is_static"]) == ("office", "dock", "map", True)
    root = service.client.post("/maps/office/frames", json={"name": "cart", "parent": None}).json()
    assert (root["parent"], root["pose"]) == (
        None,
        {**dict.fromkeys(("x_m", "y_m", "z_m", "qx", "qy", "qz"), 0), "qw": 1},
    )
    assert [each["name"] for each in service.get("/maps/office/frames")["frames"]] == ["map", "dock", "cart"]
    page = service.get("/maps/office/frames", limit=1, after=dock["id"])
    assert (page["frames"], page["next"]) == ([root], root["id"])

    where = f"/frames/{root['id']}"
    apart = service.client.get("/maps/office/transform", params={"target": "map", "source": "cart"})
    assert apart.status_code == 422
    assert "tree" in apart.json()["detail"]
    below = service.client.patch(where, json={"parent": "dock", "keep": "local", "name": "trolley"}).json()
    assert (below["name"], below["parent"], below["pose"]) == ("trolley", "dock", root["pose"])
    assert service.client.patch(where, json={"pose": {"y_m": 1}}).json()["pose"]["y_m"] == 1
    found = service.get("/maps/office/transform", target="map", source="trolley")["pose"]
    assert np.allclose(matrix(found), matrix(dock["pose"]) @ matrix({"y_m": 1}))
    back = service.get("/maps/office/transform", target="trolley", source="map")["pose"]
    assert np.allclose(matrix(back) @ matrix(found), np.eye(4))

    turnless = {"name": "x", "pose": {"qw": 0}}
    assert service.client.post("/maps/office/frames", json=turnless).status_code == 422
    assert service.client.patch(f"/frames/{dock['id']}", json={"parent": "trolley"}).status_code == 422
    assert service.client.patch(where, json={"name": "dock"}).status_code == 409
    assert service.client.patch(where, json={"name": None}).status_code == 422
    assert service.client.delete(f"/frames/{dock['id']}").status_code == 409
    assert service.client.delete(where).status_code == 204
    assert service.client.get(where).status_code == 404
    assert service.client.patch("/frames/1", json={"name": "x"}).status_code == 409


def test_a_change_of_parent_keeps_the_world_or_the_local_pose(service: Service) -> None:
    service.make_map()
    table = service.make_thing("table", pose={"x_m": 5, "y_m": 1, **TURN})
    cup = service.make_thing("cup", footprint=shapely.geometry.mapping(shapely.box(0, 0, 1, 1)))
    where = frame_of(service, cup)
    service.client.patch(where, json={"parent": "table"}).raise_for_status()
    kept = service.get(f"/instances/{cup['id']}")
    assert np.allclose(matrix(kept["pose"]), np.eye(4))
    assert kept["frame"]["parent"] == "table"
    service.client.patch(where, json={"parent": "map"}).raise_for_status()
    service.client.patch(where, json={"parent": "table", "keep": "local"}).raise_for_status()
    carried = service.get(f"/instances/{cup['id']}")
    assert np.allclose(matrix(carried["pose"]), matrix(table["pose"]))
    assert shape(carried["footprint"]).symmetric_difference(shapely.box(4, 1, 5, 2)).area < 1e-9
    service.client.patch(frame_of(service, table), json={"pose": {"x_m": 10}}).raise_for_status()
    moved = service.get(f"/instances/{cup['id']}")
    assert shape(moved["footprint"]).symmetric_difference(shapely.box(10, 0, 11, 1)).area < 1e-9


def test_where_a_frame_was_when(service: Service) -> None:
    service.make_map()
    cart = service.client.post("/maps/office/frames", json={"name": "cart"}).json()
    where = f"/frames/{cart['id']}/poses"
    poses = [
        {"stamp": None, "pose": {"x_m": -1}},
        {"stamp": "2026-01-31T12:00:00.000000Z", "pose": {"x_m": 0}},
        {"stamp": "2026-01-31T12:00:10.000000Z", "pose": {"x_m": 10, **TURN}},
    ]
    for pose in poses:
        assert service.client.post(where, json=pose).status_code == 201
    found = service.get(where)["poses"]
    assert [each["stamp"] for each in found] == [each["stamp"] for each in poses]
    assert [each["pose"]["x_m"] for each in found] == [-1, 0, 10]
    assert service.get(where, limit=1, after=poses[1]["stamp"])["poses"] == found[2:]
    assert service.get(f"/frames/{cart['id']}")["is_static"] is False

    def x_and_yaw(at: str) -> tuple[float, float]:
        pose = service.get("/maps/office/transform", target="map", source="cart", at=at)["pose"]
        yaw = math.atan2(2 * pose["qw"] * pose["qz"], 1 - 2 * pose["qz"] ** 2)
        return pose["x_m"], math.degrees(yaw)

    assert x_and_yaw("2026-01-31T12:00:05Z") == (pytest.approx(5), pytest.approx(45))
    assert x_and_yaw("2026-01-31T13:00:05+01:00") == (pytest.approx(5), pytest.approx(45))
    assert x_and_yaw("2027-01-01T00:00:00Z") == (10, pytest.approx(90))
    assert x_and_yaw("2025-01-01T00:00:00Z")[0] == -1
    naive = service.client.post(where, json={"stamp": "2026-01-31T12:00:00", "pose": {}})
    assert naive.status_code == 422
    nowhere = service.client.get(
        "/maps/office/transform", params={"target": "map", "source": "cart", "at": "2026-01-31T12:00:00"}
    )
    assert nowhere.status_code == 422
