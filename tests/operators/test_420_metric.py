"""Distances in SQL, held against shapely and, in space, against the vertices and faces themselves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import shapely
import trimesh
from furnishing import House, box, room, thing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import Polygon
from shapely.affinity import rotate, translate
from sqlalchemy.exc import DBAPIError

from semap.geometry.pose import pose_from_yaw, transform_points
from semap.geometry.prism import extrude
from semap.geometry.tin import mesh_to_wkb
from semap.model.building import Mesh
from semap.model.pose import Pose
from semap.store.database.connection import one_transaction

ELL = Polygon([(0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 1.5), (0, 1.5)])


@pytest.fixture
def house(database: str) -> Iterator[House]:
    with one_transaction(database, "semap_api") as connection:
        other = House(connection, "next door")
        other.put(thing("everything", box(1, 1, 1)), room("yard", shapely.box(-99, -99, 99, 99), None))
        yield House(connection)


@st.composite
def scenes(draw: st.DrawFn) -> dict[str, Polygon]:
    """Concave things anywhere, in one another too."""
    places = draw(
        st.lists(st.tuples(*[st.integers(-40, 40)] * 3, st.sampled_from([0.3, 1, 4])), min_size=3, max_size=7)
    )
    return {
        f"thing {n}": translate(
            rotate(shapely.affinity.scale(ELL, size, size, origin=(0, 0)), 9 * turn, (0, 0)), x / 4, y / 4
        )
        for n, (x, y, turn, size) in enumerate(places)
    }


def ranks(house: House, call: str, **values: object) -> dict[tuple[str, str], float]:
    names = {id_: name for name, id_ in house.ids.items()}
    return {(names[a], names[b]): d for a, b, d, *_ in house.rows(f"select * from {call}", **values)}


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scene=scenes(), data=st.data())
def test_distances_of_footprints(house: House, scene: dict[str, Polygon], data: st.DataObject) -> None:
    with house.undone():
        house.put(*(room(name, area, None) for name, area in scene.items()))
        names = sorted(scene)
        references = data.draw(st.sets(st.sampled_from(names), min_size=1))
        targets = data.draw(st.none() | st.sets(st.sampled_from(names), min_size=1))
        ids = {"r": house.of(*references), "t": None if targets is None else house.of(*targets)}
        pairs = [(a, b) for a in references for b in targets or names if a != b]
        near = {(a, b): scene[a].distance(scene[b]) for a, b in pairs}
        far = {
            (a, b): greatest(shapely.get_coordinates(scene[a]), shapely.get_coordinates(scene[b]))
            for a, b in pairs
        }
        assert ranks(house, "semap.distances(:r, cast(:t as bigint[]))", **ids) == pytest.approx(
            near, abs=1e-9
        )
        assert ranks(
            house, "semap.distances(:r, cast(:t as bigint[]), p_mode => 'max')", **ids
        ) == pytest.approx(far, abs=1e-9)

        low, high = data.draw(st.sampled_from([(0, 3.01), (1.001, 6.003), (0, 0)]))
        within = {pair: d for pair, d in near.items() if low <= d <= high}
        call = "semap.within_range(:r, cast(:t as bigint[]), :low, :high)"
        assert ranks(house, call, low=low, high=high, **ids) == pytest.approx(within, abs=1e-9)
        fully = {pair: d for pair, d in within.items() if far[pair] <= high}
        call = "semap.within_range(:r, cast(:t as bigint[]), :low, :high, true)"
        assert ranks(house, call, low=low, high=high, **ids) == pytest.approx(fully, abs=1e-9)
        backwards = ranks(house, "semap.within_range(null, :r, :low, :high)", low=low, high=high, r=ids["r"])
        assert backwards.keys() == {
            (b, a) for a in references for b in names if a != b and low <= scene[a].distance(scene[b]) <= high
        }

        count = data.draw(st.integers(1, 3))
        found = house.rows(
            "select * from semap.nearest(:r, cast(:t as bigint[]), :count)", count=count, **ids
        )
        for a in references:
            mine = [(target, d, rank) for reference, target, d, rank in found if reference == house.ids[a]]
            expected = sorted((d, house.ids[b]) for (r, b), d in near.items() if r == a)[:count]
            assert [rank for *_, rank in mine] == list(range(1, len(expected) + 1))
            np.testing.assert_allclose([d for _, d, _ in mine], [d for d, _ in expected], rtol=0, atol=1e-9)
            for target, d, _ in mine:
                (name,) = house.named([target])
                assert near[a, name] == pytest.approx(d, abs=1e-9)


def greatest(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a[:, None] - b[None], axis=2).max())


def furnish_space(house: House, seed: int) -> dict[str, tuple[Mesh, np.ndarray]]:
    """Concave bodies under any pose; gives them with map_T_instance."""
    dice = np.random.default_rng(seed)
    bodies = {}
    for n in range(9):
        quaternion = dice.normal(size=4)
        pose = Pose(*dice.uniform(-3, 3, 3), *(quaternion / np.linalg.norm(quaternion)))
        bodies[f"thing {n}"] = (extrude(ELL, 0, float(dice.uniform(0.2, 2))), pose)
    inner = transform_points(bodies["thing 0"][1].matrix(), [[0.3, 0.3, 0.1]])[0]
    bodies["seed"] = (box(0.02, 0.02, 0.02), Pose(*inner))
    house.put(*(thing(name, body, pose) for name, (body, pose) in bodies.items()))
    return {name: (body, pose.matrix()) for name, (body, pose) in bodies.items()}


def test_distances_in_space(house: House) -> None:
    bodies = furnish_space(house, 5)
    corners = {name: transform_points(pose, body.vertices_m) for name, (body, pose) in bodies.items()}
    hulls = {name: trimesh.convex.convex_hull(points) for name, points in corners.items()}
    ids = {"r": house.of("thing 0", "thing 1", "seed")}
    pairs = [(a, b) for a in ("thing 0", "thing 1", "seed") for b in bodies if a != b]
    gaps = {(a, b): hull_gap(hulls[a], hulls[b]) for a, b in pairs}
    assert gaps["thing 0", "seed"] == 0
    space = "p_abstraction => 'BoundingHull'"
    assert ranks(house, f"semap.distances(:r, {space})", **ids) == pytest.approx(gaps, abs=1e-7)
    assert ranks(house, f"semap.distances(:r, {space}, p_mode => 'max')", **ids) == pytest.approx(
        {(a, b): greatest(corners[a], corners[b]) for a, b in pairs}, abs=1e-9
    )
    assert ranks(house, f"semap.within_range(:r, null, 0, 1.5, {space})", **ids) == pytest.approx(
        {pair: d for pair, d in gaps.items() if d <= 1.5}, abs=1e-7
    )
    found = house.rows(f"select * from semap.nearest(:r, null, 4, {space})", **ids)
    for a in ("thing 0", "thing 1", "seed"):
        expected = sorted(d for (r, _), d in gaps.items() if r == a)[:4]
        np.testing.assert_allclose(
            [d for r, _, d, _ in found if r == house.ids[a]], expected, rtol=0, atol=1e-7
        )
    some = house.of("thing 2", "thing 3", "thing 4")
    few = house.rows(f"select * from semap.nearest(:r, :t, 2, {space})", t=some, **ids)
    every = house.rows(f"select * from semap.nearest(:r, :t, 2, {space})", t=some + [-1] * 1001, **ids)
    assert few == every
    bodies_gap = ranks(
        house, "semap.distances(:r, :t, 'Body')", r=house.of("thing 0"), t=house.of("seed", "thing 1")
    )
    assert bodies_gap["thing 0", "seed"] == 0
    assert bodies_gap["thing 0", "thing 1"] >= gaps["thing 0", "thing 1"] - 1e-9


def hull_gap(a: trimesh.Trimesh, b: trimesh.Trimesh) -> float:
    """The distance of two convex bodies: a quadratic programme over their corners."""
    from scipy.optimize import nnls  # noqa: PLC0415

    # least |sum(u a) - sum(v b)| with u, v >= 0 that each sum to 1, as a large weight makes them
    weight = 1e6
    matrix = np.block([
        [a.vertices.T, -b.vertices.T],
        [np.full((1, len(a.vertices)), weight), np.zeros((1, len(b.vertices)))],
        [np.zeros((1, len(a.vertices))), np.full((1, len(b.vertices)), weight)],
    ])  # fmt: skip
    parts, _ = nnls(matrix, np.array([0, 0, 0, weight, weight]))
    gap = a.vertices.T @ parts[: len(a.vertices)] - b.vertices.T @ parts[len(a.vertices) :]
    return float(np.linalg.norm(gap)) if np.linalg.norm(gap) > 1e-7 else 0.0


def test_the_points_are_so_far_apart_and_lie_on_both(house: House) -> None:
    house.put(
        thing("a", extrude(ELL, 0, 1), pose_from_yaw(0, 0, 0, 0.3)),
        thing("b", extrude(ELL, 0, 1), pose_from_yaw(5, 1, 3, 2)),
    )
    for reference, target in (("Footprint", "Footprint"), ("Position2D", "FootprintHull"), ("BoundingHull", "AxisAligned3D"),
                              ("Position3D", "BoundingBox"), ("BoundingHull", "Footprint"), ("Body", "Body")):  # fmt: skip
        for mode in ("min", "max"):
            ((d, between, on_a, on_b, flat),) = house.rows(
                "select distance_m, case when st_zmflag(reference_point) = 2 then st_3ddistance(reference_point, target_point)"
                "  else st_distance(reference_point, target_point) end,"
                " case when st_zmflag(reference_point) = 2 then st_3ddistance(reference_point, r.shape)"
                "  else st_distance(reference_point, st_force2d(r.shape)) end,"
                " case when st_zmflag(target_point) = 2 then st_3ddistance(target_point, t.shape)"
                "  else st_distance(target_point, st_force2d(t.shape)) end, st_zmflag(reference_point) = 0"
                " from semap.distances(:a, :b, p_mode => :mode, p_reference_abstraction => :ra, p_target_abstraction => :ta),"
                " semap.shape_of(reference_id, :ra) r (shape), semap.shape_of(target_id, :ta) t (shape)",
                a=house.of("a"), b=house.of("b"), mode=mode, ra=reference, ta=target,
            )  # fmt: skip
            assert d == pytest.approx(between, abs=1e-9)
            assert max(on_a, on_b) < 1e-7
            assert flat == ("2D" in reference + target or "Foot" in reference + target)


def test_the_nearest_to_a_point(house: House) -> None:
    house.put(*(thing(f"thing {n}", box(1, 1, 1), Pose(3 * n, 0, n)) for n in range(6)))
    rows = house.rows("select * from semap.nearest_to('point(7 0)', :map_id, 3)", map_id=house.map_id)
    assert [(*house.named([id_]), d, rank) for id_, d, rank in rows] == [
        ("thing 2", 0.5, 1), ("thing 3", 1.5, 2), ("thing 1", 3.5, 3),
    ]  # fmt: skip
    rows = house.rows(
        "select * from semap.nearest_to('point z (6 0 2.25)', :map_id, 2, :ids, 'AxisAligned3D')",
        map_id=house.map_id, ids=house.of("thing 1", "thing 2", "thing 5"),
    )  # fmt: skip
    assert [(*house.named([id_]), d) for id_, d, _ in rows] == [
        ("thing 2", 0), ("thing 1", pytest.approx(np.hypot(2.5, 0.25))),
    ]  # fmt: skip
    every = house.rows(
        "select * from semap.nearest_to('point z (6 0 2.25)', :m, 1, null, 'AxisAligned3D')", m=house.map_id
    )
    assert [(*house.named([id_]), d) for id_, d, _ in every] == [("thing 2", 0)]


def test_the_nearest_of_many_that_touch_and_cross(house: House) -> None:
    """Where many are as near as one another, and rounding could put them in another order than their boxes."""
    house.put(
        *(
            thing(f"thing {x} {y} {z}", box(1, 1, 1), pose_from_yaw(x, y, z, 0.1 * ((x + y + z) % 3)))
            for x in range(6) for y in range(6) for z in range(2)
        )
    )  # fmt: skip
    for space in ("BoundingHull", "FootprintHull", "Position3D"):
        every = house.rows(
            "select * from semap.distances(null, :t, :space)", t=list(house.ids.values()), space=space
        )
        found = house.rows(
            "select * from semap.nearest(null, :t, 7, :space)", t=list(house.ids.values()), space=space
        )
        assert len(found) == 7 * len(house.ids)
        for id_ in house.ids.values():
            nearest = sorted(d for r, _, d, *_ in every if r == id_)[:7]
            mine = [d for r, _, d, _ in found if r == id_]
            np.testing.assert_allclose(mine, nearest, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("call", "hint"),
    [
        ("semap.distances(array[1], p_mode => 'mean')", "Use min or max"),
        ("semap.distances(array[1], p_abstraction => 'Shadow')", "Use Footprint"),
        ("semap.within_range(array[1], p_target_abstraction => 'Position3D')", "two flat abstractions"),
        ("semap.nearest_to('point(0 0)', 1, p_abstraction => 'Position3D')", "POINT Z"),
    ],
)  # fmt: skip
def test_what_cannot_be_measured_is_refused_with_its_remedy(house: House, call: str, hint: str) -> None:
    with pytest.raises(DBAPIError, match=hint), house.connection.begin_nested():
        house.rows(f"select * from {call}")


def test_a_corner_on_a_face_touches_it_whatever_postgis_says(house: House) -> None:
    """PostGIS 3.3 gives 0.94 m for this corner of one, which lies within a face of the other."""
    corner = np.array([-0.6666666666666666, -2, -0.6666666666666666])
    faces = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    meshes = [
        Mesh(np.array([[2.0, -2, -2], [-2, -2, 2], [-2, -2, -2], [0, 0, 0]]), faces),
        Mesh(corner + np.array([[0, 0, 0], [0.1, -1, 0], [-0.1, -1, 0.1], [0, -1, -0.1]]), faces),
    ]
    a, b = (mesh_to_wkb(mesh) for mesh in meshes)
    row = house.connection.exec_driver_sql(
        "select semap.gap_3d(a, b), semap.gap_3d(b, a), st_3dlength(line), st_distance(st_startpoint(line), %s::geometry)"
        " from (select st_geomfromewkb(%s) as a, st_geomfromewkb(%s) as b) s,"
        " lateral (select semap.shortest_line_3d(a, b, true) as line) l",
        (shapely.Point(*corner[:2]).wkt, a, b),
    ).one()
    assert tuple(row[:3]) == (0, 0, 0)
    assert row[3] < 1e-6
