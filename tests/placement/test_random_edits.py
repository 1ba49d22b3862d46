"""After any edits, where things stand and what is derived from that equal what is computed from nothing.

The oracle keeps its own tree of 4 x 4 matrices and the meshes that it gave. It never reads what the
database derived: it moves every corner of a mesh into the map and derives anew from there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import count

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shapely.ops import unary_union
from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.geometry.ewkb import from_ewkb
from semap.model.building import Mesh
from semap.model.pose import Pose
from semap.model.source_geometry import BODY, SourceGeometry
from semap.store.database.connection import one_transaction
from semap.store.map import blueprints, frames, history
from semap.store.map.instance_edit import delete_instance
from semap.store.map.maps import create_map

NUMBERS = count()
NEAR_M = 1e-7
# A play takes a tenth of a second, so that to shrink one takes longer than to read it.
PLAYS = settings(
    deadline=None,
    phases=[Phase.explicit, Phase.reuse, Phase.generate],
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)

COORDINATE = st.integers(-64, 64).map(lambda n: n / 16)
UPRIGHT = st.builds(
    lambda x, y, z, yaw: (x, y, z, *Rotation.from_euler("z", yaw).as_quat()),
    COORDINATE, COORDINATE, COORDINATE, st.floats(-3.14, 3.14),
)  # fmt: skip
TILTED = st.builds(
    lambda x, y, z, yaw, pitch, roll: (x, y, z, *Rotation.from_euler("zyx", [yaw, pitch, roll]).as_quat()),
    COORDINATE, COORDINATE, COORDINATE, *[st.floats(-3.0, 3.0)] * 3,
)  # fmt: skip
POSE = st.one_of(UPRIGHT, UPRIGHT, TILTED)
ANY = st.integers(0, 100)
EDIT = st.one_of(
    st.tuples(st.just("frame"), ANY, POSE),
    st.tuples(st.just("instance"), ANY, ANY, POSE),
    st.tuples(st.just("move"), ANY, POSE),
    st.tuples(st.just("move"), ANY, POSE),
    st.tuples(st.just("hang"), ANY, ANY, st.booleans()),
    st.tuples(st.just("hang"), ANY, ANY, st.booleans()),
    st.tuples(st.just("reshape"), ANY, ANY, POSE),
    st.tuples(st.just("switch"), ANY, ANY),
    st.tuples(st.just("copy"), ANY),
    st.tuples(st.just("delete"), ANY, st.sampled_from(["delete", "keep"])),
)


def ell() -> Mesh:
    """A concave prism over an L."""
    corners = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    prism = trimesh.creation.extrude_polygon(shapely.Polygon(corners), 0.5)
    return Mesh(np.array(prism.vertices), np.array(prism.faces, dtype=np.int64))


def box(x_m: float, y_m: float, z_m: float) -> Mesh:
    made = trimesh.creation.box(extents=[x_m, y_m, z_m])
    return Mesh(np.array(made.vertices), np.array(made.faces, dtype=np.int64))


SHAPES = [box(1, 2, 0.5), ell(), box(0.25, 0.25, 3)]


def matrix(pose: tuple[float, ...]) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3] = Rotation.from_quat(pose[3:]).as_matrix()
    made[:3, 3] = pose[:3]
    return made


@dataclass
class Model:
    """What the map should be: frames by id with their parent and parent_T_frame, instances, blueprints."""

    connection: Connection
    name: str
    parents: dict[int, int | None] = field(default_factory=dict)
    local: dict[int, np.ndarray] = field(default_factory=dict)
    shapes: dict[int, tuple[Mesh, np.ndarray]] = field(default_factory=dict)
    frame_of: dict[int, int] = field(default_factory=dict)
    looks: dict[int, int | None] = field(default_factory=dict)

    def begin(self) -> None:
        create_map(self.connection, self.name)
        root = frames.frame_named(self.connection, self.name, "map")
        self.parents[root.frame_id], self.local[root.frame_id] = None, np.eye(4)
        for number, shape in enumerate(SHAPES[:2]):
            made = blueprints.create_blueprint(
                self.connection, self.name, f"b{number}", [SourceGeometry(BODY, "TRIANGLEMESH3D", shape)]
            )
            self.shapes[made.description_id] = (shape, np.eye(4))

    def world(self, frame_id: int) -> np.ndarray:
        parent = self.parents[frame_id]
        return self.local[frame_id] if parent is None else self.world(parent) @ self.local[frame_id]

    def below(self, frame_id: int) -> set[int]:
        return {frame_id}.union(
            *(self.below(child) for child, above in self.parents.items() if above == frame_id)
        )

    def pick(self, number: int, among: dict | list) -> int | None:
        keys = sorted(among)
        return keys[number % len(keys)] if keys else None

    def apply(self, edit: tuple) -> None:
        getattr(self, edit[0])(*edit[1:])

    def frame(self, parent: int, pose: tuple) -> int:
        parent_id = self.pick(parent, self.parents)
        above = frames.get_frame(self.connection, parent_id).name
        made = frames.create_frame(
            self.connection, self.name, f"f{next(NUMBERS)}", above, Pose(*pose)
        ).frame_id
        self.parents[made], self.local[made] = parent_id, matrix(pose)
        return made

    def instance(self, parent: int, look: int, pose: tuple) -> None:
        frame_id, description_id = self.frame(parent, pose), self.pick(look, self.shapes)
        made = self.connection.exec_driver_sql(
            "insert into semap.instance (map_id, name, concept_id, frame_id, relative_description_id)"
            " select f.map_id, f.name, c.concept_id, f.frame_id, %s from semap.frame f, semap.concept c"
            " where f.frame_id = %s and c.name = 'Furniture' returning instance_id",
            (description_id, frame_id),
        ).scalar_one()
        self.frame_of[made], self.looks[made] = frame_id, description_id

    def move(self, frame: int, pose: tuple) -> None:
        frame_id = self.pick(frame, self.parents)
        if self.parents[frame_id] is not None:
            frames.set_pose(self.connection, frame_id, Pose(*pose))
            self.local[frame_id] = matrix(pose)

    def hang(self, frame: int, parent: int, keeps_world: bool) -> None:
        frame_id, parent_id = self.pick(frame, self.parents), self.pick(parent, self.parents)
        if self.parents[frame_id] is None:
            return
        above = frames.get_frame(self.connection, parent_id).name
        keep = "world" if keeps_world else "local"
        if parent_id in self.below(frame_id):
            with pytest.raises(InvalidInput, match="cannot be put below"), self.connection.begin_nested():
                frames.change_frame(self.connection, frame_id, above, keep)
            return
        frames.change_frame(self.connection, frame_id, above, keep)
        if keeps_world:
            self.local[frame_id] = np.linalg.inv(self.world(parent_id)) @ self.world(frame_id)
        self.parents[frame_id] = parent_id

    def reshape(self, description: int, shape: int, pose: tuple) -> None:
        description_id, mesh = self.pick(description, self.shapes), SHAPES[shape % len(SHAPES)]
        source = SourceGeometry(BODY, "TRIANGLEMESH3D", mesh, Pose(*pose))
        blueprints.put_geometry(self.connection, description_id, source)
        self.shapes[description_id] = (mesh, matrix(pose))

    def switch(self, instance: int, description: int) -> None:
        instance_id = self.pick(instance, self.frame_of)
        if instance_id is not None:
            description_id = [None, *sorted(self.shapes)][description % 3]
            blueprints.switch_description(self.connection, instance_id, description_id)
            self.looks[instance_id] = description_id

    def copy(self, instance: int) -> None:
        instance_id = self.pick(instance, self.frame_of)
        if instance_id is None:
            return
        copy_id = self.connection.exec_driver_sql(
            "select semap.copy_instance(%s, %s)", (instance_id, f"c{next(NUMBERS)}")
        ).scalar_one()
        frame_id = self.connection.exec_driver_sql(
            "select frame_id from semap.instance where instance_id = %s", (copy_id,)
        ).scalar_one()
        original = self.frame_of[instance_id]
        self.parents[frame_id], self.local[frame_id] = self.parents[original], self.local[original]
        self.frame_of[copy_id], self.looks[copy_id] = frame_id, self.looks[instance_id]

    def delete(self, instance: int, carried: str) -> None:
        instance_id = self.pick(instance, self.frame_of)
        if instance_id is None:
            return
        delete_instance(self.connection, instance_id, carried)
        frame_id = self.frame_of[instance_id]
        if carried == "keep":
            gone = {frame_id}
            for child in [child for child, above in self.parents.items() if above == frame_id]:
                self.local[child] = self.local[frame_id] @ self.local[child]
                self.parents[child] = self.parents[frame_id]
        else:
            gone = self.below(frame_id)
        for each in gone:
            del self.parents[each], self.local[each]
        for each in [each for each, stands in self.frame_of.items() if stands in gone]:
            del self.frame_of[each], self.looks[each]

    def compare(self) -> None:
        poses = self.connection.exec_driver_sql(
            "select frame_id, (pose).x_m, (pose).y_m, (pose).z_m, (pose).qx, (pose).qy, (pose).qz, (pose).qw"
            " from semap.frames_in_root(%s)",
            (list(self.parents),),
        ).all()
        assert {row[0] for row in poses} == set(self.parents)
        for frame_id, *pose in poses:
            np.testing.assert_allclose(matrix(tuple(pose)), self.world(frame_id), atol=1e-9)
        found: dict[int, dict] = {instance_id: {} for instance_id in self.frame_of}
        for instance_id, type_, ewkb in self.connection.exec_driver_sql(
            "select a.instance_id, a.type, st_asewkb(a.geometry) from semap.abstraction a"
            " join semap.instance i using (instance_id) join semap.map m using (map_id) where m.name = %s",
            (self.name,),
        ):
            found[instance_id][type_] = from_ewkb(bytes(ewkb))
        for instance_id, types in found.items():
            look = self.looks[instance_id]
            if look is None:
                assert types == {}
                continue
            mesh, pose = self.shapes[look]
            whole = self.world(self.frame_of[instance_id]) @ pose
            assert_derived(types, mesh.vertices_m @ whole[:3, :3].T + whole[:3, 3], mesh.faces)


def assert_derived(types: dict, corners_m: np.ndarray, faces: np.ndarray) -> None:
    """The absolute abstractions of a solid, from its corners in the map."""
    low, high = corners_m.min(axis=0), corners_m.max(axis=0)
    for type_ in ("AxisAligned3D", "BoundingHull"):
        corners = types[type_].vertices_m
        np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [low, high], atol=NEAR_M)
    hull = trimesh.convex.convex_hull(corners_m)
    kept = types["BoundingHull"]
    assert trimesh.Trimesh(kept.vertices_m, kept.faces).volume == pytest.approx(hull.volume, rel=1e-6)
    np.testing.assert_allclose(
        shapely.get_coordinates(types["Position3D"], include_z=True)[0], hull.center_mass, atol=1e-6
    )
    oriented = types["BoundingBox"]
    around = trimesh.Trimesh(oriented.vertices_m, oriented.faces).convex_hull
    assert around.volume == pytest.approx(hull.bounding_box_oriented.volume, rel=1e-3)
    planes = (
        around.facets_normal @ corners_m.T
        - (around.facets_normal * around.facets_origin).sum(axis=1)[:, None]
    )
    assert planes.max() < 1e-6
    outline = unary_union(
        [each for each in shapely.polygons(corners_m[faces][:, :, :2]) if each.area > 1e-12]
    )
    flat_hull = shapely.MultiPoint(corners_m[:, :2]).convex_hull
    assert types["Footprint"].symmetric_difference(outline.buffer(0)).area < 1e-4 * max(1, outline.area)
    assert types["FootprintHull"].symmetric_difference(flat_hull).area < 1e-6
    assert types["FootprintBox"].area == pytest.approx(flat_hull.minimum_rotated_rectangle.area, rel=1e-6)
    assert types["FootprintBox"].buffer(1e-6).contains(flat_hull)
    np.testing.assert_allclose(types["AxisAligned2D"].bounds, flat_hull.bounds, atol=NEAR_M)
    np.testing.assert_allclose(types["Position2D"].coords[0], flat_hull.centroid.coords[0], atol=1e-6)


def play(dsn: str, edits: list[tuple]) -> None:
    with one_transaction(dsn) as connection:
        model = Model(connection, f"map {next(NUMBERS)}")
        model.begin()
        for edit in edits:
            model.apply(edit)
        model.compare()


@settings(PLAYS, max_examples=12)
@given(edits=st.lists(EDIT, min_size=4, max_size=14))
def test_edits_leave_what_is_computed_from_nothing(database: str, edits: list[tuple]) -> None:
    play(database, edits)


@pytest.mark.slow
@settings(PLAYS, max_examples=1000)
@given(edits=st.lists(EDIT, min_size=10, max_size=40))
def test_many_edits_leave_what_is_computed_from_nothing(database: str, edits: list[tuple]) -> None:
    play(database, edits)


@settings(PLAYS, max_examples=8)
@given(before=st.lists(EDIT, min_size=3, max_size=10), edits=st.lists(EDIT, min_size=1, max_size=6))
def test_undo_of_any_edits_gives_back_the_map(database: str, before: list[tuple], edits: list[tuple]) -> None:
    with one_transaction(database) as connection:
        model = Model(connection, f"map {next(NUMBERS)}")
        model.begin()
        for edit in [("instance", 0, 0, (1, 2, 3, 0, 0, 0, 1)), *before]:
            model.apply(edit)
    with one_transaction(database) as connection:
        shown = snapshot(connection, model.name)
        changed = Model(
            connection, model.name, dict(model.parents), dict(model.local), dict(model.shapes),
            dict(model.frame_of), dict(model.looks),
        )  # fmt: skip
        newest = history.list_change_sets(connection, limit=1)[0].change_set_id
        for edit in edits:
            changed.apply(edit)
    with one_transaction(database) as connection:
        afterwards = snapshot(connection, model.name)
        made = history.list_change_sets(connection, limit=1)[0].change_set_id
        if made != newest:
            history.undo(connection, made)
    with one_transaction(database) as connection:
        assert snapshot(connection, model.name) == shown
        model.connection = connection
        model.compare()
        if made != newest:
            again = history.list_change_sets(connection, limit=1)[0]
            assert again.undoes == made
            history.undo(connection, again.change_set_id)
            assert snapshot(connection, model.name) == afterwards


def snapshot(connection: Connection, name: str) -> dict[str, list[tuple]]:
    """All that a map is made of, without what is derived and without ids that differ."""
    tables = {
        "frame": "select frame_id, f.name, parent_id from semap.frame f join semap.map m using (map_id)",
        "pose": "select p.frame_id, p.x_m, p.y_m, p.z_m, p.qx, p.qy, p.qz, p.qw from semap.frame_pose p join semap.frame using (frame_id) join semap.map m using (map_id)",
        "instance": "select instance_id, i.uid, i.name, concept_id, frame_id, relative_description_id, attributes::text"
        " from semap.instance i join semap.map m using (map_id)",
        "geometry": "select g.geometry_id, g.name, g.type, st_asewkb(g.body)::text, g.x_m, g.y_m, g.z_m, g.qx, g.qy, g.qz, g.qw"
        " from semap.geometry g join semap.description d using (description_id) join semap.map m using (map_id)",
    }
    return {
        table: sorted(
            tuple(row) for row in connection.exec_driver_sql(f"{statement} where m.name = %s", (name,))
        )
        for table, statement in tables.items()
    }
