"""Packed states are the states that were rows, bit for bit, however they came."""

from __future__ import annotations

import random
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import numpy as np
import psycopg
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from past_days import bits, make_partitions, midnight, retain, stored, write
from server import fresh_database
from world import World

from semap.cluster import Cluster
from semap.store.database.connection import connect
from semap.store.operate.maintenance import maintain

DAY_US = 86_400_000_000
PLACE = st.floats(-1e7, 1e7)
NUMBER = st.one_of(st.none(), st.floats(width=32))
ELLIPSE = st.tuples(st.floats(0, 1e4, width=32), st.floats(0, 1e4, width=32), st.floats(-7, 7, width=32)).map(
    lambda each: (max(each[:2]), min(each[:2]), each[2])
)
EXACTNESS = st.one_of(NUMBER.map(lambda std_m: (std_m, None, None)), ELLIPSE)
STATE = st.tuples(
    st.integers(1, 3),
    st.one_of(st.integers(0, DAY_US - 1), st.integers(0, 5_000_000)),
    PLACE,
    PLACE,
    st.one_of(st.none(), PLACE),
    EXACTNESS,
    st.booleans(),
    st.one_of(st.none(), st.floats(-7, 7, width=32)),
    st.one_of(st.none(), st.floats(0, 1e4, width=32), st.just(-0.0)),
    st.one_of(st.none(), st.floats(np.float32(1e-3), 1e4, width=32)),
    st.one_of(st.none(), st.floats(np.float32(1e-3), 1e4, width=32)),
)


@pytest.fixture(scope="module")
def plain(cluster: Cluster, template: str) -> Iterator[psycopg.Connection]:
    """A database whose states are all gone after each example."""
    with fresh_database(cluster, template) as dsn, connect(dsn) as connection:
        retain(connection, "states", pack="1 d")
        make_partitions(connection, 3)
        yield connection


def pack(connection: psycopg.Connection) -> int:
    slots = "select distinct date_bin('30 min', stamp, '1800-01-01Z') from semap.track_state order by 1"
    return sum(
        connection.execute("select semap.pack_states(%s)", [slot]).fetchone()[0]
        for (slot,) in connection.execute(slots).fetchall()
    )


def rows_of(states: list[tuple]) -> list[tuple]:
    """The first of each track and stamp, as the key has it."""
    told = {}
    for track_id, after_us, x_m, y_m, z_m, (std_m, *ellipse), *values in states:
        told.setdefault((track_id, after_us), (x_m, y_m, z_m, std_m, *values, *ellipse))
    return [(track_id, midnight(3) + timedelta(microseconds=us), *v) for (track_id, us), v in told.items()]


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(early=st.lists(STATE, max_size=40), late=st.lists(STATE, max_size=10))
def test_each_bit_comes_back(plain: psycopg.Connection, early: list[tuple], late: list[tuple]) -> None:
    plain.execute("truncate semap.track_state, semap.track_state_packed")
    first, all_ = rows_of(early), rows_of(early + late)
    write(plain, first)
    assert pack(plain) == len(first)
    write(plain, rows_of(late))  # some at stamps at which there are packed ones
    assert pack(plain) == len(rows_of(late))
    assert plain.execute("select count(*) from semap.track_state").fetchone() == (0,)
    assert stored(plain) == sorted((bits(row) for row in all_), key=lambda row: row[:2])
    assert plain.execute(
        "select count(*) from semap.track_state_packed p join semap.track_state_packed q"
        " on q.track_id = p.track_id and q.from_stamp > p.from_stamp and q.from_stamp <= p.to_stamp"
    ).fetchone() == (0,)


EDGES = (
    0.0, -0.0, 5e-324, -5e-324, 2.2250738585072014e-308, 2.225073858507201e-308, 0.1, 1e7, -1e7, 1 - 2**-53,
    -(2**-1022) * 1.5, 4503599627370497.0, 1.7976931348623157e308,
)  # fmt: skip


@pytest.mark.parametrize("number", EDGES)
def test_numbers_at_the_edges_come_back(plain: psycopg.Connection, number: float) -> None:
    found = plain.execute(
        "select float8send(semap.number_of((b >> 48)::smallint, ((b << 16) >> 48)::smallint,"
        " ((b << 32) >> 32)::integer)), float8send(%s::float8) from semap.bits_of(%s::float8) b",
        [number, number],
    ).fetchone()
    assert found[0] == found[1]


