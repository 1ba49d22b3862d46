"""The predicates on solids against manifold3d: random pairs of concave meshes, and poses."""

from collections import Counter
from collections.abc import Iterator

import numpy as np
import psycopg
import pytest
import solid_oracle as oracle
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solid_oracle import Solid

from semap.store.database.connection import connect

PAIRS, CHUNK = 1000, 50
ANSWERS = """
    select semap.contains_3d(a, b), semap.overlaps_3d(a, b), semap.intersects_3d(a, b), semap.distance_3d(a, b)
    from (select %s::bytea::public.geometry as a, %s::bytea::public.geometry as b offset 0) pair
"""


@pytest.fixture(scope="module")
def connection(cluster, template) -> Iterator[psycopg.Connection]:
    """A session in the migrated database that is only read from here."""
    with connect(cluster.dsn(template)) as session:
        yield session


def answers(connection: psycopg.Connection, a: Solid, b: Solid) -> tuple[bool, bool, bool, float]:
    """contains, overlaps, intersects, distance [m]"""
    return connection.execute(ANSWERS, (oracle.wkb(a), oracle.wkb(b))).fetchone()


@pytest.mark.parametrize(
    "first",
    [pytest.param(n, marks=[pytest.mark.slow] if n >= 200 else []) for n in range(0, PAIRS, CHUNK)],
)
def test_random_pairs_agree_with_booleans(connection, first):
    wrong, unsure = [], Counter()
    for seed in range(first, first + CHUNK):
        a, b = oracle.pair(seed)
        truth = oracle.truth(a, b)
        contains, overlaps, intersects, distance_m = answers(connection, a, b)
        said = {"contains": contains, "overlaps": overlaps, "intersects": intersects}
        for name, value in said.items():
            expected = getattr(truth, name)
            unsure[name] += expected is None
            if expected is not None and value != expected:
                wrong.append((seed, name, value))
        if distance_m != pytest.approx(truth.distance_m, abs=1e-9):
            wrong.append((seed, "distance", distance_m, truth.distance_m))
    assert wrong == []
    assert unsure.total() <= CHUNK // 10, unsure


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    quaternion=st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    translation_m=st.tuples(*[st.floats(-1000, 1000)] * 3),
    seed=st.integers(0, 10_000),
)
@example(quaternion=(0.0, 0.0, 1.0, 8e-192), translation_m=(0.0, 0.0, 0.0), seed=0)  # products underflow
def test_a_pose_changes_no_answer(connection, quaternion, translation_m, seed):
    pose = np.column_stack([Rotation.from_quat(quaternion).as_matrix(), translation_m])
    random = np.random.default_rng(seed)
    a, b = oracle.PLACEMENTS[seed % 5](random)
    here = answers(connection, a, b)
    there = answers(connection, oracle.moved(a, pose), oracle.moved(b, pose))
    assert there[:3] == here[:3]
    assert there[3] == pytest.approx(here[3], abs=1e-9)


def room() -> Solid:
    """An L-shaped room."""
    return oracle.box((4, 4, 3), (0, 0, 0)) - oracle.box((2, 2, 3), (2, 2, 0))


TURNED = np.column_stack([Rotation.from_rotvec((0.3, -0.5, 0.8)).as_matrix(), (12.3, -45.6, 7.8)])


@pytest.mark.parametrize("pose", [None, TURNED], ids=["as it is", "turned"])
@pytest.mark.parametrize(
    ("size_m", "corner_m", "expected"),
    [
        ((1, 1, 1), (0.5, 0.5, 0), (True, True, True, 0)),  # stands on the floor
        ((1, 1, 1), (0, 0, 0), (True, True, True, 0)),  # in a corner
        ((2, 2, 3), (2, 2, 0), (False, False, True, 0)),  # fills the notch
        ((1, 1, 1), (2.5, 2.5, 1), (False, False, False, 0.5)),  # in the notch, free
        ((1, 1, 1), (1, 1, 3), (False, False, True, 0)),  # on the roof
        ((1, 1, 1), (4, 2, 3), (False, False, True, 0)),  # corner to corner
        ((1, 1, 1), (1.5, 1.5, 1), (False, True, True, 0)),  # around the inner edge
        ((1, 4, 1), (0, 0, 1), (True, True, True, 0)),  # from wall to wall
        ((9, 9, 9), (-1, -1, -1), (False, True, True, 0)),  # holds the room
    ],
)
def test_touching_is_exact(connection, pose, size_m, corner_m, expected):
    a, b = room(), oracle.box(size_m, corner_m)
    if pose is not None:
        a, b = oracle.moved(a, pose), oracle.moved(b, pose)
    assert answers(connection, a, b) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("tolerance_m", [1e-6, 1e-4, 1e-2])
def test_the_tolerance_decides(connection, tolerance_m):
    def ask(name: str, lifted_m: float) -> bool:
        a, b = oracle.box((4, 4, 4), (0, 0, 0)), oracle.box((1, 1, 1), (1, 1, 3 + lifted_m))
        if name == "intersects_3d" or name == "overlaps_3d":
            b = oracle.box((1, 1, 1), (1, 1, 4 + lifted_m))
        return connection.execute(
            f"select semap.{name}(%s::bytea::public.geometry, %s::bytea::public.geometry, %s::float8)",
            (oracle.wkb(a), oracle.wkb(b), tolerance_m),
        ).fetchone()[0]

    assert [ask("contains_3d", f * tolerance_m) for f in (-10, 0, 0.9, 1.1, 10)] == [
        True,
        True,
        True,
        False,
        False,
    ]
    assert [ask("intersects_3d", f * tolerance_m) for f in (-10, 0, 0.9, 1.1, 10)] == [
        True,
        True,
        True,
        False,
        False,
    ]
    assert [ask("overlaps_3d", f * tolerance_m) for f in (-10, -0.9, 0, 1.1)] == [True, False, False, False]
