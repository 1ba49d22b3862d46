"""Blueprints, their geometries, and what is derived from them, over HTTP."""

import io
from typing import get_args

import numpy as np
import pytest
import shapely
import trimesh
from running import Service, box_mesh
from semap_service.routes.abstractions import abstractions
from shapely.geometry import mapping, shape

from semap.geometry.direction import DIRECTIONS
from semap.model.pose import Pose

TETRAHEDRON = {
    "type": "Surface",
    "vertices_m": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "faces": [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
}
CUBE = {
    "type": "Surface",
    "vertices_m": [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)],
    "faces": [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]],
}
SQUARE_3D = [[[0, 0, 1], [2, 0, 1], [2, 2, 1], [0, 2, 1], [0, 0, 1]]]
GEOMETRIES = {
    "POINT2D": {"type": "Point", "coordinates": [1, 2]},
    "POSE2D": {"type": "Point", "coordinates": [1, 2]},
    "POLYGON2D": {"type": "MultiPolygon", "coordinates": [[[[0, 0], [1, 0], [1, 1], [0, 0]]]]},
    "POINT3D": {"type": "Point", "coordinates": [1, 2, 3]},
    "POSE3D": {"type": "Point", "coordinates": [1, 2, 3]},
    "POLYGON3D": {"type": "Polygon", "coordinates": SQUARE_3D},
    "TRIANGLEMESH3D": TETRAHEDRON,
    "POLYGONMESH3D": CUBE,
}


def blueprint(service: Service, name: str = "chair") -> dict:
    made = service.client.post("/maps/office/descriptions", json={"name": name})
    assert made.status_code == 201
    assert service.get(made.headers["location"]) == made.json()
    return made.json()


def put(service: Service, description: dict, name: str, **geometry: object) -> dict:
    response = service.client.put(f"/descriptions/{description['id']}/geometries/{name}", json=geometry)
    assert response.status_code == 200, response.text
    return response.json()


def area(service: Service, thing: dict) -> shapely.Geometry:
    return shape(service.get(f"/instances/{thing['id']}")["footprint"])


def test_instances_follow_their_blueprint(service: Service) -> None:
    service.make_map()
    chair, stool = blueprint(service), blueprint(service, "stool")
    outline = {"type": "POLYGON2D", "band": {"z_min_m": 0, "z_max_m": 0.5}}
    put(service, chair, "Seat", shape=mapping(shapely.box(0, 0, 1, 2)), **outline)
    put(service, stool, "Seat", shape=mapping(shapely.box(0, 0, 3, 3)), **outline)
    first = service.make_thing("first", description="chair", pose={"x_m": 10})
    second = service.make_thing("second", description="chair", pose={"y_m": 10})
    assert first["description"] == {"id": chair["id"], "name": "chair"}
    assert area(service, first).equals(shapely.box(10, 0, 11, 2))
    put(service, chair, "Seat", shape=mapping(shapely.box(-1, 0, 1, 1)), **outline)
    assert area(service, first).equals(shapely.box(9, 0, 11, 1))
    assert area(service, second).equals(shapely.box(-1, 10, 1, 11))
    document = service.get(f"/descriptions/{chair['id']}")
    assert (document["instances"], [each["name"] for each in document["geometries"]]) == (2, ["Seat"])
    assert document["geometries"][0]["band"] == {"z_min_m": 0, "z_max_m": 0.5}
    assert {"Footprint", "BoundingHull", "Position3D"} <= set(document["abstractions"])

    where = f"/instances/{second['id']}"
    switched = service.client.patch(where, json={"description": "stool"}).json()
    assert shape(switched["footprint"]).equals(shapely.box(0, 10, 3, 13))
    unknown = service.client.patch(where, json={"description": "sofa"})
    assert (unknown.status_code, unknown.json()["errors"][0]["where"]) == (422, "description")
    stripped = service.client.patch(where, json={"description": None}).json()
    assert (stripped["description"], stripped["footprint"]) == (None, None)

    gone = service.client.delete(f"/descriptions/{chair['id']}", params={"replacement": stool["id"]})
    assert gone.status_code == 204
    assert area(service, first).equals(shapely.box(10, 0, 13, 3))
    assert service.client.delete(f"/descriptions/{stool['id']}").status_code == 204
    assert service.get(f"/instances/{first['id']}")["footprint"] is None
    assert service.get("/maps/office/descriptions")["descriptions"] == []


