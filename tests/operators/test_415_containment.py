"""Bodies in, on and across one another, in the map: held against manifold booleans."""

from __future__ import annotations

from collections.abc import Iterator

import manifold3d
import numpy as np
import pytest
import shapely
from furnishing import House, box, room, thing
from shapely import Polygon

from semap.geometry.ewkb import from_ewkb, to_ewkb
from semap.geometry.pose import pose_from_matrix, pose_from_yaw, transform_mesh
from semap.geometry.prism import extrude
from semap.model.building import Mesh
from semap.model.pose import Pose
from semap.store.database.connection import one_transaction

ELL = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])
RING = shapely.box(-3, -3, 3, 3).difference(shapely.box(-2, -2, 2, 2))


@pytest.fixture
def house(database: str) -> Iterator[House]:
    with one_transaction(database, "semap_api") as connection:
        yield House(connection)


def tilted(dice: np.random.Generator, spread_m: float) -> Pose:
    quaternion = dice.normal(size=4)
    quaternion /= np.linalg.norm(quaternion)
    return Pose(*dice.uniform(-spread_m, spread_m, 3), *quaternion)


def pairs(house: House, call: str, **values: object) -> set[tuple[str, str]]:
    names = {id_: name for name, id_ in house.ids.items()}
    return {(names[row[0]], names[row[1]]) for row in house.rows(f"select * from {call}", **values)}


def solid(mesh: Mesh) -> manifold3d.Manifold:
    return manifold3d.Manifold(
        manifold3d.Mesh64(np.asarray(mesh.vertices_m, float), np.asarray(mesh.faces, np.uint64))
    )


def test_concave_bodies_under_any_pose(house: House) -> None:
    dice = np.random.default_rng(7)
    bodies = {
        "hall": (extrude(RING, -3, 3), tilted(dice, 0.5)),
        "shed": (extrude(ELL, 0, 2), tilted(dice, 0.5)),
        **{f"thing {n}": (box(*dice.uniform(0.1, 0.6, 3)), tilted(dice, 1.9)) for n in range(16)},
        "ell": (extrude(shapely.affinity.scale(ELL, 0.4, 0.4), 0, 0.5), tilted(dice, 1.5)),
    }
    house.put(*(thing(name, body, pose) for name, (body, pose) in bodies.items()))
    solids = {name: solid(transform_mesh(pose.matrix(), body)) for name, (body, pose) in bodies.items()}
    within, partly = set(), set()
    for a in ("hall", "shed"):
        for b in solids.keys() - {a}:
            if (solids[b] - solids[a]).volume() < 1e-9:
                within.add((a, b))
            if (solids[b] ^ solids[a]).volume() > 1e-9:
                partly.add((a, b))
    assert 2 <= len(within) < len(partly) < 40
    ids = house.of("hall", "shed")
    assert pairs(house, "semap.in_objects(:ids, null, '3d', true)", ids=ids) == within
    assert pairs(house, "semap.in_objects(:ids, null, '3d')", ids=ids) == partly
    assert pairs(house, "semap.intersecting_objects(:ids, null, '3d')", ids=ids) == partly
    contents = [house.ids[b] for _, b in within]
    assert pairs(house, "semap.in_objects(null, :ids, '3d', true)", ids=contents) >= within
    hall = to_ewkb(transform_mesh(bodies["hall"][1].matrix(), bodies["hall"][0]))
    for strict, expected in ((True, within), (False, partly)):
        rows = house.rows(
            "select * from semap.in_volume(public.st_geomfromewkb(:hall), :map_id, p_strict => :strict)"
            " where target_id <> :id",
            hall=hall, map_id=house.map_id, strict=strict, id=house.ids["hall"],
        )  # fmt: skip
        assert house.named(id_ for (id_,) in rows) == {b for a, b in expected if a == "hall"}