@pytest.mark.parametrize("year", [1800, 1899, 1970, 2026])
def test_any_year_that_is_stored_is_packed(plain: psycopg.Connection, year: int) -> None:
    plain.execute("truncate semap.track_state, semap.track_state_packed")
    begin = midnight(3).replace(year=year, month=1, day=1)
    rows = [(1, begin + timedelta(minutes=20, seconds=each), float(each), 0.0, *[None] * 2, False, *[None] * 4)
            for each in range(0, 7200, 7)]  # fmt: skip
    write(plain, rows)
    assert pack(plain) == len(rows)
    assert stored(plain) == [bits(row) for row in rows]
    assert plain.execute("select sum(states) from semap.track_state_packed").fetchone() == (len(rows),)


@pytest.mark.parametrize(("has_ellipse", "least"), [(False, 4), (True, 3.6)])
def test_states_of_a_person_tracker_take_a_quarter_of_the_room(
    plain: psycopg.Connection, has_ellipse: bool, least: float
) -> None:
    """All of a state is measured: no two values are alike, but size and height."""
    plain.execute("truncate semap.track_state, semap.track_state_packed")
    dice = np.random.default_rng(1)
    ticks, tracks = 8000, 8
    way_m = np.cumsum(dice.normal(0, 0.05, (ticks, tracks, 2)), axis=0) + 10
    turn = np.where(np.arange(ticks)[:, None] // 150 % 2, 0, dice.normal(0, 0.05, (ticks, tracks)))
    heading_rad = np.sin(np.cumsum(turn, axis=0)) * 3
    speed_mps, std_m, across_m = np.sort(dice.uniform(0, 2, (3, ticks, tracks)), axis=0)[::-1]
    yaw_rad = np.sin(heading_rad * 5)
    at_us = np.arange(ticks) * 66_667 + dice.integers(-800, 800, ticks) + 1000
    write(
        plain,
        [
            (track + 1, midnight(3) + timedelta(microseconds=us), *way, 0.9, std, False, head, speed, 0.35, 0.5, *ellipse[: 2 * has_ellipse])
            for us, *of_all in zip(
                at_us.tolist(), way_m.tolist(), std_m.tolist(), heading_rad.tolist(), speed_mps.tolist(),
                across_m.tolist(), yaw_rad.tolist(), strict=True
            )
            for track, (way, std, head, speed, *ellipse) in enumerate(zip(*of_all, strict=True))
        ],
    )  # fmt: skip
    before = stored(plain)
    sizes = (
        "select (select sum(pg_total_relation_size(relid)) from pg_partition_tree('semap.track_state') where isleaf),"
        " pg_total_relation_size('semap.track_state_packed')"
    )
    (as_rows, nothing) = plain.execute(sizes).fetchone()
    assert pack(plain) == ticks * tracks
    (_, packed) = plain.execute(sizes).fetchone()
    assert stored(plain) == before
    assert as_rows / (packed - nothing) >= least


def test_what_is_not_to_be_packed_is_refused(world: World) -> None:
    with pytest.raises(psycopg.errors.InvalidParameterValue):
        world.run("select semap.pack_states(%s)", midnight(3))
    retain(world.connection, "states", pack="2 d")
    for slot in (midnight(2), midnight(5) + timedelta(minutes=1), None):
        with pytest.raises(psycopg.errors.InvalidParameterValue):
            world.run("select semap.pack_states(%s)", slot)
    assert world.one("select semap.pack_states(%s)", midnight(3)) == 0


def test_a_deleted_track_leaves_no_states_whoever_packs_them_at_that_moment(world: World) -> None:
    """Half of its states are packed, some came late, and all of it is packed again and again meanwhile."""
    retain(world.connection, "states", pack="1 d")
    dice = random.Random(1)
    make_partitions(world.connection, 3)
    for n in range(12):
        track, other = world.add_track(f"t{n}"), world.add_track(f"other{n}")
        begin_us = int(midnight(3).timestamp()) * 1_000_000
        for part in (range(0, 300, 2), range(1, 300, 2)):
            for each in (track, other):
                world.add_states([(each, begin_us + k * 5_000_000, 1.0 * k, 2.0, None) for k in part])
            if part[0] == 0:
                maintain(world.dsn)
        with ThreadPoolExecutor(2) as pool, connect(world.dsn) as deleting, connect(world.dsn) as packing:
            slot = midnight(3) + timedelta(minutes=30 * dice.choice([0, 0, 1]))
            jobs = [
                pool.submit(packing.execute, "select semap.pack_states(%s)", [slot]),
                pool.submit(deleting.execute, "delete from semap.track where track_id = %s", [track]),
            ]
            for each in dice.sample(jobs, 2):
                each.result(timeout=60)
        assert world.rows("select from semap.stored_state where track_id = %s", track) == []
        assert world.one("select count(*) from semap.stored_state where track_id = %s", other) == 300
    assert world.one("select count(*) from semap.track_now") == 12
