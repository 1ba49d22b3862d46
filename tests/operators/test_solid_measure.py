"""Sums over meshes, and things that are no solids: points, lines, open surfaces, imperfect meshes."""

from collections.abc import Iterator

import numpy as np
import psycopg
import pytest
import shapely
import solid_oracle as oracle

from semap.geometry.tin import mesh_to_wkb
from semap.model.building import Mesh
from semap.store.database.connection import connect


def room() -> oracle.Solid:
    """An L-shaped room."""
    return oracle.box((4, 4, 3), (0, 0, 0)) - oracle.box((2, 2, 3), (2, 2, 0))


@pytest.fixture(scope="module")
def connection(cluster, template) -> Iterator[psycopg.Connection]:
    """A session in the migrated database that is only read from here."""
    with connect(cluster.dsn(template)) as session:
        yield session


def ask(connection: psycopg.Connection, name: str, *values: object):
    places = ", ".join("%s::bytea::public.geometry" if isinstance(v, bytes) else "%s" for v in values)
    return connection.execute(f"select semap.{name}({places})", values).fetchone()[0]


def content(text: str) -> bytes:
    return shapely.to_wkb(shapely.from_wkt(text), output_dimension=3)


@pytest.mark.parametrize("seed", range(14))
def test_sums_agree_with_booleans(connection, seed):
    solid, _ = oracle.pair(seed)
    mesh = oracle.wkb(solid)
    assert ask(connection, "volume_3d", mesh) == pytest.approx(solid.volume(), rel=1e-9)
    assert ask(connection, "area_3d", mesh) == pytest.approx(solid.surface_area(), rel=1e-9)
    assert ask(connection, "is_closed_3d", mesh)


@pytest.mark.parametrize("seed", range(7))
def test_points_agree_with_booleans(connection, seed):
    solid, _ = oracle.pair(seed)
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    random = np.random.default_rng(seed)
    for point in random.uniform(low, high, (20, 3)):
        speck = oracle.box((2e-4, 2e-4, 2e-4), tuple(point - 1e-4))
        shared = (solid ^ speck).volume() / speck.volume()
        if shared < 0.01 or shared > 0.99:
            x, y, z = point.tolist()
            place = content(f"POINT Z({x!r} {y!r} {z!r})")
            assert ask(connection, "inside_3d", oracle.wkb(solid), place) == (shared > 0.5)


def test_distances_to_points_lines_and_nothing(connection):
    cube = oracle.wkb(oracle.box((1, 1, 1), (0, 0, 0)))
    assert ask(connection, "distance_3d", cube, content("POINT Z(1e-200 0.5 1.5)")) == pytest.approx(0.5)
    assert ask(connection, "distance_3d", cube, content("POINT Z(0.5 0.5 0.5)")) == 0
    assert ask(connection, "distance_3d", cube, content("LINESTRING Z(4 -9 5,4 9 5)")) == pytest.approx(5)
    assert ask(connection, "distance_3d", cube, content("POINT Z EMPTY")) is None
    assert ask(connection, "contains_3d", cube, content("POINT Z EMPTY")) is False


def test_a_point_over_a_face_is_on_it(connection):
    """ST_3DDistance of PostGIS 3.3 says 0.94 m."""
    face = content("POLYGON Z((2 -2 -2,-2 -2 2,-2 -2 -2,2 -2 -2))")
    assert (
        ask(connection, "distance_3d", face, content("POINT Z(-0.6666666666666666 -2 -0.6666666666666666)"))
        == 0
    )


def test_one_triangle_less_is_not_closed(connection):
    corners, faces = oracle.corners_and_faces(room())
    assert not ask(connection, "is_closed_3d", mesh_to_wkb(Mesh(corners, faces[1:])))


