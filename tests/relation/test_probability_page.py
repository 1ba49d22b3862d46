"""The table of docs/explanation/uncertainty.md is what the functions give."""

from __future__ import annotations

import re
from pathlib import Path

import psycopg
import pytest
import shapely
from server import fresh_database

from semap.store.database.connection import connect

PAGE = Path(__file__).parents[2] / "docs/explanation/uncertainty.md"
HALL = shapely.box(-50, -50, 50, 50)
ROOM = shapely.box(0, 0, 50, 50)
CASES = {
    "10 cm inside of a wall, no corner near": (ROOM, 0.1, 25, 0.1),
    "10 cm inside of a wall, a corner 30 cm away": (ROOM, 0.1, 0.3, 0.1),
    "in a corner, 10 cm from both walls": (ROOM, 0.1, 0.1, 0.1),
    "on the corner itself": (ROOM, 0, 0, 0.1),
    "outside of a projecting corner, 10 cm from both its walls": (HALL - ROOM, 0.1, 0.1, 0.1),
    "in the middle of a corridor of 1 m, error 50 cm": (shapely.box(0, 0, 50, 1), 25, 0.5, 0.5),
    "in the middle of a strip of 10 cm, error 50 cm": (shapely.box(0, 0, 50, 0.1), 25, 0.05, 0.5),
    "in the middle of a column of 40 cm in a hall, error 30 cm": (
        HALL - shapely.box(-0.2, -0.2, 0.2, 0.2),
        0,
        0,
        0.3,
    ),
}


@pytest.fixture
def table() -> dict[str, tuple[str, str]]:
    rows = re.findall(r"^\| (.+?) \| (0\.\d{4}) \| (0\.\d{4}) \|$", PAGE.read_text(), re.MULTILINE)
    return {case: (by_distance, truth) for case, by_distance, truth in rows}


def test_the_table_of_the_page_is_right(cluster, template, table: dict[str, tuple[str, str]]) -> None:
    assert table.keys() == CASES.keys()
    with fresh_database(cluster, template) as dsn, connect(dsn) as connection:
        for case, (shape, x, y, std) in CASES.items():
            found = asked(connection, shape, x, y, std)
            assert tuple(f"{each:.4f}" for each in found) == table[case], case


def asked(
    connection: psycopg.Connection, shape: shapely.Geometry, x: float, y: float, std: float
) -> tuple[float, float]:
    found = connection.execute(
        "select semap.normal_cdf(semap.signed_distance_m(g, x, y) / s),"
        " (semap.probability_inside(g, x, y, s * s, 0, s * s)).probability"
        " from (values (%s::public.geometry, %s::float8, %s::float8, %s::float8)) t (g, x, y, s)",
        (shapely.to_wkb(shape, hex=True), x, y, std),
    ).fetchone()
    assert found is not None
    return found
