"""How probable it is that something is inside: against closed forms, quadrature and random positions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import psycopg
import pytest
import shapely
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st
from scipy import integrate, special
from server import ask_in_parallel, fresh_database
from shapely import affinity

from semap.store.database.connection import connect

Covariance = tuple[float, float, float]
SAMPLES = 200_000
STANDARD = np.random.default_rng(20260131).standard_normal((SAMPLES, 2))
SLOW = {"deadline": None, "suppress_health_check": list(HealthCheck)}


@pytest.fixture(scope="module")
def postgis(cluster, template) -> Iterator[psycopg.Connection]:
    with fresh_database(cluster, template) as dsn, connect(dsn) as connection:
        yield connection


def asked(
    connection: psycopg.Connection,
    shape: shapely.Geometry | None,
    at: Sequence[float | None],
    covariance: Sequence[float | None],
) -> tuple[float, float, float]:
    """probability, least, most"""
    wkb = None if shape is None else shapely.to_wkb(shape, hex=True)
    found = connection.execute(
        "select * from semap.probability_inside(%s::public.geometry, %s, %s, %s, %s, %s)",
        (wkb, *at, *covariance),
    ).fetchone()
    assert found is not None
    return found


def probability(
    connection: psycopg.Connection, shape: shapely.Geometry, at: Sequence[float], covariance: Covariance
) -> float:
    found, least, most = asked(connection, shape, at, covariance)
    assert 0 <= least <= found <= most <= 1
    return found


def covariance_of(long_m: float, short_m: float, angle_rad: float) -> Covariance:
    """xx, xy, yy of deviations along an axis and across."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    a, b = long_m**2, short_m**2
    return a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c


COORDINATES = st.floats(-4, 4).map(lambda x: round(x, 3))
STARS = st.builds(
    lambda radii, turn, x, y: shapely.Polygon(
        [
            (
                x + r * math.cos(turn + 2 * math.pi * n / len(radii)),
                y + r * math.sin(turn + 2 * math.pi * n / len(radii)),
            )
            for n, r in enumerate(radii)
        ]
    ),
    st.lists(st.floats(0.2, 3), min_size=3, max_size=9),
    st.floats(0, 6),
    COORDINATES,
    COORDINATES,
)
ROOMS = st.sampled_from(
    [
        shapely.box(0, 0, 3, 2),
        shapely.Polygon([(0, 0), (3, 0), (3, 2), (2, 2), (2, 3), (0, 3)]),
        shapely.box(-2, -2, 3, 3).difference(shapely.box(-1, -1, 1, 1)),
        shapely.box(-3, 0, 3, 0.1),  # a corridor thinner than any error
        shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(1, 1, 2, 2), shapely.box(-3, 0, -1, 1)]),
        shapely.Polygon([(0, 0), (3, 0.05), (3, -0.05)]),
    ]
)


def polygons_of(shape: shapely.Geometry) -> shapely.Geometry:
    parts = [each for each in shapely.get_parts(shape) if each.area > 0]
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


SHAPES = st.one_of(
    ROOMS,
    STARS,
    st.builds(lambda a, b: polygons_of(a.difference(b)), STARS, STARS),
    st.builds(lambda a, b: polygons_of(a.difference(affinity.scale(b, 0.3, 0.3))), ROOMS, STARS),
).filter(lambda shape: shape.is_valid and not shape.is_empty)
PLACES = st.tuples(COORDINATES, COORDINATES)
COVARIANCES = st.builds(
    lambda long_m, ratio, angle_rad: covariance_of(long_m, long_m * ratio, angle_rad),
    st.floats(0.02, 3),
    st.one_of(st.just(1.0), st.floats(0.05, 1)),
    st.floats(0, math.pi),
)