@pytest.mark.parametrize(
    ("text", "contained", "intersects"),
    [
        ("POINT Z(1 1 1)", True, True),
        ("POINT Z(1 1 0)", True, True),
        ("POINT Z(3 3 1)", False, False),
        ("MULTIPOINT Z(1 1 1,3 3 1)", False, True),
        ("MULTIPOINT Z(3 3 1,3 3 2,3 3 3,1 1 1,9 9 9)", False, True),
        ("LINESTRING Z(0.5 3.5 1,0.5 0.5 1,3.5 0.5 1)", True, True),
        ("LINESTRING Z(0.5 3.5 1,3.5 0.5 1)", True, True),  # through the inner edge
        ("LINESTRING Z(0.6 3.5 1,3.5 0.6 1)", False, True),  # cuts the notch, both ends inside
        ("LINESTRING Z(2 3.5 1,2 0 1)", True, True),  # along a wall of the notch
        ("LINESTRING Z(2 0 3,2 4 3)", True, True),  # along an edge, past a corner
        ("LINESTRING Z(3 3 1,3 3.5 1)", False, False),
        ("LINESTRING Z(3 3 -1,3 3 9)", False, False),
        ("POLYGON Z((0 0 0,4 0 0,4 2 0,2 2 0,2 4 0,0 4 0,0 0 0))", True, True),  # the floor
        ("POLYGON Z((0 0 1,4 0 1,4 4 1,0 4 1,0 0 1))", False, True),  # covers the notch
        ("POLYGON Z((0 0 0,0 4 0,0 4 3,0 0 3,0 0 0))", True, True),  # a wall
        ("POLYGON Z((3 3 1,3.5 3 1,3.5 3.5 1,3 3 1))", False, False),
    ],
)
def test_points_lines_and_surfaces_in_a_room(connection, text, contained, intersects):
    assert ask(connection, "contains_3d", oracle.wkb(room()), content(text)) is contained
    assert ask(connection, "intersects_3d", oracle.wkb(room()), content(text)) is intersects


def test_faces_with_more_corners_are_the_same_solid(connection):
    faces = [
        "((0 0 0,0 4 0,2 4 0,2 2 0,4 2 0,4 0 0,0 0 0))", "((0 0 3,4 0 3,4 2 3,2 2 3,2 4 3,0 4 3,0 0 3))",
        "((0 0 0,4 0 0,4 0 3,0 0 3,0 0 0))", "((4 0 0,4 2 0,4 2 3,4 0 3,4 0 0))",
        "((4 2 0,2 2 0,2 2 3,4 2 3,4 2 0))", "((2 2 0,2 4 0,2 4 3,2 2 3,2 2 0))",
        "((2 4 0,0 4 0,0 4 3,2 4 3,2 4 0))", "((0 4 0,0 0 0,0 0 3,0 4 3,0 4 0))",
    ]  # fmt: skip
    row = connection.execute(
        "select semap.volume_3d(room), semap.area_3d(room), semap.is_closed_3d(room),"
        " semap.contains_3d(room, tin), semap.contains_3d(tin, room)"
        " from (select st_geomfromtext(%s) as room, %s::bytea::public.geometry as tin offset 0) given",
        (f"POLYHEDRALSURFACE Z({','.join(faces)})", oracle.wkb(room())),
    ).fetchone()
    assert row == (pytest.approx(36), pytest.approx(room().surface_area()), True, True, True)


def imperfect_meshes() -> dict[str, Mesh]:
    corners, faces = oracle.corners_and_faces(room())
    return {
        "a hole": Mesh(corners, faces[1:]),
        "a triangle twice": Mesh(corners, np.vstack([faces, faces[:1]])),
        "a triangle without area": Mesh(corners, np.vstack([faces, [[0, 0, 1]]])),
        "one wound the other way": Mesh(corners, np.vstack([faces[:1, ::-1], faces[1:]])),
        "only a triangle": Mesh(corners, faces[:1]),
        "a point": Mesh(np.zeros((1, 3)), np.array([[0, 0, 0]])),
    }


@pytest.mark.parametrize("name", list(imperfect_meshes()))
def test_imperfect_meshes_give_answers(connection, name):
    mesh, cup = mesh_to_wkb(imperfect_meshes()[name]), oracle.wkb(oracle.box((1, 1, 1), (0.5, 0.5, 1)))
    whole = name not in {"one wound the other way", "only a triangle", "a point"}
    for function in ("contains_3d", "overlaps_3d", "intersects_3d"):
        assert isinstance(ask(connection, function, cup, mesh), bool)
    assert ask(connection, "contains_3d", mesh, cup) is whole
    assert ask(connection, "distance_3d", mesh, oracle.wkb(oracle.box((1, 1, 1), (9, 9, 9)))) > 0
