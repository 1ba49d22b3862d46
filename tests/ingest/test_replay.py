"""Recordings into the database: every state once, resumed, refused where it clashes."""

from __future__ import annotations

from contextlib import closing
from dataclasses import fields, replace
from threading import Event as Signal

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.replay import Plan, in_map_frame, replay, track_uid
from semap_ingest.state_copy import COLUMNS, pack_states
from semap_ingest.track_file import Tracks
from world import SECOND_US, World

from semap.errors import Conflict, InvalidInput, NotFound
from semap.store.database.connection import connect
from semap.timeline.stamp import to_datetime

PLAN = Plan(map_name="world", source="walk", path="walk.csv", fingerprint="f1", batch_size=7)


def walk(states: int, tracks: int = 3) -> Tracks:
    rows = np.arange(states)
    nan = np.full(states, np.nan)
    return Tracks(
        tuple(f"t{i}" for i in range(tracks)), rows % tracks, rows // tracks * SECOND_US, rows * 0.1, rows * 0.0,
        np.where(rows % 2, nan, 1.0), np.where(rows % 5, nan, 0.5), np.where(rows % 10, nan, 0.125),
        np.where(rows % 10, nan, 0.75),
    )  # fmt: skip


def stored(world: World) -> list[tuple]:
    return world.rows(
        "select t.name, extract(epoch from s.stamp)::float8 * 1000000, x_m, y_m, z_m, std_m, std_across_m, std_yaw_rad,"
        " is_last from semap.stored_state s join semap.track t using (track_id) order by s.stamp, t.name"
    )


def expected(tracks: Tracks) -> list[tuple]:
    last = {name: int(np.flatnonzero(tracks.track == i)[-1]) for i, name in enumerate(tracks.names)}
    rows = []
    for i in range(len(tracks)):
        name = tracks.names[tracks.track[i]]
        maybe = (tracks.z_m[i], tracks.std_m[i], tracks.std_across_m[i], tracks.std_yaw_rad[i])
        rows.append((name, float(tracks.stamp_us[i]), float(tracks.x_m[i]), float(tracks.y_m[i]),
                     *(None if np.isnan(v) else float(v) for v in maybe), last[name] == i))  # fmt: skip
    return rows


def test_every_state_is_stored_once_and_tracks_end(world: World) -> None:
    tracks = walk(100)
    seen = []
    done = replay(world.dsn, PLAN, tracks, lambda states, total: seen.append((states, total)))
    assert (done.states, done.tracks, done.resumed_at, done.late) == (100, 3, 0, 0)
    assert seen[-1] == (100, 100)
    assert seen == sorted(seen)
    assert stored(world) == expected(tracks)
    assert world.rows("select name, ended_at from semap.track order by name") == [
        (f"t{i}", to_datetime(int(tracks.stamp_us[tracks.track == i][-1]))) for i in range(3)
    ]
    again = replay(world.dsn, PLAN, tracks)
    assert (again.states, again.resumed_at) == (0, 100)
    assert len(stored(world)) == 100


def test_tracks_are_what_the_plan_says(world: World) -> None:
    tracks = walk(20)
    world.run("insert into semap.concept (name) values ('Forklift')")
    described = (
        "select k.name, c.name, k.attributes from semap.track k left join semap.concept c using (concept_id)"
        " order by 1"
    )
    names = [f"t{i}" for i in range(3)]
    replay(world.dsn, PLAN, tracks)
    assert world.rows(described) == [(name, None, {}) for name in names]
    replay(world.dsn, replace(PLAN, concept="Forklift"), tracks)
    assert world.rows(described) == [(name, "Forklift", {}) for name in names]
    replay(world.dsn, replace(PLAN, attributes={"shift": "night"}), tracks)
    replay(world.dsn, PLAN, tracks)
    assert world.rows(described) == [(name, "Forklift", {"shift": "night"}) for name in names]
    with pytest.raises(InvalidInput, match="no concept Unheard"):
        replay(world.dsn, replace(PLAN, source="other", concept="Unheard"), tracks)
    assert world.one("select count(*) from semap.source where name = 'other'") == 0


