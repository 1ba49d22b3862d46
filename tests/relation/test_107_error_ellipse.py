"""Error ellipses: of which covariance they are, where they let a track enter, and how probable that is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import psycopg
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import special, stats
from server import fresh_database
from stateful_oracle import Asked, Sample
from test_106_probability import COVARIANCES, PLACES, SHAPES, probability
from world import SECOND_US, World

from semap.geometry.error_ellipse import Ellipses, covariances_of, ellipses_of, is_covariance, turned
from semap.store.database.connection import connect

SLOW = {"deadline": None, "suppress_health_check": list(HealthCheck)}
SAMPLES = 50_000
WITHIN = 5 * math.sqrt(0.25 / SAMPLES)
STANDARD = np.random.default_rng(20260131).standard_normal((SAMPLES, 2))
Covariance = tuple[float, float, float]

axes = st.tuples(st.floats(1e-4, 50), st.floats(1e-4, 1), st.floats(-math.pi / 2, math.pi / 2))


@pytest.fixture(scope="module")
def postgis(cluster, template) -> Iterator[psycopg.Connection]:
    with fresh_database(cluster, template) as dsn, connect(dsn) as connection:
        yield connection


def ellipse_of(connection: psycopg.Connection, covariance: Covariance) -> tuple[float | None, ...]:
    with connection.cursor(binary=True) as cursor:
        found = cursor.execute(
            "select * from semap.error_ellipse(%s::float8, %s::float8, %s::float8)", covariance
        )
        return found.fetchone()


def covariance_of(std_m: float, across_m: float, yaw_rad: float) -> np.ndarray:
    turn = np.array([[math.cos(yaw_rad), -math.sin(yaw_rad)], [math.sin(yaw_rad), math.cos(yaw_rad)]])
    return turn @ np.diag([std_m**2, across_m**2]) @ turn.T


def share_inside(shape: shapely.Geometry, at: tuple[float, float], matrix: np.ndarray) -> float:
    """Of random positions."""
    positions = STANDARD @ np.linalg.cholesky(matrix).T + np.array(at)
    shapely.prepare(shape)
    return float(shapely.contains_xy(shape, positions[:, 0], positions[:, 1]).mean())


def in_real(*values: float) -> list[float]:
    """As a state keeps them."""
    return [float(np.float32(value)) for value in values]


@settings(max_examples=200, **SLOW)
@given(axes)
def test_an_ellipse_has_the_eigenvalues_and_the_eigenvector(
    postgis: psycopg.Connection, drawn: tuple[float, float, float]
) -> None:
    std_m, share, yaw_rad = drawn
    matrix = covariance_of(std_m, std_m * share, yaw_rad)
    asked = (matrix[0, 0], matrix[0, 1], matrix[1, 1])
    found = ellipse_of(postgis, asked)
    lengths, directions = np.linalg.eigh(matrix)
    assert found[0] == pytest.approx(math.sqrt(lengths[1]), rel=1e-6)
    python = ellipses_of(*(np.array([each]) for each in asked))
    if found[1] is None:
        assert share > 1 - 1e-6
        assert np.isnan(python.std_across_m[0])
        return
    assert found[1] == pytest.approx(math.sqrt(max(lengths[0], 0)), rel=1e-6, abs=1e-6 * std_m)
    if share < 0.99:
        along = np.array([math.cos(found[2]), math.sin(found[2])])
        assert abs(along @ directions[:, 1]) == pytest.approx(1, abs=1e-6)
    assert found == pytest.approx([each[0] for each in python], rel=1e-6, abs=1e-6 * std_m)
    back = postgis.execute("select * from semap.error_covariance(%s, %s, %s)", found).fetchone()
    assert back == pytest.approx(asked, rel=1e-5, abs=1e-6 * std_m**2)
    assert covariances_of(python)[0] == pytest.approx(matrix, rel=1e-9, abs=1e-12 * std_m**2)


@pytest.mark.parametrize(
    ("covariance", "ellipse"),
    [
        ((4, 0, 4), (2, None, None)),
        ((4, 0, 0), (2, 0, 0)),
        ((0, 0, 9), (3, 0, math.pi / 2)),
        ((1, 1, 1), (math.sqrt(2), 0, math.pi / 4)),
        ((1, -1, 1), (math.sqrt(2), 0, -math.pi / 4)),
        ((0, 0, 0), (0, None, None)),
        ((1e-40, 1e-200, 1e-300), (0, None, None)),
        ((1e-320, 0, 1), (1, 0, math.pi / 2)),
        ((1, 1 + 1e-7, 1), (math.sqrt(2), 0, math.pi / 4)),  # rounded
        ((None, None, None), (None, None, None)),
    ],
)
def test_what_is_round_or_flat(
    postgis: psycopg.Connection, covariance: tuple[float | None, ...], ellipse: tuple[float | None, ...]
) -> None:
    found = ellipse_of(postgis, covariance)
    assert [each is None for each in found] == [each is None for each in ellipse]
    known = [each for each in ellipse if each is not None]
    assert [each for each in found if each is not None] == pytest.approx(known, abs=1e-6)
    if covariance[0] is not None:
        python = [float(each[0]) for each in ellipses_of(*(np.array([float(each)]) for each in covariance))]
        assert [None if math.isnan(each) else each for each in python] == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize(
    "covariance",
    [
        (1, 2, 1), (-1, 0, 1), (1, 0, -1e-6), (math.nan, 0, 1), (1, math.nan, 1), (1, 0, math.inf), (1, None, 1),
        (None, 0, 0), (1, 1.001, 1), (0, 0.1, 0),
    ],
)  # fmt: skip
def test_what_is_no_covariance_is_refused(
    postgis: psycopg.Connection, covariance: tuple[float | None, ...]
) -> None:
    with pytest.raises(psycopg.errors.InvalidParameterValue, match="is none of a position") as told:
        ellipse_of(postgis, covariance)
    assert "square metres" in told.value.diag.message_hint
    assert not is_covariance(*(np.nan if each is None else each for each in covariance))


@given(axes, st.floats(-math.pi, math.pi))
def test_in_a_turned_frame_the_covariance_is_turned(drawn: tuple[float, float, float], by_rad: float) -> None:
    std_m, share, yaw_rad = drawn
    matrix = covariance_of(std_m, std_m * share, yaw_rad)
    turn = np.array([[math.cos(by_rad), -math.sin(by_rad)], [math.sin(by_rad), math.cos(by_rad)]])
    ellipses = ellipses_of(matrix[:1, 0], matrix[:1, 1], matrix[1:, 1])
    found = covariances_of(turned(ellipses, turn))[0]
    wanted = covariances_of(ellipses)[0] if np.isnan(ellipses.std_across_m[0]) else turn @ matrix @ turn.T
    assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6 * std_m**2)


def test_a_circle_stays_the_same_in_any_frame() -> None:
    circle = Ellipses(*(np.array([each]) for each in (0.3, np.nan, np.nan)))
    assert str(turned(circle, np.array([[0.6, -0.8], [0.8, 0.6]]))) == str(circle)


WRONG = ["0.5, null", "null, 0.5", "0.5, 'nan'", "-0.1, 0", "1.1, 0", "'nan', 0", "0.5, 'infinity'"]


@pytest.mark.parametrize("ellipse", WRONG)
@pytest.mark.parametrize("std", ["1", "null", "'infinity'", "'nan'"])
def test_a_state_has_a_whole_ellipse_or_none(world: World, std: str, ellipse: str) -> None:
    track = world.add_track("a")
    with pytest.raises(psycopg.errors.CheckViolation, match="ellipse_is_one"):
        world.run(
            "insert into semap.track_state (track_id, stamp, x_m, y_m, std_m, std_across_m, std_yaw_rad)"
            f" values (%s, now(), 0, 0, {std}, {ellipse})",
            track,
        )


def test_a_state_takes_what_the_function_gives(world: World) -> None:
    track = world.add_track("a")
    world.run(
        "insert into semap.track_state (track_id, stamp, x_m, y_m, std_m, std_across_m, std_yaw_rad)"
        " select %s, now(), 1, 2, e.* from semap.error_ellipse(0.04, 0.01, 0.01) e", track,
    )  # fmt: skip
    for relation, of in (("semap.track_now", "track_id"), ("semap_query.track", "id")):
        found = world.rows(f"select std_m, std_across_m, std_yaw_rad from {relation} where {of} = %s", track)
        assert found == world.rows("select * from semap.error_ellipse(0.04, 0.01, 0.01)")


def half_plane(normal_rad: float) -> shapely.Geometry:
    """What is on the far side of the origin, in the direction of its normal: as far as matters."""
    outward = np.array([math.cos(normal_rad), math.sin(normal_rad)])
    along = np.array([-outward[1], outward[0]])
    corners = [60 * along, -60 * along, -60 * along - 60 * outward, 60 * along - 60 * outward]
    return shapely.Polygon(corners)


@pytest.mark.parametrize("normal_rad", [0.0, 0.9, -2.3])
def test_at_a_straight_wall_the_threshold_is_where_the_normal_distribution_has_it(
    world: World, normal_rad: float
) -> None:
    """Whoever comes by steps enters at the first state with Phi(d / sqrt(n' C n)) >= p, and leaves likewise."""
    enter, leave = 0.93, 0.12
    world.ask(Asked(enter_probability=enter, leave_probability=leave, widest_std_m=2.0))
    world.run("update semap.source set jump_m = null")
    world.add_room("half", half_plane(normal_rad))
    outward = np.array([math.cos(normal_rad), math.sin(normal_rad)])
    dice = np.random.default_rng(20260131)
    wanted = {}
    for n in range(60):
        std_m = dice.choice([0.02, 0.3, 1.5])
        share = dice.choice([1e-3, 0.05, 0.5, 0.999])
        ellipse = in_real(std_m, std_m * share, dice.uniform(-math.pi / 2, math.pi / 2))
        across_wall_m = math.sqrt(outward @ covariance_of(*ellipse) @ outward)
        depths = [-20.0]
        for least in (stats.norm.ppf(enter), stats.norm.ppf(leave)):
            depths += [least * across_wall_m - math.copysign(1e-6, least), least * across_wall_m * (1 + 1e-6)]
        depths[1] = depths[1] - 1e-6
        track = world.add_track(f"t{n}")
        samples = [
            Sample(second * SECOND_US, *(-depth * outward), None, ellipse[0], False, *ellipse[1:])
            for second, depth in enumerate(depths, 1)
        ]
        inside = [bool(special.ndtr(depth / across_wall_m) >= enter) for depth in depths]
        outside = [bool(special.ndtr(depth / across_wall_m) <= leave) for depth in depths]
        assert inside == [False, False, True, False, False]
        assert outside[1:] == [False, False, False, True]
        world.add_samples(track, samples)
        wanted[f"t{n}"] = [("began", 3), ("ended", 5)]
    found: dict[str, list[tuple[str, int]]] = {}
    for track, _, kind, _, stamp_us in world.changes():
        found.setdefault(track, []).append((kind, stamp_us // SECOND_US))
    assert found == wanted


@settings(max_examples=100, **SLOW)
@given(
    shape=SHAPES, at=PLACES, drawn=st.tuples(st.floats(0.05, 2), st.floats(0.02, 0.98), st.floats(-1.5, 1.5))
)
def test_the_stretched_distance_errs_by_what_lies_beyond_the_next_edge(
    postgis: psycopg.Connection,
    shape: shapely.Geometry,
    at: tuple[float, float],
    drawn: tuple[float, float, float],
) -> None:
    """The bound of docs/explanation/uncertainty.md at corners, for random positions of a slanting error.

    Where the error is round, the shape and its nearest wall's half-plane are the same up to the next edge.
    """
    std_m, across_m, yaw_rad = in_real(drawn[0], drawn[0] * drawn[1], drawn[2])
    matrix = covariance_of(std_m, across_m, yaw_rad)
    whiten = np.linalg.inv(np.linalg.cholesky(matrix))
    white = shapely.transform(shape, lambda corners: (corners - at) @ whiten.T)
    origin = shapely.Point(0, 0)
    lines = [ring.coords for part in shapely.get_parts(white) for ring in (part.exterior, *part.interiors)]
    edges = [shapely.LineString(pair) for line in lines for pair in pairwise(line)]
    nearest, *others = sorted(edges, key=origin.distance)
    r = min(origin.distance(each) for each in others)
    stretched = postgis.execute(
        "select semap.stretched_distance_m(st_boundary(%s::public.geometry), %s, %s, %s, %s, %s)",
        (shapely.to_wkb(shape, hex=True), *at, std_m, across_m, yaw_rad),
    ).fetchone()[0]  # fmt: skip
    assert stretched / std_m == pytest.approx(origin.distance(nearest), rel=1e-9, abs=1e-9)
    is_inside = shapely.contains_xy(shape, *at)
    by_distance = special.ndtr((1 if is_inside else -1) * stretched / std_m)
    bound = math.exp(-r * r / 2)
    covariance = (matrix[0, 0], matrix[0, 1], matrix[1, 1])
    assert abs(by_distance - probability(postgis, shape, at, covariance)) <= bound + 1e-9
    share = share_inside(shape, at, matrix)
    assert abs(by_distance - share) <= bound + WITHIN


@settings(max_examples=60, **SLOW)
@given(shape=SHAPES, at=PLACES, covariance=COVARIANCES)
def test_the_probability_by_an_ellipse_is_that_of_random_positions(
    postgis: psycopg.Connection, shape: shapely.Geometry, at: tuple[float, float], covariance: Covariance
) -> None:
    (found,) = postgis.execute(
        "select (semap.probability_inside(%s::public.geometry, %s, %s, c.xx, c.xy, c.yy)).probability"
        " from semap.error_ellipse(%s, %s, %s) e"
        " cross join lateral semap.error_covariance(e.std_m, e.std_across_m, e.std_yaw_rad) c",
        (shapely.to_wkb(shape, hex=True), *at, *covariance),
    ).fetchone()
    xx, xy, yy = covariance
    share = share_inside(shape, at, np.array([[xx, xy], [xy, yy]]))
    assert found == pytest.approx(share, abs=WITHIN)


def test_the_shorter_axis_counts_for_a_thousandth_of_the_longer_one(postgis: psycopg.Connection) -> None:
    asked = "select semap.stretched_distance_m('LINESTRING (-90 0, 90 0)', 1, 0.002, 1, %s, 0)"
    for across_m, expected in ((0, 2.0), (1e-4, 2.0), (1e-3, 2.0), (0.002, 1.0), (1, 0.002)):
        assert postgis.execute(asked, [across_m]).fetchone()[0] == pytest.approx(expected, rel=1e-6)


def test_far_from_the_origin_the_distance_is_as_exact(postgis: psycopg.Connection) -> None:
    asked = (
        "select semap.stretched_distance_m(st_translate('LINESTRING (-9 -8, 9 8)', x, -x), x + 0.5, -x, 2, 0.003, 0.7)"
        " from unnest(array[0, 4194304.0]) x"
    )
    near, far = (row[0] for row in postgis.execute(asked).fetchall())
    assert far == pytest.approx(near, rel=1e-7)


def test_the_example_of_the_page(postgis: psycopg.Connection) -> None:
    asked = (
        "select semap.normal_cdf(semap.stretched_distance_m('LINESTRING (-90 0, 90 0)', 2.5, 0.1, e.std_m,"
        " coalesce(e.std_across_m, e.std_m), coalesce(e.std_yaw_rad, 0)) / e.std_m)"
        " from semap.error_ellipse(%s, 0, %s) e"
    )
    for variances, inside in (((0.25, 0.0025), 0.977), ((0.25, 0.25), 0.579)):
        assert postgis.execute(asked, variances).fetchone()[0] == pytest.approx(inside, abs=5e-4)
