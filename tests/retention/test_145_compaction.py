"""Compacted states are the states that came, bit for bit, however they came."""

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
from past_days import bits, compact, make_partitions, midnight, stored, write
from server import fresh_database
from world import World

from semap.cluster import Cluster
from semap.store.database.connection import connect

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
        make_partitions(connection, 3)
        yield connection


def rows_of(states: list[tuple]) -> list[tuple]:
    """The first of each track and stamp, as the key has it."""
    told = {}
    for track_id, after_us, x_m, y_m, z_m, (std_m, *ellipse), *values in states:
        told.setdefault((track_id, after_us), (x_m, y_m, z_m, std_m, *values, *ellipse))
    return [(track_id, midnight(3) + timedelta(microseconds=us), *v) for (track_id, us), v in told.items()]


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(early=st.lists(STATE, max_size=40), late=st.lists(STATE, max_size=10))
def test_each_bit_comes_back(plain: psycopg.Connection, early: list[tuple], late: list[tuple]) -> None:
    plain.execute("truncate semap.state_chunk")
    wanted = rows_of(early + late)
    first = {row[:2] for row in rows_of(early)}
    write(plain, rows_of(early))
    compact(plain)
    write(plain, [row for row in wanted if row[:2] not in first])
    assert stored(plain) == sorted((bits(row) for row in wanted), key=lambda row: row[:2])
    compact(plain)
    assert stored(plain) == sorted((bits(row) for row in wanted), key=lambda row: row[:2])
    assert plain.execute("select count(*) from semap.state_chunk where track_id is null").fetchone() == (0,)
    assert plain.execute(
        "select count(*) from semap.state_chunk where to_stamp < from_stamp or states > 240"
        " or semap.half_hour(from_stamp) <> semap.half_hour(to_stamp)"
    ).fetchone() == (0,)


@pytest.mark.parametrize("year", [1800, 1899, 1970, 2026])
def test_any_year_that_is_stored_is_compacted(plain: psycopg.Connection, year: int) -> None:
    plain.execute("truncate semap.state_chunk")
    begin = midnight(3).replace(year=year, month=1, day=1)
    rows = [(1, begin + timedelta(minutes=20, seconds=each), float(each), 0.0, *[None] * 2, False, *[None] * 4)
            for each in range(0, 7200, 7)]  # fmt: skip
    write(plain, rows)
    compact(plain)
    assert stored(plain) == [bits(row) for row in rows]
    assert plain.execute("select sum(states) from semap.state_chunk").fetchone() == (len(rows),)


@pytest.mark.parametrize(("has_ellipse", "most_bytes"), [(False, 42), (True, 52)])
def test_states_of_a_person_tracker_take_a_third_of_the_room_of_rows(
    plain: psycopg.Connection, has_ellipse: bool, most_bytes: float
) -> None:
    """All of a state is measured: no two values are alike, but size and height."""
    plain.execute("truncate semap.state_chunk")
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
    compact(plain)
    # Vacuum keeps what was deleted while another session of this database has a snapshot, as autovacuum may.
    plain.execute("drop table if exists chunk")
    plain.execute("create temporary table chunk (like semap.state_chunk including all)")
    plain.execute("insert into chunk select * from semap.state_chunk")
    (room,) = plain.execute("select pg_total_relation_size('chunk')").fetchone()
    assert stored(plain) == before
    assert room / (ticks * tracks) <= most_bytes


def test_a_deleted_track_leaves_no_states_whoever_compacts_them_at_that_moment(world: World) -> None:
    """Half of its states are compacted, some came late, and the rest is compacted meanwhile."""
    dice = random.Random(1)
    make_partitions(world.connection, 3)
    for n in range(12):
        track, other = world.add_track(f"t{n}"), world.add_track(f"other{n}")
        begin_us = int(midnight(3).timestamp()) * 1_000_000
        for part in (range(0, 300, 2), range(1, 300, 2)):
            for each in (track, other):
                world.add_states([(each, begin_us + k * 5_000_000, 1.0 * k, 2.0, None) for k in part])
            if part[0] == 0:
                compact(world.connection)
        with ThreadPoolExecutor(2) as pool, connect(world.dsn) as deleting, connect(world.dsn) as compacting:
            jobs = [
                pool.submit(compacting.execute, "select semap.compact_states(%s, 0)", [world.source_id]),
                pool.submit(deleting.execute, "delete from semap.track where track_id = %s", [track]),
            ]
            for each in dice.sample(jobs, 2):
                each.result(timeout=60)
        assert world.rows("select from semap.stored_state where track_id = %s", track) == []
        assert world.one("select count(*) from semap.stored_state where track_id = %s", other) == 300
    assert world.one("select count(*) from semap.track_now") == 12