@settings(max_examples=200, **SLOW)
@given(shape=SHAPES, at=PLACES)
@example(shapely.box(0, 0, 3, 2), (0, 1))
@example(shapely.box(0, 0, 3, 2), (3, 2))
def test_a_signed_distance_is_that_of_shapely(
    postgis: psycopg.Connection, shape: shapely.Geometry, at: tuple[float, float]
) -> None:
    found = postgis.execute(
        "select semap.signed_distance_m(%s::public.geometry, %s, %s)", (shapely.to_wkb(shape, hex=True), *at)
    ).fetchone()
    point = shapely.Point(at)
    sign = 1 if shape.contains(point) else -1
    assert found == (pytest.approx(sign * shapely.boundary(shape).distance(point), abs=1e-12),)


def test_nothing_has_no_signed_distance(postgis: psycopg.Connection) -> None:
    for shape in (None, "POLYGON EMPTY"):
        found = postgis.execute(
            "select semap.signed_distance_m(%s::public.geometry, 1, 1)", (shape,)
        ).fetchone()
        assert found == (None,)


@settings(max_examples=150, **SLOW)
@given(
    depth=st.floats(-8, 8),
    turn=st.floats(0, 2 * math.pi),
    covariance=COVARIANCES,
    side=st.sampled_from([100, 1e4]),
)
def test_a_half_plane_is_told_by_the_distance(
    postgis: psycopg.Connection, depth: float, turn: float, covariance: Covariance, side: float
) -> None:
    """Beyond an edge whose ends are far away it is that of one dimension, across the edge."""
    nx, ny = math.cos(turn), math.sin(turn)
    xx, xy, yy = covariance
    std_m = math.sqrt(nx * nx * xx + 2 * nx * ny * xy + ny * ny * yy)
    half = affinity.rotate(
        shapely.box(-depth * std_m, -side, side, side), turn, origin=(0, 0), use_radians=True
    )
    rounded = 2e-15 * side / math.sqrt(min(xx, yy))  # of the corners, by the error
    assert probability(postgis, half, (0, 0), covariance) == pytest.approx(
        special.ndtr(depth), abs=1e-12 + rounded
    )


@pytest.mark.parametrize("correlation", [0, 0.3, -0.9, 0.999, 0.9999999])
@pytest.mark.parametrize("std_m", [0.01, 0.5])
def test_a_corner_is_told_by_both_distances(
    postgis: psycopg.Connection, std_m: float, correlation: float
) -> None:
    corner = shapely.box(0, 0, 100, 100)
    if correlation == 0:
        for x in (-2, -0.3, 0, 0.1, 1.5):
            found = probability(postgis, corner, (x * std_m, 0.7 * std_m), (std_m**2, 0, std_m**2))
            assert found == pytest.approx(special.ndtr(x) * special.ndtr(0.7), abs=2e-12)
    # at the corner itself: W. F. Sheppard, 1899
    expected = 0.25 + math.asin(correlation) / (2 * math.pi)
    _, least, most = asked(postgis, corner, (0, 0), (std_m**2, correlation * std_m**2, std_m**2))
    assert least <= expected <= most
    assert most - least < 1e-9 or abs(correlation) >= 0.9


@pytest.mark.parametrize("angle_deg", [1, 30, 90, 135, 180, 270, 359])
def test_at_the_tip_of_a_wedge_it_is_the_angle(postgis: psycopg.Connection, angle_deg: float) -> None:
    turns = np.radians(np.linspace(10, 10 + angle_deg, 9))
    wedge = shapely.Polygon([(0, 0), *zip(100 * np.cos(turns), 100 * np.sin(turns), strict=True)])
    assert probability(postgis, wedge, (0, 0), (1, 0, 1)) == pytest.approx(angle_deg / 360, abs=1e-11)


@settings(max_examples=100, **SLOW)
@given(at=PLACES, std_x=st.floats(0.05, 3), std_y=st.floats(0.05, 3), width=st.floats(0.01, 3))
def test_a_rectangle_is_a_product(
    postgis: psycopg.Connection, at: tuple[float, float], std_x: float, std_y: float, width: float
) -> None:
    x, y = at
    along = special.ndtr((3 - x) / std_x) - special.ndtr((-3 - x) / std_x)
    across = special.ndtr((width - y) / std_y) - special.ndtr(-y / std_y)
    found, least, most = asked(postgis, shapely.box(-3, 0, 3, width), at, (std_x**2, 0, std_y**2))
    assert found == pytest.approx(along * across, abs=2e-15)
    assert least <= along * across <= most


