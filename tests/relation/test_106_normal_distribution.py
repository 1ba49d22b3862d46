"""The normal distribution in the database: against scipy, and against a continued fraction in many digits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import Context, Decimal, localcontext

import numpy as np
import psycopg
import pytest
from scipy import special
from server import fresh_database

from semap.store.database.connection import connect

PI = Decimal("3.14159265358979323846264338327950288419716939937510582")


@pytest.fixture(scope="module")
def postgis(cluster, template) -> Iterator[psycopg.Connection]:
    with fresh_database(cluster, template) as dsn, connect(dsn) as connection:
        yield connection


def column(connection: psycopg.Connection, function: str, values: np.ndarray) -> np.ndarray:
    found = connection.execute(
        f"select array_agg(semap.{function}(x) order by n) from unnest(%s::float8[]) with ordinality t (x, n)",
        (values.tolist(),),
    ).fetchone()
    assert found is not None
    return np.array(found[0], dtype=float)


def test_the_normal_distribution_is_that_of_scipy(postgis: psycopg.Connection) -> None:
    x = np.concatenate([np.linspace(-37.5, 37.5, 30_001), [0, 1e-300, -1e-20, 0.67448975, 5.65685424949238]])
    found = column(postgis, "normal_cdf", x)
    np.testing.assert_allclose(found, special.ndtr(x), rtol=3e-13, atol=0)  # scipy itself is 1e-13 off at -30
    np.testing.assert_allclose(found, special.ndtr(x), rtol=0, atol=3e-16)
    beyond = np.array([-math.inf, -1e300, -37.6, 37.6, math.inf, math.nan])
    np.testing.assert_array_equal(column(postgis, "normal_cdf", beyond), [0, 0, 0, 1, 1, math.nan])


def test_its_tail_is_that_of_laplaces_continued_fraction(postgis: psycopg.Connection) -> None:
    x = np.array([2.5, 5.5, 6.0625, 7.75, 10.6875, 20.3125, 30.125, 37.484375])
    expected = []
    with localcontext(Context(prec=60)):
        for each in map(Decimal, x.tolist()):
            fraction = Decimal(0)
            for k in range(2_000, 0, -1):
                fraction = k / (each + fraction)
            expected.append(float((-each * each / 2).exp() / (2 * PI).sqrt() / (each + fraction)))
    np.testing.assert_allclose(column(postgis, "normal_cdf", -x), expected, rtol=1e-15)


def test_its_inverse_is_that_of_scipy(postgis: psycopg.Connection) -> None:
    p = np.concatenate([np.linspace(0, 1, 10_001), 10.0 ** -np.arange(1, 308), 1 - 10.0 ** -np.arange(1, 16)])
    np.testing.assert_allclose(
        column(postgis, "normal_quantile", p), special.ndtri(p), rtol=1e-14, atol=1e-16
    )
    outside = np.array([-0.1, 1.1, math.nan])
    assert np.isnan(column(postgis, "normal_quantile", outside)).all()
