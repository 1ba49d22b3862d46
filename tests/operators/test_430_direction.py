"""Directions, held against half-spaces and linear programmes over the corners of convex hulls."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import shapely
from furnishing import House, box, room, thing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from sqlalchemy.exc import DBAPIError

from semap.geometry.direction import DIRECTIONS, direction_region
from semap.geometry.ewkb import from_ewkb
from semap.geometry.pose import pose_from_matrix, pose_from_yaw, transform_mesh, transform_points
from semap.geometry.prism import extrude
from semap.model.building import Mesh
from semap.model.pose import Pose
from semap.store.database.connection import one_transaction

ELL = shapely.Polygon([(0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 1.5), (0, 1.5)])
REACH_M = 3.0

# the normal of the side on which a thing lies: in its own axes (REP 103), and in those of who looks along x
SIDES = {
    "above": "Top",
    "below": "Bot",
    "left_of": "Left",
    "right_of": "Right",
    "in_front_of": "Front",
    "behind": "Back",
}


@pytest.fixture
def house(database: str) -> Iterator[House]:
    with one_transaction(database, "semap_api") as connection:
        other = House(connection, "next door")
        other.put(thing("everything", box(9, 9, 9)))
        yield House(connection)


def found(house: House, call: str, **values: object) -> set[tuple[str, str]]:
    names = {id_: name for name, id_ in house.ids.items()}
    return {(names[a], names[b]) for a, b, _ in house.rows(f"select * from {call}", **values)}


def meets(points_m: np.ndarray, low_m: np.ndarray, high_m: np.ndarray) -> float:
    """How deep [m] the convex hull of points reaches into a box; negative where it stays away."""
    count = len(points_m)
    # weights of the corners and a depth: the mean lies in the box, at least that deep
    rows = np.vstack([np.c_[points_m.T, np.ones(3)], np.c_[-points_m.T, np.ones(3)]])
    solution = linprog(
        [0] * count + [-1], A_ub=rows, b_ub=[*high_m, *-low_m], A_eq=[[1] * count + [0]], b_eq=[1],
        bounds=[(0, None)] * count + [(None, None)],
    )  # fmt: skip
    return float(-solution.fun)


def region(points_m: np.ndarray, side: str, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner of a region around points, in their own axes."""
    mesh = direction_region(side + kind.capitalize(), points_m.min(axis=0), points_m.max(axis=0), REACH_M)
    return mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)


@st.composite
def scenes(draw: st.DrawFn) -> dict[str, tuple[Mesh, Pose]]:
    """Concave things, some upright, some lying or tilted, some upon or against one another."""
    things = {}
    for n in range(draw(st.integers(2, 5))):
        x, y, z = (draw(st.integers(-6, 6)) / 2 for _ in range(3))
        turn = draw(st.sampled_from(["none", "yaw", "any"]))
        if turn == "any":
            quaternion = np.array(draw(st.tuples(*[st.integers(-9, 9)] * 4).filter(any)), float)
            pose = Pose(x, y, z, *(quaternion / np.linalg.norm(quaternion)))
        else:
            pose = pose_from_yaw(x, y, z, draw(st.integers(0, 62)) / 10 if turn == "yaw" else 0)
        body = box(1, 1.5, 0.5) if draw(st.booleans()) else extrude(ELL, 0, draw(st.sampled_from([0.5, 1.0])))
        things[f"thing {n}"] = (body, pose)
    return things


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    scene=scenes(),
    kind=st.sampled_from(["projection", "halfspace"]),
    look=st.tuples(st.integers(-9, 9), st.integers(-9, 9)),
)
def test_every_direction_in_every_frame(house: House, scene: dict, kind: str, look: tuple[int, int]) -> None:
    viewer = Pose(look[0] + 0.123, look[1] + 0.217, 1.5)
    with house.undone():
        house.put(*(thing(name, body, pose) for name, (body, pose) in scene.items()))
        corners = {
            name: transform_points(pose.matrix(), body.vertices_m) for name, (body, pose) in scene.items()
        }
        for frame in ("object", "map", "viewer"):
            axes = {name: axes_of(frame, corners[name], pose, viewer) for name, (_, pose) in scene.items()}
            for direction, side in SIDES.items():
                if frame == "viewer":  # whoever looks has the near side in front
                    side = {"Front": "Back", "Back": "Front"}.get(side, side)  # noqa: PLW2901
                strict, relaxed, unsure = set(), set(), set()
                for a in scene:
                    low, high = region(corners[a] @ axes[a], side, kind)
                    for b in scene.keys() - {a}:
                        points = corners[b] @ axes[a]
                        margin = min((points - low).min(), (high - points).min())
                        depth = meets(points, low, high)
                        if margin > -1e-6:
                            strict.add((a, b))
                        if depth > 1e-6 or margin > -1e-6:
                            relaxed.add((a, b))
                        if (abs(margin) > 1e-9 and abs(margin + 1e-6) < 9e-7) or 1e-9 < depth < 1e-5:
                            unsure.add((a, b))
                call = "semap.directed(:direction, :ids, null, :frame, cast(:viewer as semap.pose), :kind, :strict, :reach)"
                values = {
                    "direction": direction, "ids": house.of(*scene), "frame": frame, "kind": kind, "reach": REACH_M,
                    "viewer": f"({viewer.x_m},{viewer.y_m},{viewer.z_m},0,0,0,1)",
                }  # fmt: skip
                assert found(house, call, strict=True, **values) - unsure == strict - unsure
                assert found(house, call, strict=False, **values) - unsure == relaxed - unsure