def test_the_shape_of_one_instance_becomes_a_blueprint(service: Service) -> None:
    service.make_map()
    hall = service.make_room("hall", shapely.box(0, 0, 2, 1))
    assert hall["description"]["name"] is None
    where = f"/descriptions/{hall['description']['id']}"
    assert service.client.patch(where, json={"name": "standard"}).json()["name"] == "standard"
    again = service.make_thing("again", description="standard", local_pose={"x_m": 5}, frame="hall")
    assert area(service, again).equals(shapely.box(5, 0, 7, 1))
    reshaped = service.client.patch(
        f"/instances/{again['id']}", json={"footprint": mapping(shapely.box(0, 0, 1, 1))}
    ).json()
    assert reshaped["description"]["name"] is None
    assert area(service, hall).equals(shapely.box(0, 0, 2, 1)), "others keep the blueprint"


def test_each_type_of_geometry_comes_back(service: Service) -> None:
    service.make_map()
    made = blueprint(service)
    pose = {"x_m": 1, "y_m": 0, "z_m": -1, "qx": 0, "qy": 0, "qz": 1, "qw": 0}
    for type_, given in GEOMETRIES.items():
        document = put(service, made, "It", type=type_, shape=given, pose=pose)
        assert document == service.get(f"/descriptions/{made['id']}/geometries/It")
        assert (document["name"], document["type"], document["pose"]) == ("It", type_, pose)
        assert_same_shape(document, type_)


def assert_same_shape(document: dict, type_: str) -> None:
    if type_ == "TRIANGLEMESH3D":  # vertices are kept in lexical order
        given = np.array(TETRAHEDRON["vertices_m"])[np.array(TETRAHEDRON["faces"])]
        found = np.array(document["shape"]["vertices_m"])[np.array(document["shape"]["faces"])]
        assert np.array_equal(given, found)
    elif type_ == "POLYGONMESH3D":
        vertices_m = document["shape"]["vertices_m"]
        faces = [[vertices_m[at] for at in face] for face in document["shape"]["faces"]]
        assert faces == [[CUBE["vertices_m"][at] for at in face] for face in CUBE["faces"]]
    else:
        assert document["shape"] == GEOMETRIES[type_] or shape(document["shape"]).equals(
            shape(GEOMETRIES[type_])
        )


def test_geometries_that_are_none(service: Service) -> None:
    service.make_map()
    where = f"/descriptions/{blueprint(service)['id']}/geometries/It"
    bow_tie = [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]]
    bent = [[[0, 0, 0], [2, 0, 0], [2, 2, 1], [0, 2, 0], [0, 0, 0]]]
    for type_, wrong in (
        ("POINT3D", GEOMETRIES["POINT2D"]),
        ("POLYGON2D", GEOMETRIES["POINT2D"]),
        ("POLYGON2D", {"type": "Polygon", "coordinates": bow_tie}),
        ("POLYGON3D", {"type": "Polygon", "coordinates": bent}),
        ("TRIANGLEMESH3D", CUBE),
        ("TRIANGLEMESH3D", {**TETRAHEDRON, "faces": [[0, 1, 9]]}),
        ("TRIANGLEMESH3D", {**TETRAHEDRON, "faces": []}),
        ("POLYGONMESH3D", {**CUBE, "faces": [[0, 1, 2, 7]]}),
    ):
        response = service.client.put(where, json={"type": type_, "shape": wrong})
        assert response.status_code == 422, (type_, wrong)
        assert response.json()["remedy"]
    band = {"z_min_m": 0, "z_max_m": 1}
    for wrong in (
        {"type": "POINT2D", "band": band},
        {"type": "POLYGON2D", "band": {"z_min_m": 1, "z_max_m": 1}},
    ):
        response = service.client.put(where, json={"shape": GEOMETRIES[wrong["type"]], **wrong})
        assert response.status_code == 422
    assert service.client.get(where).status_code == 404
    assert service.client.delete(where).status_code == 404