def test_a_replay_that_was_cut_goes_on_where_it_was(world: World) -> None:
    tracks = walk(100)

    class CutError(Exception):
        pass

    def cut(done: int, total: int) -> None:
        if done >= 42:
            raise CutError

    with pytest.raises(CutError):
        replay(world.dsn, PLAN, tracks, cut)
    assert len(stored(world)) == 42
    done = replay(world.dsn, replace(PLAN, batch_size=1000), tracks)
    assert (done.states, done.resumed_at) == (58, 42)
    assert stored(world) == expected(tracks)


def test_states_that_are_there_already_are_refused_and_nothing_changes(world: World) -> None:
    replay(world.dsn, PLAN, walk(30))
    with pytest.raises(Conflict, match="stored already") as clash:
        replay(world.dsn, replace(PLAN, fingerprint="f2", batch_size=1000), walk(60))
    assert "--source" in clash.value.remedy
    assert len(stored(world)) == 30


PARTITIONS = "select count(*) from pg_inherits where inhparent = 'semap.state_chunk'::regclass"


def test_what_is_refused_leaves_no_trace(world: World) -> None:
    """The clash is in the last batch of the file: none of the batches before it are written either."""
    replay(world.dsn, PLAN, walk(30))
    partitions = world.one(PARTITIONS)
    longer = walk(600)
    later = replace(longer, stamp_us=longer.stamp_us[::-1][0] - longer.stamp_us[::-1] - 10**15)
    clashing = replace(
        later, stamp_us=np.where(np.arange(600) == 599, 0, later.stamp_us), track=later.track * 0
    )
    with pytest.raises(
        Conflict, match=r"walk\.csv: States of the source walk are stored already: the track t0"
    ):
        replay(world.dsn, replace(PLAN, fingerprint="f2"), clashing)
    with pytest.raises(NotFound):
        replay(world.dsn, replace(PLAN, map_name="nowhere"), later)
    with pytest.raises(InvalidInput, match="--source"):
        replay(world.dsn, replace(PLAN, source="x" * 201), later)
    assert len(stored(world)) == 30
    assert world.rows("select fingerprint from semap.recording") == [("f1",)]
    assert world.one(PARTITIONS) == partitions


def test_a_first_batch_that_is_refused_leaves_neither_source_nor_tracks(world: World) -> None:
    """By a file whose numbers went through no reader, so that only the database refuses them."""
    wild = replace(walk(9), x_m=np.full(9, 1e9))
    with pytest.raises(InvalidInput):
        replay(world.dsn, PLAN, wild)
    assert world.one("select count(*) from semap.source where name = 'walk'") == 0
    assert (
        world.one("select (select count(*) from semap.track) + (select count(*) from semap.recording)") == 0
    )


def test_another_file_goes_on_with_open_tracks(world: World) -> None:
    world.add_room("room", shapely.box(-1, -1, 100, 1))
    whole = walk(60)
    columns = [each.name for each in fields(Tracks) if each.name not in ("names", "findings", "left_out")]
    first, rest = (
        Tracks(whole.names, *(getattr(whole, each)[part] for each in columns))
        for part in (slice(30), slice(30, None))
    )
    replay(world.dsn, replace(PLAN, keep_open=True), first)
    assert {pair[:2] for pair in world.relations()} == {(f"t{i}", "room") for i in range(3)}
    replay(world.dsn, replace(PLAN, fingerprint="f2"), rest)
    assert [change[2:4] for change in world.changes()] == [("began", "appeared")] * 3 + [
        ("ended", "disappeared")
    ] * 3
    assert world.rows("select ended_at is not null from semap.track") == [(True,)] * 3


def test_late_states_are_counted_and_correct_what_was_told(world: World) -> None:
    world.add_room("room", shapely.box(-1, -1, 100, 1))
    replay(world.dsn, replace(PLAN, keep_open=True), walk(60))
    early = walk(60)
    early = replace(early, stamp_us=early.stamp_us - 100 * SECOND_US)
    tracks = len({track for track, *_ in world.changes()})
    done = replay(world.dsn, replace(PLAN, fingerprint="f2", keep_open=True), early)
    assert done.late == 60
    assert len(stored(world)) == 120
    world.correct()
    first = to_datetime(int(early.stamp_us.min()))
    held = world.rows("select since from semap.relation where map_id = %s order by since", world.map_id)
    assert (len(held), held[0][0]) == (tracks, first), "everybody is in the room since the earliest state"
    assert world.rows(
        "select amendment, count(*) from semap.relation_change where map_id = %s group by 1 order by 1",
        world.map_id,
    ) == [("added", tracks), ("retracted", tracks), (None, tracks)]