@pytest.mark.parametrize("corners", [5, 12, 48, 400, 5_000])
def test_a_disc_lies_between_its_polygons(postgis: psycopg.Connection, corners: int) -> None:
    radius = 1.3
    turns = 2 * math.pi * np.arange(corners) / corners
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    within = probability(postgis, shapely.Polygon(radius * circle), (0, 0), (1, 0, 1))
    around = probability(
        postgis, shapely.Polygon(radius / math.cos(math.pi / corners) * circle), (0, 0), (1, 0, 1)
    )
    assert within < 1 - math.exp(-(radius**2) / 2) < around
    assert around - within < 15 / corners**2


def integral(shape: shapely.Geometry, at: Sequence[float], covariance: Covariance) -> float:
    """Line by line from bottom to top, each by the distribution along it; an oracle with no part of the method."""
    xx, xy, yy = covariance
    across, along = math.sqrt(yy), math.sqrt(xx - xy * xy / yy)
    moved = affinity.translate(shape, -at[0], -at[1])
    rings = [ring for part in shapely.get_parts(moved) for ring in (part.exterior, *part.interiors)]
    ends = np.concatenate([np.stack([c[:-1], c[1:]], 1) for c in (np.array(r.coords) for r in rings)])
    (x1, y1), (x2, y2) = ends[:, 0].T, ends[:, 1].T

    def on_line(v: float) -> float:
        y = v * across
        crossed = (y1 > y) != (y2 > y)
        x = np.sort((x1 + (x2 - x1) * ((y - y1) / np.where(crossed, y2 - y1, 1)))[crossed])
        held = special.ndtr((x - xy / yy * y) / along)
        return float((held[1::2] - held[0::2]).sum() * math.exp(-v * v / 2) / math.sqrt(2 * math.pi))

    bends = np.unique(np.clip(np.concatenate([y1, np.linspace(y1.min(), y1.max(), 25)]) / across, -9, 9))
    pieces = (integrate.quad(on_line, a, b, epsabs=1e-12, epsrel=1e-11)[0] for a, b in pairwise(bends))
    return sum(pieces)


@settings(max_examples=60, **SLOW)
@given(shape=SHAPES, at=PLACES, covariance=COVARIANCES)
def test_it_is_the_integral_over_the_shape(
    postgis: psycopg.Connection, shape: shapely.Geometry, at: tuple[float, float], covariance: Covariance
) -> None:
    found, least, most = asked(postgis, shape, at, covariance)
    expected = integral(shape, at, covariance)
    assert found == pytest.approx(expected, abs=1e-9)
    assert least - 1e-10 <= expected <= most + 1e-10
    assert most - least < 1e-7


@settings(max_examples=80, **SLOW)
@given(shape=SHAPES, at=PLACES, covariance=COVARIANCES)
def test_as_many_random_positions_are_inside(
    postgis: psycopg.Connection, shape: shapely.Geometry, at: tuple[float, float], covariance: Covariance
) -> None:
    xx, xy, yy = covariance
    positions = STANDARD @ np.linalg.cholesky([[xx, xy], [xy, yy]]).T + np.array(at)
    shapely.prepare(shape)
    share = shapely.contains_xy(shape, positions[:, 0], positions[:, 1]).mean()
    _, least, most = asked(postgis, shape, at, covariance)
    tolerance = 5 * math.sqrt(max(most * (1 - least), 1 / SAMPLES) / SAMPLES)
    assert least - tolerance <= share <= most + tolerance