def test_a_mesh_in_other_units_and_axes(service: Service) -> None:
    service.make_map()
    made = blueprint(service)
    where = f"/descriptions/{made['id']}/geometries/Body"
    mesh = {"mesh": ("box.stl", box_mesh(400, 100, 50, "stl"))}
    uploaded = service.client.put(f"{where}/mesh", files=mesh, data={"unit": "cm", "up": "y"})
    assert (uploaded.status_code, uploaded.json()["faces"]) == (200, 12)
    for form in ("ply", "glb"):
        file = service.client.get(where, params={"format": form})
        extents = trimesh.load_mesh(io.BytesIO(file.content), file_type=form).extents
        z_up = extents if form == "ply" else extents[[0, 2, 1]]
        assert z_up == pytest.approx([4, 0.5, 1])
        accepted = service.client.get(
            where, headers={"Accept": f"text/html, {file.headers['content-type']};q=0.9"}
        )
        assert accepted.content == file.content
    assert len(service.get(where)["shape"]["faces"]) == 12
    wrong = service.client.put(f"{where}/mesh", files=mesh, data={"unit": "mile"})
    assert wrong.status_code == 422
    put(service, made, "Mark", type="POINT2D", shape=GEOMETRIES["POINT2D"])
    pointless = service.client.get(f"/descriptions/{made['id']}/geometries/Mark", params={"format": "glb"})
    assert pointless.status_code == 422


def test_what_is_derived(service: Service) -> None:
    assert set(get_args(abstractions.Direction)) == set(DIRECTIONS)
    service.make_map()
    made = blueprint(service)
    put(service, made, "Body", type="POLYGONMESH3D", shape=CUBE)
    half = np.sqrt(0.5)
    thing = service.make_thing("it", description="chair", pose={"x_m": 5, "z_m": 2, "qz": half, "qw": half})

    def relative(kind: str, **more: object) -> dict:
        return service.get(f"/descriptions/{made['id']}/abstractions/{kind}", **more)

    def absolute(kind: str, **more: object) -> dict:
        return service.get(f"/instances/{thing['id']}/abstractions/{kind}", **more)

    def extents(document: dict) -> list:
        vertices_m = np.array(document["geometry"]["vertices_m"])
        return [*vertices_m.min(axis=0), *vertices_m.max(axis=0)]

    for kind in get_args(abstractions.AbstractionType):
        found, moved = relative(kind), absolute(kind)
        assert found["type"] == moved["type"] == kind
        if found["geometry"]["type"] == "Surface":
            assert extents(found) == pytest.approx([0, 0, 0, 1, 1, 1])
            assert extents(moved) == pytest.approx([4, 0, 2, 5, 1, 3])
        elif kind.startswith("Position"):
            at = [0.5, 0.5, 0.5][: int(kind[8])]
            assert found["geometry"]["coordinates"] == pytest.approx(at)
        else:
            assert shape(moved["geometry"]).symmetric_difference(shapely.box(4, 0, 5, 1)).area < 1e-9
            assert moved["band"] == {"z_min_m": pytest.approx(2), "z_max_m": pytest.approx(3)}
    # its own front is towards y in the map
    assert extents(relative("FrontProjection", reach_m=2)) == pytest.approx([1, 0, 0, 3, 1, 1])
    assert extents(absolute("FrontProjection", reach_m=2)) == pytest.approx([4, 1, 2, 5, 3, 3])
    assert extents(relative("TopHalfspace", reach_m=1)) == pytest.approx([-1, -1, 1, 2, 2, 2])
    map_T_thing = Pose(**thing["pose"]).matrix()
    for kind in DIRECTIONS:
        own_m = np.array(relative(kind, reach_m=3)["geometry"]["vertices_m"])
        in_map_m = own_m @ map_T_thing[:3, :3].T + map_T_thing[:3, 3]
        expected = [*in_map_m.min(axis=0), *in_map_m.max(axis=0)]
        assert extents(absolute(kind, reach_m=3)) == pytest.approx(expected, abs=1e-9), kind
    bare = service.make_thing("bare")
    for kind in ("Footprint", "LeftProjection"):
        assert service.client.get(f"/instances/{bare['id']}/abstractions/{kind}").status_code == 404
    assert service.client.get(f"/instances/{thing['id']}/abstractions/Soul").status_code == 422