def test_an_unknown_map(world: World) -> None:
    with pytest.raises(NotFound, match="nowhere"):
        replay(world.dsn, replace(PLAN, map_name="nowhere"), walk(3))


def test_positions_in_a_frame(world: World) -> None:
    storey = world.one("insert into semap.frame (map_id, name, parent_id) values (%s, 'level 2', %s)"
                       " returning frame_id", world.map_id, world.frame_id)  # fmt: skip
    world.run("insert into semap.frame_pose (frame_id, x_m, z_m, qz, qw) values (%s, 10, 3, sqrt(0.5), sqrt(0.5))",
              storey)  # fmt: skip
    moved = in_map_frame(world.dsn, "world", "level 2", replace(walk(3), z_m=np.array([np.nan, 0.0, 1.0])))
    np.testing.assert_allclose(moved.x_m, [10, 10, 10], atol=1e-12)
    np.testing.assert_allclose(moved.y_m, [0, 0.1, 0.2], atol=1e-12)
    np.testing.assert_allclose(moved.z_m, [3, 3, 4])
    np.testing.assert_allclose(moved.std_m, [0.5, np.nan, np.nan])
    np.testing.assert_allclose(moved.std_across_m, [0.125, np.nan, np.nan])
    np.testing.assert_allclose(moved.std_yaw_rad, [0.75 - np.pi / 2, np.nan, np.nan])
    with pytest.raises(NotFound):
        in_map_frame(world.dsn, "world", "level 9", walk(3))


def test_track_ids_follow_from_names(world: World) -> None:
    replay(world.dsn, PLAN, walk(3))
    map_uid = world.one("select uid from semap.map")
    assert world.rows("select uid from semap.track order by name") == [
        (track_uid(map_uid, "walk", f"t{i}"),) for i in range(3)
    ]


def test_states_of_an_unknown_track_or_of_two_sources_are_refused(world: World) -> None:
    ours, theirs = world.add_track("t"), world.add_track("u", world.add_source("other"))
    with pytest.raises(Exception, match="no track 999"):
        world.add_states([(ours, SECOND_US, 0, 0, None), (999, SECOND_US, 0, 0, None)])
    with pytest.raises(Exception, match="more than one source"):
        world.add_states([(ours, SECOND_US, 0, 0, None), (theirs, SECOND_US, 0, 0, None)])
    assert world.one("select count(*) from semap.stored_state") == 0


@given(st.lists(st.tuples(st.integers(1, 9), st.integers(0, 10**12), st.floats(-1e7, 1e7), st.floats(-1e7, 1e7),
                          st.one_of(st.none(), st.floats(-1e7, 1e7)), st.one_of(st.none(), st.floats(0, 9, width=32)),
                          st.booleans(), st.one_of(st.none(), st.floats(0, 9, width=32)),
                          st.one_of(st.none(), st.floats(-3, 3, width=32))), max_size=20))  # fmt: skip
def test_packed_states_are_what_postgresql_reads(cluster_table: str, rows: list[tuple]) -> None:
    with connect(cluster_table) as connection, connection.cursor() as cursor:
        cursor.execute("truncate states")
        columns = [np.array([np.nan if v is None else v for v in column], dtype=dtype) for column, dtype in zip(
            zip(*rows, strict=True) if rows else [[]] * 9,
            (np.int64, np.int64, np.float64, np.float64, np.float64, np.float64, np.bool_, np.float64, np.float64),
            strict=True)]  # fmt: skip
        for names, data in (
            (COLUMNS, pack_states(*columns[:7])),
            (
                (*COLUMNS, "std_across_m", "std_yaw_rad"),
                pack_states(*columns[:7], std_across_m=columns[7], std_yaw_rad=columns[8]),
            ),
        ):
            cursor.execute("truncate states")
            with cursor.copy(f"copy states ({', '.join(names)}) from stdin (format binary)") as copy:
                copy.write(data)
            cursor.execute(
                "select track_id, extract(epoch from stamp) * 1000000, x_m, y_m, z_m, std_m::float8, is_last,"
                " std_across_m::float8, std_yaw_rad::float8 from states"
            )
            wanted = [row if len(names) == 9 else (*row[:7], None, None) for row in _as_stored(rows)]
            assert sorted(map(repr, cursor.fetchall())) == sorted(map(repr, wanted))