@settings(max_examples=150, **SLOW)
@given(shape=SHAPES, at=PLACES, std_m=st.floats(0.02, 2))
@example(shapely.box(0, 0, 3, 2), (1.5, 0), 0.3)
@example(shapely.box(0, 0, 3, 2), (0, 0), 0.3)
def test_the_distance_alone_errs_by_what_lies_beyond_the_next_edge(
    postgis: psycopg.Connection, shape: shapely.Geometry, at: tuple[float, float], std_m: float
) -> None:
    """The bound of docs/explanation/uncertainty.md: exp(-r^2 / 2), r to where the boundary leaves the nearest edge."""
    point = shapely.Point(at)
    lines = [ring.coords for part in shapely.get_parts(shape) for ring in (part.exterior, *part.interiors)]
    edges = [shapely.LineString(pair) for line in lines for pair in pairwise(line)]
    _, *others = sorted(edges, key=point.distance)
    r = min(point.distance(each) for each in others) / std_m
    statement = "select semap.normal_cdf(semap.signed_distance_m(%s::public.geometry, %s, %s) / %s)"
    found = postgis.execute(statement, (shapely.to_wkb(shape, hex=True), *at, std_m)).fetchone()
    assert found is not None
    inside = probability(postgis, shape, at, (std_m**2, 0, std_m**2))
    assert abs(found[0] - inside) <= math.exp(-r * r / 2) + 1e-12


@settings(max_examples=60, **SLOW)
@given(shape=SHAPES, at=PLACES, covariance=COVARIANCES, spacing=st.floats(0.01, 0.2))
def test_neither_more_corners_nor_other_ways_around_matter(
    postgis: psycopg.Connection,
    shape: shapely.Geometry,
    at: tuple[float, float],
    covariance: Covariance,
    spacing: float,
) -> None:
    """A ring of many corners is clipped, and its edges are short: other ways through the same integral."""
    whole = probability(postgis, shape, at, covariance)
    for other in (
        shapely.segmentize(shape, spacing),
        shapely.normalize(shape),
        shapely.orient_polygons(shape),
    ):
        assert probability(postgis, other, at, covariance) == pytest.approx(whole, abs=1e-10)


@settings(max_examples=60, **SLOW)
@given(shape=SHAPES, at=PLACES, covariance=COVARIANCES)
def test_inside_and_outside_make_one(
    postgis: psycopg.Connection, shape: shapely.Geometry, at: tuple[float, float], covariance: Covariance
) -> None:
    outside = polygons_of(shapely.box(-99, -99, 99, 99).difference(shape))
    parts = [probability(postgis, each, at, covariance) for each in (shape, outside)]
    assert sum(parts) == pytest.approx(1, abs=1e-9)


@settings(max_examples=100, **SLOW)
@given(shape=SHAPES, at=PLACES, turn=st.floats(0, math.pi), std_m=st.floats(0.02, 3))
def test_with_an_error_along_a_line_it_is_what_the_line_has_inside(
    postgis: psycopg.Connection, shape: shapely.Geometry, at: tuple[float, float], turn: float, std_m: float
) -> None:
    point = shapely.Point(at)
    reach = 9 * std_m
    way = np.array([math.cos(turn), math.sin(turn)])
    line = shapely.LineString([np.array(at) - reach * way, np.array(at) + reach * way])
    inside = [part for part in shapely.get_parts(shape.intersection(line)) if part.length > 0]
    assume(shapely.boundary(shape).intersection(line).length < 1e-9)
    ends = [[math.copysign(point.distance(shapely.Point(c)), np.dot(np.array(c) - at, way)) for c in (p.coords[0], p.coords[-1])] for p in inside]  # fmt: skip
    expected = sum(abs(special.ndtr(b / std_m) - special.ndtr(a / std_m)) for a, b in ends)
    _, least, most = asked(postgis, shape, at, covariance_of(std_m, 0, turn))
    assert least - 1e-6 <= expected <= most + 1e-6


def test_a_line_through_many_corners_is_no_other(postgis: psycopg.Connection) -> None:
    disc = shapely.Point(0, 0).buffer(2, quad_segs=100)
    for covariance in ((0, 0, 1), (1, 0, 0), (0.5, 0.5, 0.5), (0.5, -0.5, 0.5)):
        found = probability(postgis, disc, (0, 0), covariance)
        assert found == pytest.approx(2 * special.ndtr(2) - 1, abs=1e-12)