def test_the_body_of_an_instance_is_its_meshes_where_it_stands(house: House) -> None:
    pose = tilted(np.random.default_rng(3), 9)
    body = extrude(ELL, 0, 2)
    house.put(thing("shed", body, pose), room("yard", shapely.box(0, 0, 9, 9)))
    (shed, yard) = house.of("shed", "yard")
    wkb = house.one("select st_asewkb(semap.body_of(:id))", id=shed)
    placed = from_ewkb(bytes(wkb))
    expected = transform_mesh(pose.matrix(), body)
    assert isinstance(placed, Mesh)
    np.testing.assert_allclose(
        placed.vertices_m[placed.faces], expected.vertices_m[expected.faces], rtol=0, atol=1e-12
    )
    assert house.one("select semap.body_of(:id)", id=yard) is None
    house.rows(
        "insert into semap.geometry (description_id, name, type, body, x_m)"
        " select relative_description_id, 'Annexe', 'POLYGONMESH3D',"
        "        st_geomfromtext('POLYHEDRALSURFACE Z (((0 0 0,0 1 0,1 1 0,1 0 0,0 0 0)))'), 5"
        " from semap.instance where instance_id = :id returning 1",
        id=shed,
    )
    both = from_ewkb(bytes(house.one("select st_asewkb(semap.body_of(:id))", id=shed)))
    assert isinstance(both, Mesh)
    added = both.vertices_m[both.faces[len(expected.faces) :]]
    local = (np.linalg.inv(pose.matrix()) @ np.c_[added.reshape(-1, 3), np.ones(added.size // 3)].T).T[:, :3]
    assert len(both.faces) == len(expected.faces) + 2
    np.testing.assert_allclose(
        np.unique(local.round(9) + 0.0, axis=0), [(5, 0, 0), (5, 1, 0), (6, 0, 0), (6, 1, 0)]
    )


def test_bodies_in_rooms_that_have_none(house: House) -> None:
    house.put(
        room("below", shapely.box(0, 0, 4, 4), (0, 3)),
        room("above", shapely.box(0, 0, 4, 4), (3, 6)),
        room("yard", shapely.box(4, 0, 9, 4), None),
        thing("chair", box(0.5, 0.5, 1), Pose(1, 1, 0)),
        thing("lamp", box(0.2, 0.2, 0.5), Pose(2, 2, 2.5)),
        thing("bed", box(2, 2, 0.5), Pose(2, 2, 3)),
        thing("shaft", box(0.5, 0.5, 4), Pose(3.5, 3.5, 1)),
        thing("gate", box(1, 0.1, 2), Pose(4, 2, 0)),
    )
    ids = house.of("below", "above", "yard")
    within = {("below", "chair"), ("below", "lamp"), ("above", "bed")}
    partly = within | {("below", "shaft"), ("above", "shaft"), ("below", "gate"), ("yard", "gate")}
    for mode in ("2d", "3d"):
        assert pairs(house, f"semap.in_objects(:ids, null, '{mode}', true)", ids=ids) == within
        assert pairs(house, f"semap.in_objects(:ids, null, '{mode}')", ids=ids) == partly
    meets = pairs(house, "semap.intersecting_objects(:ids, null, '3d')", ids=ids)
    assert meets == partly | {
        ("above", "lamp"), ("below", "bed"), ("below", "above"), ("above", "below"),
        *((a, b) for a in ("below", "above") for b in ("yard",)), ("yard", "below"), ("yard", "above"),
    }  # fmt: skip


def test_a_position_without_extent_is_in_a_room_too(house: House) -> None:
    house.put(room("room", ELL, (0, 3)), room("near", shapely.box(1, 1, 4, 3), (0, 3)))
    here = [(0.5, 0.5, 1.0, "inside"), (0.5, 0.5, 4.0, "over it"), (2.0, 2.0, 1.0, "beside it")]
    house.put(*(thing(name, box(1, 1, 1), Pose(x, y, z)) for x, y, z, name in here))
    ids = house.of("room")
    for *_, name in here:
        house.rows(
            "with d as (insert into semap.description (map_id) values (:map_id) returning description_id),"
            " a as (insert into semap.abstraction (description_id, type, geometry)"
            "  select description_id, type, shape::public.geometry from d,"
            "  (values ('Position2D', 'point(0 0)'), ('Position3D', 'point z (0 0 0)')) v (type, shape)"
            "  returning description_id)"
            " update semap.instance set relative_description_id = (select max(description_id) from a)"
            " where instance_id = :id returning 1", map_id=house.map_id, id=house.ids[name],
        )  # fmt: skip
    for mode in ("2d", "3d"):
        for strict in ("true", "false"):
            assert pairs(house, f"semap.in_objects(:ids, null, '{mode}', {strict})", ids=ids) == {
                ("room", "inside")
            }
    assert pairs(house, "semap.in_objects(null, :ids)", ids=house.of("inside")) == {("room", "inside")}


def test_what_rests_on_what(house: House) -> None:
    shelf = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    for height_m in (0.0, 0.5, 1.0, 1.5):
        board = extrude(shapely.box(-1, -0.2, 1, 0.2), height_m, height_m + 0.02)
        shelf = Mesh(
            np.concatenate([shelf.vertices_m, board.vertices_m]),
            np.concatenate([shelf.faces, board.faces + len(shelf.vertices_m)]),
        )
    house.put(
        room("floor", shapely.box(-9, -9, 9, 9), (-0.2, 0.0)),
        thing("shelf", shelf, pose_from_yaw(2, 2, 0, 0.7)),
        thing("book", box(0.2, 0.2, 0.3), pose_from_yaw(2, 2, 0.52, 1.1)),
        thing("vase", box(0.2, 0.2, 0.3), Pose(2.2, 2.2, 1.53)),
        thing("balloon", box(0.2, 0.2, 0.2), Pose(2, 2, 0.75)),
        thing("table", extrude(ELL, 0, 0.7), pose_from_yaw(-5, -5, 0, 0.3)),
        thing("cup", box(0.1, 0.1, 0.1), Pose(-4.5, -4.5, 0.7)),
        thing("fly", box(0.1, 0.1, 0.1), Pose(-3, -3, 0.7)),
        thing(
            "cube",
            box(1, 1, 1),
            pose_from_matrix([[1, 0, 0, 5], [0, 0, -1, 5], [0, 1, 0, 0.5], [0, 0, 0, 1]]),
        ),
        thing("ball", box(0.2, 0.2, 0.2), Pose(5, 4.5, 1.04)),
    )
    gaps = house.rows("select * from semap.on_objects(null)")
    names = {id_: name for name, id_ in house.ids.items()}
    assert {(names[a], names[b]): round(gap_m, 9) + 0.0 for a, b, gap_m in gaps} == {
        ("floor", "shelf"): 0, ("floor", "table"): 0, ("floor", "cube"): 0,
        ("shelf", "book"): 0, ("shelf", "vase"): 0.01, ("table", "cup"): 0, ("cube", "ball"): 0.04,
    }  # fmt: skip
    assert pairs(house, "semap.on_objects(:ids, p_tolerance_m => 0.02)", ids=house.of("cube")) == set()
    assert pairs(house, "semap.on_objects(null, :ids)", ids=house.of("cup")) == {("table", "cup")}
