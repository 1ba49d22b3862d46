"""An edit of the outline or the heights: what was made of them follows, what a file gave stays."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
import shapely
import shapely.affinity
import trimesh
from running import Service, box_mesh
from shapely.geometry import mapping

SQUARE = shapely.box(0, 0, 4, 3)
CORNER = shapely.Polygon([(0, 0), (4, 0), (4, 2), (2, 2), (2, 3), (0, 3)])


def body(service: Service, instance_id: int) -> trimesh.Trimesh:
    described = service.get(f"/instances/{instance_id}")["description"]["id"]
    where = f"/descriptions/{described}/geometries/Body"
    answer = service.client.get(where, headers={"Accept": "model/ply"})
    assert answer.status_code == 200, answer.text
    return trimesh.load(io.BytesIO(answer.content), file_type="ply")


def patch(service: Service, instance_id: int, **changes: object) -> dict:
    answer = service.client.patch(f"/instances/{instance_id}", json=json.loads(json.dumps(changes)))
    assert answer.status_code == 200, answer.text
    return answer.json()


@pytest.mark.parametrize("hole", [[], [[(1, 1), (1, 1.5), (1.5, 1.5), (1.5, 1)]]])
def test_a_prism_follows_its_outline_and_heights(service: Service, hole: list) -> None:
    service.make_map()
    square = shapely.Polygon(SQUARE.exterior.coords, hole)
    room = service.make_room("Room07", square, height_m=2.5, elevation_m=1)["id"]
    corner = shapely.Polygon(CORNER.exterior.coords, hole)
    patch(service, room, footprint=mapping(corner))
    found = body(service, room)
    assert found.is_watertight
    assert found.volume == pytest.approx(corner.area * 2.5)
    patch(service, room, elevation_m=0, height_m=3)
    found = body(service, room)
    assert found.volume == pytest.approx(corner.area * 3)
    assert np.allclose(found.bounds, [[0, 0, 0], [4, 3, 3]])


def test_a_prism_follows_where_it_was_moved(service: Service) -> None:
    service.make_map()
    room = service.make_room("Room07", SQUARE, height_m=2.5)["id"]
    patch(service, room, pose={"x_m": 10}, footprint=mapping(shapely.affinity.translate(CORNER, 10)))
    assert body(service, room).volume == pytest.approx(CORNER.area * 2.5)


def test_a_body_from_a_file_stays(service: Service) -> None:
    service.make_map()
    made = service.post_instance(
        {
            "name": "box",
            "concept": "Room",
            "footprint": json.loads(json.dumps(mapping(SQUARE))),
            "height_m": 2,
        },
        mesh=("box.ply", box_mesh(1, 1, 1, "ply")),
    ).json()
    patch(service, made["id"], footprint=mapping(CORNER), elevation_m=0, height_m=3)
    assert body(service, made["id"]).volume == pytest.approx(1)