def test_on_a_line_along_an_edge_either_side_may_be_right(postgis: psycopg.Connection) -> None:
    assert asked(postgis, shapely.box(0, 0, 90, 90), (0, 45), (0, 0, 1)) == (0.5, 0, 1)
    assert asked(postgis, shapely.box(0, 0, 90, 90), (1, 0), (1, 0, 0))[1:] == (
        0,
        pytest.approx(special.ndtr(1)),
    )


@pytest.mark.parametrize("covariance", [(0, 0, 0), (None, None, None), (1, None, 1), (1e-20, 0, 1e-20)])
def test_without_an_error_it_is_what_contains_says(
    postgis: psycopg.Connection, covariance: Sequence[float | None]
) -> None:
    for at, inside in (((1, 1), 1), ((0, 1), 0), ((-1, 1), 0)):
        assert asked(postgis, shapely.box(0, 0, 3, 2), at, covariance) == (inside, inside, inside)


def test_of_nothing_nothing_is_known(postgis: psycopg.Connection) -> None:
    assert asked(postgis, None, (0, 0), (1, 0, 1)) == (None, None, None)
    assert asked(postgis, shapely.box(0, 0, 1, 1), (None, 0), (1, 0, 1)) == (None, None, None)
    assert asked(postgis, shapely.Polygon(), (0, 0), (1, 0, 1))[0] == 0


@pytest.mark.parametrize(
    ("shape", "covariance"),
    [
        (shapely.box(0, 0, 1, 1), (1, 2, 1)),
        (shapely.box(0, 0, 1, 1), (-1, 0, 1)),
        (shapely.box(0, 0, 1, 1), (math.nan, 0, 1)),
        (shapely.box(0, 0, 1, 1), (math.inf, 0, 1)),
        (shapely.Point(0, 0), (1, 0, 1)),
    ],
)
def test_what_is_no_covariance_or_no_area_is_refused(
    postgis: psycopg.Connection, shape: shapely.Geometry, covariance: Covariance
) -> None:
    with pytest.raises(psycopg.errors.InvalidParameterValue):
        asked(postgis, shape, (0, 0), covariance)


def test_it_is_asked_in_parallel_plans(postgis: psycopg.Connection) -> None:
    with postgis.transaction(force_rollback=True):
        postgis.execute("create table public.place as select n::float8 as x from generate_series(0, 4) n")
        ask_in_parallel(postgis)
        found = postgis.execute(
            "select array_agg((semap.probability_inside(st_makeenvelope(0, -90, 90, 90), x, 0, 1, 0, 1)).probability order by x)"
            " from public.place"
        ).fetchone()
    assert found is not None
    assert found[0] == pytest.approx(special.ndtr(range(5)), abs=1e-12)


SIZES = st.sampled_from([0, 1e-300, 1e-170, 1e-90, 1e-61, 1e-31, 1e-16, 1e-9, 1e-4, 0.1, 1, 30, 1e6])


@settings(max_examples=300, **SLOW)
@given(
    sizes=st.tuples(*[SIZES] * 4),
    signs=st.tuples(*[st.sampled_from([-1, 1])] * 4),
    stds=st.tuples(SIZES, SIZES),
    correlation=st.sampled_from([0, 1e-200, 0.5, 1 - 1e-15, 1, -1]),
)
def test_no_size_is_too_small_or_too_large(
    postgis: psycopg.Connection,
    sizes: Sequence[float],
    signs: Sequence[int],
    stds: Sequence[float],
    correlation: float,
) -> None:
    """PostgreSQL raises an error where a product is too small for a float, which would stop a trigger."""
    x, y, width, depth = (a * b for a, b in zip(sizes, signs, strict=True))
    shape = shapely.Polygon([(x, y), (x + abs(width), y), (3e6, y + abs(depth)), (x, 2e6)])
    a, b = stds
    probability(postgis, shape, (0, 0), (a * a, correlation * a * b, b * b))