def axes_of(frame: str, corners_m: np.ndarray, pose: Pose, viewer: Pose) -> np.ndarray:
    """The axes (columns) in which directions around a thing are meant, in the map."""
    if frame == "object":
        return pose.matrix()[:3, :3]
    if frame == "map":
        return np.eye(3)
    flat = shapely.convex_hull(shapely.multipoints(corners_m[:, :2])).centroid
    ahead = np.array([flat.x - viewer.x_m, flat.y - viewer.y_m, 0])
    ahead /= np.linalg.norm(ahead)
    return np.column_stack([ahead, np.cross([0, 0, 1], ahead), [0, 0, 1]])


def test_the_twelve_regions_are_those_of_the_geometry_package(house: House) -> None:
    body = extrude(ELL, 0, 1)
    pose = pose_from_matrix(np.array([[0, -1, 0, 3], [0, 0, -1, 2], [1, 0, 0, 1], [0, 0, 0, 1.0]]))
    house.put(thing("ell", body, pose), room("yard", shapely.box(0, 0, 4, 2), (0, 2)))
    for name in DIRECTIONS:
        made = direction_region(name, body.vertices_m.min(axis=0), body.vertices_m.max(axis=0), 2.5)
        expected = transform_mesh(pose.matrix(), made)
        wkb = house.one("select st_asewkb(semap.region_of(:id, :name, 2.5))", id=house.ids["ell"], name=name)
        said = from_ewkb(bytes(wkb))
        assert isinstance(said, Mesh)
        assert rounded(said) == rounded(expected)
        assert house.one(
            "select semap.volume_3d(semap.region_of(:id, :name, 2.5))", id=house.ids["ell"], name=name
        ) == pytest.approx(float(np.prod(np.ptp(made.vertices_m, axis=0))))
    top = house.one("select st_asewkb(semap.region_of(:id, 'TopProjection', 1, 'map'))", id=house.ids["yard"])
    said = from_ewkb(bytes(top))
    assert isinstance(said, Mesh)
    assert [*said.vertices_m.min(axis=0), *said.vertices_m.max(axis=0)] == [0, 0, 2, 4, 2, 3]


def rounded(mesh: Mesh) -> set[tuple[float, ...]]:
    return {tuple(row) for row in mesh.vertices_m.round(9) + 0.0}


def test_what_a_robot_is_told(house: House) -> None:
    """A cup on a table, a lamp over it, a chair on either side; the robot looks along y."""
    house.put(
        thing("table", box(1, 1, 0.7)),
        thing("cup", box(0.1, 0.1, 0.1), Pose(0.2, 0.2, 0.7)),
        thing("lamp", box(0.8, 0.8, 0.2), Pose(0.2, 0.3, 1.8)),
        thing("west", box(0.4, 0.4, 0.9), Pose(-1, 0, 0)),
        thing("east", box(0.4, 0.4, 0.9), Pose(1, 0, 0)),
        thing("far", box(0.4, 0.4, 0.9), Pose(0, 2, 0)),
        thing("near", box(0.4, 0.4, 0.9), Pose(0, -2, 0)),
    )
    table = house.of("table")
    eyes = "p_frame => 'viewer', p_viewer => row(0, -5, 1.2, 0, 0, 0, 1)::semap.pose"
    assert found(house, "semap.above(:ids)", ids=table) == {("table", "cup"), ("table", "lamp")}
    assert found(house, "semap.above(:ids, p_strict => true)", ids=table) == {
        ("table", "cup")
    }  # the lamp juts out
    assert found(house, "semap.above(:ids, p_reach_m => 0.5)", ids=table) == {("table", "cup")}
    assert found(house, "semap.below(:ids, p_reach_m => 1.5)", ids=house.of("lamp")) == {
        ("lamp", "table"),
        ("lamp", "cup"),
    }
    for name, who in (("left_of", "west"), ("right_of", "east"), ("in_front_of", "near"), ("behind", "far")):
        assert found(house, f"semap.{name}(:ids, {eyes})", ids=table) == {("table", who)}
    assert found(house, "semap.in_front_of(:ids)", ids=table) == {("table", "east")}
    assert found(house, "semap.left_of(:ids, p_frame => 'map')", ids=table) == {("table", "far")}
    assert found(house, f"semap.left_of(null, :ids, {eyes})", ids=house.of("west")) == {
        (who, "west") for who in ("table", "cup", "east")
    }
    gaps = house.rows("select target_id, gap_m from semap.above(:ids)", ids=table)
    assert {(*house.named([id_]), round(gap_m, 9)) for id_, gap_m in gaps} == {("cup", 0.0), ("lamp", 1.1)}


@pytest.mark.parametrize(
    ("call", "hint"),
    [
        ("semap.directed('beside', array[1])", "Use above"),
        ("semap.above(array[1], p_kind => 'cone')", "Use projection"),
        ("semap.above(array[1::bigint], p_frame => 'room')", "Use object"),
        ("semap.above(array[1::bigint], p_frame => 'viewer')", "pose of the viewer"),
        ("semap.region_of(1, 'UpProjection')", "TopProjection"),
        ("semap.region_of(1, 'TopProjection', 0)", "above 0"),
    ],
)
def test_what_is_unknown_is_refused_with_its_remedy(house: House, call: str, hint: str) -> None:
    house.put(thing("thing", box(1, 1, 1)))
    call = call.replace("array[1::bigint]", f"array[{house.ids['thing']}]").replace(
        "(1,", f"({house.ids['thing']},"
    )
    with pytest.raises(DBAPIError, match=hint), house.connection.begin_nested():
        house.rows(f"select * from {call}")
