"""States that come together as a track batch: what a user of `semap.add_states` meets."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import numpy as np
import psycopg
import pytest
import shapely
from patience import until
from semap_ingest.track_batch import pack_batch, send_batch
from world import SECOND_US, World

from semap.store.database.connection import connect
from semap.store.operate.doctor.verification import verify
from semap.timeline.stamp import to_datetime
from semap.worker.settling import settling

ADD = """
    select semap.add_states(
      %(source_id)s, %(stamp)s, %(track_ids)s, %(x_m)s, %(y_m)s, %(z_m)s, %(std_m)s::real[],
      heading_rad => %(heading_rad)s::real[], length_m => %(length_m)s::real[],
      std_across_m => %(std_across_m)s::real[], std_yaw_rad => %(std_yaw_rad)s::real[])
"""
FRAME_US = 100_000
NAN = float("nan")


@pytest.fixture
def tracks(world: World) -> list[int]:
    """Three, in a room, which came as two batches."""
    world.add_room("room", shapely.box(0, 0, 4, 4))
    ids = [world.add_track(name) for name in ("a", "b", "c")]
    for frame in (1, 2):
        world.add_batch(
            [(track, frame * FRAME_US, 1.0 + number, 2.0, None) for number, track in enumerate(ids)]
        )
    return ids


def chunks(world: World) -> tuple[int, int]:
    """How many there are of many tracks at a stamp, and of one track."""
    return world.rows(
        "select count(*) filter (where track_id is null), count(track_id) from semap.state_chunk"
    )[0]


def compact(world: World) -> None:
    world.run("select semap.compact_all(array(select source_id from semap.source))")


def stored(world: World) -> int:
    return world.one("select count(*) from semap.stored_state")


def add(world: World, stamp_us: int, ids: list[int], **values: object) -> None:
    row = dict.fromkeys(("z_m", "std_m", "heading_rad", "length_m", "std_across_m", "std_yaw_rad"))
    row |= {"x_m": [1.0] * len(ids), "y_m": [2.0] * len(ids), "source_id": world.source_id}
    world.connection.execute(ADD, row | {"stamp": to_datetime(stamp_us), "track_ids": ids} | values)


BAD = {
    "an array is too short": ({"y_m": [2.0, 2.0]}, "differ in length"),
    "heights are too few": ({"z_m": [1.0]}, "differ in length"),
    "no place": ({"x_m": [1.0, None, 1.0]}, "null value in column"),
    "no number": ({"x_m": [1.0, NAN, 1.0]}, "state_is_finite"),
    "far away": ({"y_m": [1.0, 2e7, 1.0]}, "state_is_finite"),
    "high up": ({"z_m": [1.0, 2e7, 1.0]}, "state_is_finite"),
    "no heading": ({"heading_rad": [0.0, 0.0, NAN]}, "extent_is_finite"),
    "no length": ({"length_m": [1.0, -1.0, 1.0]}, "extent_is_finite"),
    "no ellipse": (
        {"std_m": [0.1] * 3, "std_across_m": [0.2] * 3, "std_yaw_rad": [0.0] * 3},
        "ellipse_is_one",
    ),
    "far away, and calm": ({"x_m": [1e7 + 1.0] * 3}, "state_is_finite"),
    "no tracks": ({"track_ids": None}, "needs a stamp, track_ids, x_m and y_m"),
    "no such source": ({"source_id": 999_999}, "There is no source 999999"),
}


@pytest.mark.parametrize("what", BAD)
def test_what_no_state_may_say_is_refused_and_changes_nothing(
    world: World, tracks: list[int], what: str
) -> None:
    values, said = BAD[what]
    before = world.relations(), world.changes(), stored(world)
    with pytest.raises(psycopg.Error, match=said):
        add(world, 3 * FRAME_US, tracks, **values)
    assert (world.relations(), world.changes(), stored(world)) == before
    add(world, 3 * FRAME_US, tracks)
    assert stored(world) == 9


def test_tracks_that_are_unknown_of_another_source_or_named_twice_are_refused(
    world: World, tracks: list[int]
) -> None:
    with pytest.raises(psycopg.errors.ForeignKeyViolation, match="There is no track 999999"):
        add(world, 3 * FRAME_US, [*tracks, 999_999])
    other = world.add_track("other", world.add_source("second"))
    with pytest.raises(psycopg.errors.CardinalityViolation, match="more than one source"):
        add(world, 3 * FRAME_US, [*tracks, other])
    with pytest.raises(psycopg.errors.UniqueViolation):
        add(world, 3 * FRAME_US, [*tracks, tracks[0]])


def test_a_batch_of_none_is_nothing(world: World, tracks: list[int]) -> None:
    add(world, 3 * FRAME_US, [])
    assert chunks(world) == (2, 0)


@pytest.mark.parametrize("compacted", [False, True])
def test_what_is_sent_twice_is_refused(world: World, tracks: list[int], compacted: bool) -> None:
    if compacted:
        compact(world)
    for again in (lambda: add(world, 2 * FRAME_US, tracks),
                  lambda: world.add_states([(tracks[1], 2 * FRAME_US, 9.0, 9.0, None)])):  # fmt: skip
        with pytest.raises(psycopg.errors.UniqueViolation, match="already exists"):
            again()
    assert stored(world) == 6


def test_a_late_state_finds_what_came_as_batches(world: World, tracks: list[int]) -> None:
    for frame in range(3, 9):
        add(world, frame * FRAME_US, tracks)
    world.add_states([(tracks[0], 3 * FRAME_US + 1, 9.0, 9.0, None)])
    assert world.rows(
        "select kind::text, (extract(epoch from stamp) * 1000000)::bigint from semap.relation_change"
        " where amendment is not null order by change_id"
    ) == [("ended", 3 * FRAME_US + 1), ("began", 4 * FRAME_US)]
    assert stored(world) == 3 * 8 + 1


def test_a_track_that_is_deleted_leaves_no_state_behind(world: World, tracks: list[int]) -> None:
    for frame in range(3, 30):
        add(world, frame * FRAME_US, tracks)
    world.run("delete from semap.track where track_id = %s", tracks[1])
    assert world.one("select count(*) from semap.stored_state where track_id = %s", tracks[1]) == 0
    assert stored(world) == 2 * 29
    add(world, 30 * FRAME_US, [tracks[0], tracks[2]])
    add(world, 31 * FRAME_US, [tracks[0], tracks[2]])
    world.run("delete from semap.source where source_id = %s", world.source_id)
    assert (stored(world), chunks(world)) == (0, (0, 0))


def test_a_map_that_is_deleted_leaves_no_state_behind(world: World, tracks: list[int]) -> None:
    world.run("delete from semap.map where map_id = %s", world.map_id)
    assert (stored(world), chunks(world)) == (0, (0, 0))


def test_a_track_that_is_handed_over_takes_its_states_along(world: World, tracks: list[int]) -> None:
    other = world.add_source("other")
    add(world, 3 * FRAME_US, tracks, x_m=[9.0, 1.5, 1.5])
    world.run("select semap.hand_over_tracks(%s, %s)", [tracks[1]], other)
    add(world, 4 * FRAME_US, [tracks[0], tracks[2]])
    add(world, 4 * FRAME_US, [tracks[1]], source_id=other)
    add(world, 5 * FRAME_US, [tracks[0], tracks[2]])
    add(world, 5 * FRAME_US, [tracks[1]], source_id=other, x_m=[9.0])
    assert [(name, kind, stamp_us) for name, _, kind, _, stamp_us in world.changes()] == [
        ("a", "began", FRAME_US), ("b", "began", FRAME_US), ("c", "began", FRAME_US),
        ("a", "ended", 3 * FRAME_US), ("a", "began", 4 * FRAME_US), ("b", "ended", 5 * FRAME_US),
    ]  # fmt: skip
    assert (
        world.one(
            "select count(*) from semap.states(%s, '-infinity', 'infinity')",
            [tracks[1]],
        )
        == 5
    )


def test_a_track_that_was_handed_over_has_its_states_once(world: World, tracks: list[int]) -> None:
    for frame in range(3, 9):
        add(world, frame * FRAME_US, tracks)
    other = world.add_source("other")
    world.run("select semap.hand_over_tracks(%s, %s)", [tracks[1]], other)
    with pytest.raises(psycopg.errors.UniqueViolation):
        world.add_states([(tracks[1], 8 * FRAME_US, 9.0, 9.0, None)])
    world.add_states([(tracks[1], 9 * FRAME_US, 2.0, 2.0, None)])
    world.add_states([(tracks[1], 4 * FRAME_US + 1, 9.0, 9.0, None)])
    assert [(kind, stamp_us) for name, _, kind, _, stamp_us in world.changes() if name == "b"] == [
        ("began", FRAME_US), ("ended", 4 * FRAME_US + 1), ("began", 5 * FRAME_US)
    ]  # fmt: skip
    world.run("delete from semap.track where track_id = %s", tracks[1])
    assert stored(world) == 2 * 8


@pytest.mark.parametrize("given", ["[0:2]={0.1,0.2,0.3}", "[2:4]={0.1,0.2,0.3}", "{{0.1,0.2,0.3}}"])
@pytest.mark.parametrize("column", ["x_m", "y_m", "z_m", "std_m", "heading_rad", "speed_mps", "length_m"])
@pytest.mark.parametrize("known", [False, True], ids=["first seen now", "known before"])
def test_arrays_of_any_bounds_mean_the_same(
    world: World, tracks: list[int], column: str, given: str, known: bool
) -> None:
    arrays = {"x_m": "{5,5,5}", "y_m": "{2,2,2}"}
    for frame, own in enumerate(["{0.5,0.5,0.5}"] * 2 * known + [given], start=3):
        values = arrays | {column: own}
        world.run(
            f"select semap.add_states(%s, %s, %s, {', '.join(f'{name} => %s' for name in values)})",
            world.source_id, to_datetime(frame * FRAME_US), tracks, *values.values(),
        )  # fmt: skip
    world.run("select semap.flush_positions(array[%s])", world.source_id)
    asked = f"select round({column}::numeric, 1)::float8 from semap.{{}} where stamp = %s order by track_id"
    for table in ("track_now", "stored_state"):
        assert world.rows(asked.format(table), to_datetime(frame * FRAME_US)) == [(0.1,), (0.2,), (0.3,)]
    world.run("select semap.compact_all(array[%s])", world.source_id)
    assert world.rows(asked.format("stored_state"), to_datetime(frame * FRAME_US)) == [(0.1,), (0.2,), (0.3,)]


def test_a_track_that_is_deleted_ends_where_it_was_seen_last(world: World, tracks: list[int]) -> None:
    for frame in range(3, 90):
        add(world, frame * FRAME_US, tracks)
    world.run("create table told (stamp timestamptz)")
    world.run("create function tell() returns trigger language plpgsql as"
              " $$begin insert into told values (new.stamp); return null; end$$")  # fmt: skip
    world.run(
        "create trigger tell after insert on semap.relation_change for each row execute function tell()"
    )
    world.run("delete from semap.track where track_id = %s", tracks[1])
    assert world.rows("select stamp from told") == [(to_datetime(89 * FRAME_US),)]


def test_a_gate_that_comes_asks_how_far_tracks_went_since_they_were_seen(
    world: World, tracks: list[int]
) -> None:
    world.run("update semap.source set jump_m = null")
    for frame, x_m in enumerate([4.1, 4.1, 7.9], start=3):
        add(world, frame * FRAME_US, tracks, x_m=[x_m] * 3)
    world.run("update semap.source set jump_m = 2, jump_mps = 1")
    add(world, 6 * FRAME_US, tracks, x_m=[3.8] * 3)
    assert world.rows("select distinct x_m from semap.track_place") == [(7.9,)]


def test_places_do_not_go_back_where_rows_follow_batches(world: World) -> None:
    ids = [world.add_track(f"t{number}") for number in range(201)]
    for frame in range(1, 5):
        add(world, frame * FRAME_US, ids, x_m=[frame / 10] * 201, y_m=[1.0] * 201)
    world.add_states([(track, 5 * FRAME_US, 0.5, 1.0, None) for track in ids])
    assert world.rows("select distinct x_m from semap.track_place") == [(0.5,)]


def test_readers_see_batches_at_once(world: World, tracks: list[int]) -> None:
    add(world, 3 * FRAME_US, tracks, x_m=[1.25, 2.25, 3.25], heading_rad=[None, 0.5, 1.0])
    assert world.rows("select track, x_m, heading_rad from semap.track_present order by track_id") == [
        ("a", 1.25, None), ("b", 2.25, 0.5), ("c", 3.25, 1.0)
    ]  # fmt: skip
    assert world.one("select x_m from semap.track_now where track_id = %s", tracks[0]) == 1.0
    assert world.one("select x_m from semap.states_around(%s, 'infinity', 1, 0)", tracks[0]) == 1.25
    at = to_datetime(3 * FRAME_US)
    assert world.one("select st_astext(semap.place_at(%s, %s))", tracks[2], at) == "POINT(3.25 2)"


def test_batches_of_other_tracks_leave_each_where_it_was_seen_last(world: World, tracks: list[int]) -> None:
    seen = [(0, 1), (0, 1), (1, 2), (0, 1), (1,), (2,), (0,), (0,)]
    last = {}
    for frame, some in enumerate(seen, start=3):
        x_m = [1.0 + each + frame / 10 for each in some]
        last |= dict(zip(some, x_m, strict=True))
        add(world, frame * FRAME_US, [tracks[each] for each in some], x_m=x_m, y_m=[2.0] * len(some))
    where = [(last[each],) for each in range(3)]
    assert world.rows("select x_m from semap.track_place order by track_id") == where
    states = "select track_id, stamp, x_m from semap.stored_state order by track_id, stamp"
    sent = world.rows(states)
    world.run("select semap.compact_all(array[%s])", world.source_id)
    assert world.rows("select x_m from semap.track_now order by track_id") == where
    assert world.rows(states) == sent
    assert world.one("select count(*) from semap.state_chunk") == 3


def test_states_are_compacted_once_there_are_enough_or_their_half_hour_is_over(
    world: World, tracks: list[int]
) -> None:
    for frame in range(3, 250):
        add(world, frame * FRAME_US, tracks)
    with settling(world.dsn):
        until(lambda: chunks(world)[1] == 3)
        assert stored(world) == 3 * 249
        add(world, 1801 * SECOND_US, tracks)
        world.run("update semap.source_count set received_at = received_at - interval '11 s'")
        until(lambda: chunks(world) == (1, 6))
    assert stored(world) == 3 * 250


def test_what_cannot_be_compacted_keeps_no_other_source_from_it(world: World, tracks: list[int]) -> None:
    other = world.add_source("other")
    track = world.add_track("d", other)
    add(world, SECOND_US, [track], source_id=other)
    world.run("update semap.source_count set received_at = received_at - interval '31 min'")
    # as nobody can by the functions that write
    world.run(f"alter table semap.state_chunk add constraint broken check (track_id <> {tracks[0]})")
    with settling(world.dsn):
        until(lambda: world.one("select count(*) from semap.state_chunk where track_id = %s", track) == 1)


def test_a_day_without_a_partition(world: World, tracks: list[int]) -> None:
    world.run("select semap.ensure_partitions(array[date '1970-01-03'])")
    for day in range(1, 4):
        add(world, day * 86_400 * SECOND_US, tracks)
        add(world, day * 86_400 * SECOND_US + FRAME_US, tracks)
    compact(world)
    assert world.rows("select tableoid::regclass::text, sum(states)::int from semap.state_chunk group by 1 order by 1") == [
        ("semap.state_chunk_19700103", 6), ("semap.state_chunk_default", 3 * 2 + 12)
    ]  # fmt: skip


def test_writers_a_worker_and_an_editor_at_once(world: World) -> None:
    """Four sources send batches, one of them late states too, while they are compacted and rooms and tracks go."""
    for number in range(4):
        world.add_room(f"r{number}", shapely.box(4 * number, 0, 4 * number + 4, 4))
    sources = [world.add_source(f"s{number}") for number in range(4)]
    ids = [
        [world.add_track(f"{number}-{each}", source) for each in range(5)]
        for number, source in enumerate(sources)
    ]
    nothing = np.full(5, NAN)

    def write(number: int) -> None:
        dice = np.random.default_rng(number)
        with connect(world.dsn, "semap_ingest") as connection, connection.cursor() as cursor:
            for frame in range(1, 150):
                x_m, y_m = dice.uniform(0, 16, 5), dice.uniform(0, 4.5, 5)
                track_ids = np.array(ids[number])
                send_batch(
                    cursor,
                    pack_batch(sources[number], frame * FRAME_US, track_ids, x_m, y_m, nothing),
                )
                if number == 3 and frame % 20 == 0:
                    late = to_datetime(frame * FRAME_US) - timedelta(seconds=1.05)
                    cursor.execute("insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, %s, 1, 1)",
                                   [ids[3][0], late])  # fmt: skip

    def edit() -> None:
        with connect(world.dsn) as connection:
            for turn in range(15):
                connection.execute("update semap.abstraction set geometry = %s where geometry && 'POINT(1 1)'::geometry",
                                   [shapely.to_wkb(shapely.box(0, 0, 3 + turn % 2, 4), hex=True)])  # fmt: skip

    with settling(world.dsn), ThreadPoolExecutor() as pool:
        for done in [*(pool.submit(write, number) for number in range(4)), pool.submit(edit)]:
            done.result(120)
    assert stored(world) == 4 * 5 * 149 + 7
    verification = verify(world.dsn, lambda said: None)
    with verification.connection:
        assert not [each for each in verification.look(world.name) if each.differ]


def test_what_rows_leave_behind_is_thrown_away(world: World, tracks: list[int]) -> None:
    """Where there is much of it; nobody reads it meanwhile."""
    world.run(
        "insert into semap.track_state_inbox (track_id, stamp, x_m, y_m)"
        " select n, '1970-01-01Z', 0, 0 from generate_series(1, 1000000) n"
    )
    size = "select pg_relation_size('semap.track_state_inbox')"
    assert world.one(size) > 64 << 20
    with connect(world.dsn) as other, other.transaction():
        other.execute("lock table semap.track_state_inbox in row exclusive mode")
        world.add_states([(tracks[0], SECOND_US, 1.0, 1.0, None)])
        assert world.one(size) > 64 << 20
    world.add_states([(tracks[0], 2 * SECOND_US, 1.0, 1.0, None)])
    assert world.one(size) < 1 << 20
    assert stored(world) == 8