EXTENT = ("heading_rad", "speed_mps", "length_m", "width_m")
measure = st.one_of(st.none(), st.floats(0.125, 3, width=32))


@given(st.lists(st.tuples(st.integers(1, 9), st.one_of(st.none(), st.floats(-9, 9)), measure, measure, measure, measure),
                max_size=20))  # fmt: skip
def test_packed_extents_are_what_postgresql_reads(cluster_table: str, rows: list[tuple]) -> None:
    columns = (
        np.array([[np.nan if v is None else v for v in row] for row in rows], dtype=np.float64)
        .reshape(-1, 6)
        .T
    )
    nothing = np.zeros(len(rows))
    data = pack_states(
        columns[0].astype(np.int64), nothing.astype(np.int64), nothing, nothing, columns[1], nothing * np.nan,
        nothing.astype(np.bool_), heading_rad=columns[2], speed_mps=columns[3], length_m=columns[4], width_m=columns[5],
    )  # fmt: skip
    with connect(cluster_table) as connection, connection.cursor() as cursor:
        cursor.execute("truncate states")
        with cursor.copy(
            f"copy states ({', '.join((*COLUMNS, *EXTENT))}) from stdin (format binary)"
        ) as copy:
            copy.write(data)
        cursor.execute("select track_id, z_m, heading_rad::float8, speed_mps::float8, length_m::float8, width_m::float8"
                       " from states where std_m is null")  # fmt: skip
        assert sorted(map(repr, cursor.fetchall())) == sorted(map(repr, rows))


def _as_stored(rows: list[tuple]) -> list[tuple]:
    from decimal import Decimal  # noqa: PLC0415

    return [(r[0], Decimal(r[1]).quantize(Decimal("0.000000")), *map(_plain, r[2:6]), r[6],
             *map(_plain, r[7:])) for r in rows]  # fmt: skip


def _plain(value: float | None) -> float | None:
    return None if value is None else float(value)


@pytest.fixture(scope="module")
def cluster_table(cluster):
    cluster.create_database("packed")
    with connect(cluster.dsn("packed")) as connection:
        connection.execute("create table states (track_id bigint, stamp timestamptz, x_m float8, y_m float8,"
                           " z_m float8, std_m real, is_last boolean, heading_rad real, speed_mps real,"
                           " length_m real, width_m real, std_across_m real, std_yaw_rad real)")  # fmt: skip
    yield cluster.dsn("packed")
    cluster.drop_database("packed")


@pytest.mark.parametrize("batch_size", [1, 3, 50])
def test_the_log_is_the_same_whatever_the_batches(world: World, batch_size: int) -> None:
    """Some who walk in a crowd, at once and cut anywhere, stopped and resumed."""
    dice = np.random.default_rng(5)
    people, steps = 7, 20
    ways = dice.uniform(-2, 2, (people, 2)) + np.cumsum(dice.normal(0, 0.3, (steps, people, 2)), axis=0)
    rows = np.arange(people * steps)
    nothing = np.full(len(rows), np.nan)
    tracks = Tracks(
        tuple(f"t{i}" for i in range(people)), rows % people, rows // people * SECOND_US,
        ways[rows // people, rows % people, 0], ways[rows // people, rows % people, 1],
        nothing, nothing, nothing, nothing,
    )  # fmt: skip
    logs = []
    for size in (1000, batch_size):
        with closing(World(world.dsn, f"in batches of {size}")) as played:
            played.run(
                "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, distance_m)"
                " values (%s, 'near', 'within_distance', 'track', 'track', 0.8)",
                played.map_id,
            )
            plan, stop = replace(PLAN, map_name=played.name, batch_size=size), Signal()
            replay(
                world.dsn, plan, tracks, lambda done, _, stop=stop: stop.set() if done > 60 else None, stop
            )
            replay(world.dsn, plan, tracks)
            logs.append(
                played.rows(
                    "select kind::text, cause::text, track_name, object_track_name, stamp, transition_at, since, amendment"
                    " from semap.relation_change where map_id = %s order by change_id",
                    played.map_id,
                )
            )
    assert len(logs[0]) > 20
    assert logs[0] == logs[1]
