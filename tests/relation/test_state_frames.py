"""States that come together as a frame: what a user of `semap.track_state_frame` meets."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import numpy as np
import psycopg
import pytest
import shapely
from patience import until
from semap_ingest.state_frame import pack_frame, send_batch
from semap_service.operations.doctor.verification import verify
from world import SECOND_US, World

from semap.store.database import connect
from semap.timeline.stamp import to_datetime
from semap.worker.settling import settling

ADD = """
    insert into semap.track_state_frame
      (stamp, source_id, track_ids, x_m, y_m, z_m, std_m, heading_rad, length_m, std_across_m, std_yaw_rad)
    values (%(stamp)s, %(source_id)s, %(track_ids)s::bigint[], %(x_m)s::float8[], %(y_m)s::float8[],
            %(z_m)s::float8[], %(std_m)s::real[], %(heading_rad)s::real[], %(length_m)s::real[],
            %(std_across_m)s::real[], %(std_yaw_rad)s::real[])
"""
FRAME_US = 100_000
NAN = float("nan")


@pytest.fixture
def tracks(world: World) -> list[int]:
    """Three, in a room, which came as two frames; the second one is kept."""
    world.add_room("room", shapely.box(0, 0, 4, 4))
    ids = [world.add_track(name) for name in ("a", "b", "c")]
    for frame in (1, 2):
        world.add_batch(
            [(track, frame * FRAME_US, 1.0 + number, 2.0, None) for number, track in enumerate(ids)]
        )
    assert frames(world) == 1
    return ids


def frames(world: World) -> int:
    return world.one("select count(*) from semap.track_state_frame")


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
    "no tracks": ({"track_ids": None}, "null value in column"),
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
    assert frames(world) == 2


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


def test_a_frame_of_none_is_nothing(world: World, tracks: list[int]) -> None:
    add(world, 3 * FRAME_US, [])
    assert frames(world) == 1


@pytest.mark.parametrize("unfolded", [False, True])
def test_what_is_sent_twice_is_refused(world: World, tracks: list[int], unfolded: bool) -> None:
    if unfolded:
        world.run("select semap.unfold_frames()")
    for again in (lambda: add(world, 2 * FRAME_US, tracks),
                  lambda: world.add_states([(tracks[1], 2 * FRAME_US, 9.0, 9.0, None)])):  # fmt: skip
        with pytest.raises(psycopg.errors.UniqueViolation, match="already exists"):
            again()
    assert stored(world) == 6


def test_a_late_state_finds_what_came_as_frames(world: World, tracks: list[int]) -> None:
    for frame in range(3, 9):
        add(world, frame * FRAME_US, tracks)
    world.add_states([(tracks[0], 3 * FRAME_US + 1, 9.0, 9.0, None)])
    assert world.rows(
        "select kind::text, (extract(epoch from stamp) * 1000000)::bigint from semap.relation_change"
        " where amendment is not null order by change_id"
    ) == [("ended", 3 * FRAME_US + 1), ("began", 4 * FRAME_US)]
    assert frames(world) == 0
    assert stored(world) == 3 * 8 + 1


def test_a_track_that_is_deleted_leaves_no_state_behind(world: World, tracks: list[int]) -> None:
    for frame in range(3, 30):
        add(world, frame * FRAME_US, tracks)
    world.run("delete from semap.track where track_id = %s", tracks[1])
    assert world.one("select count(*) from semap.stored_state where track_id = %s", tracks[1]) == 0
    assert stored(world) == 2 * 29
    add(world, 30 * FRAME_US, [tracks[0], tracks[2]])
    add(world, 31 * FRAME_US, [tracks[0], tracks[2]])
    assert frames(world) == 1
    world.run("delete from semap.source where source_id = %s", world.source_id)
    assert stored(world) == frames(world) == 0


def test_a_map_that_is_deleted_leaves_no_frame_behind(world: World, tracks: list[int]) -> None:
    world.run("delete from semap.map where map_id = %s", world.map_id)
    assert stored(world) == frames(world) == 0


def test_a_track_that_is_handed_over_takes_its_frames_along(world: World, tracks: list[int]) -> None:
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
            "select count(*) from semap.states_of_track(%s, '-infinity', 'infinity', '-infinity', 99)",
            tracks[1],
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
    insert = "insert into semap.track_state_frame (stamp, source_id, track_ids, {}) values (%s, %s, %s, {})"
    for frame, own in enumerate(["{0.5,0.5,0.5}"] * 2 * known + [given], start=3):
        values = arrays | {column: own}
        world.run(
            insert.format(", ".join(values), ", ".join(["%s"] * len(values))),
            to_datetime(frame * FRAME_US), world.source_id, tracks, *values.values(),
        )  # fmt: skip
    asked = f"select round({column}::numeric, 1)::float8 from semap.{{}} where stamp = %s order by track_id"
    for table in ("track_now", "stored_state"):
        assert world.rows(asked.format(table), to_datetime(frame * FRAME_US)) == [(0.1,), (0.2,), (0.3,)]


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


def test_places_do_not_go_back_where_rows_follow_frames(world: World) -> None:
    ids = [world.add_track(f"t{number}") for number in range(201)]
    for frame in range(1, 5):
        add(world, frame * FRAME_US, ids, x_m=[frame / 10] * 201, y_m=[1.0] * 201)
    world.add_states([(track, 5 * FRAME_US, 0.5, 1.0, None) for track in ids])
    assert world.rows("select distinct x_m from semap.track_place") == [(0.5,)]


def test_readers_see_frames_at_once(world: World, tracks: list[int]) -> None:
    add(world, 3 * FRAME_US, tracks, x_m=[1.25, 2.25, 3.25], heading_rad=[None, 0.5, 1.0])
    assert world.rows("select track, x_m, heading_rad from semap.track_present order by track_id") == [
        ("a", 1.25, None), ("b", 2.25, 0.5), ("c", 3.25, 1.0)
    ]  # fmt: skip
    assert world.one("select x_m from semap.track_now where track_id = %s", tracks[0]) == 1.0
    assert world.one("select x_m from semap.state_before(%s, 'infinity')", tracks[0]) == 1.25
    at = to_datetime(3 * FRAME_US)
    assert world.one("select st_astext(semap.place_at(%s, %s))", tracks[2], at) == "POINT(3.25 2)"


def test_who_writes_makes_rows_where_no_worker_does(world: World, tracks: list[int]) -> None:
    for second in range(1, 100):
        add(world, second * SECOND_US, tracks)
    assert frames(world) <= 61 + 10
    assert stored(world) == 3 * 101


def test_however_fast_frames_come_they_do_not_pile_up(world: World, tracks: list[int]) -> None:
    for frame in range(1, 1600):
        add(world, frame * 5 * FRAME_US, tracks)
    assert world.one("select max(stamp) - min(stamp) from semap.track_state_frame") <= timedelta(seconds=71)


def test_the_worker_makes_rows(world: World, tracks: list[int]) -> None:
    for frame in range(3, 30):
        add(world, frame * FRAME_US, tracks)
    with settling(world.dsn):
        await_frames(world, 1)
    assert frames(world) == 1, "the newest one is where everybody is"
    assert world.one("select count(*) from semap.track_state") == 3 * 28
    assert stored(world) == 3 * 29


def test_the_last_frame_of_a_source_that_is_silent_becomes_rows(world: World, tracks: list[int]) -> None:
    world.run("update semap.source_count set received_at = received_at - interval '11 s'")
    with settling(world.dsn):
        await_frames(world, 0)
    assert world.one("select count(*) from semap.track_state") == 6


def test_what_cannot_become_rows_keeps_no_other_source_from_it(world: World, tracks: list[int]) -> None:
    other = world.add_source("other")
    track = world.add_track("d", other)
    for frame in (3, 4, 5):
        add(world, frame * FRAME_US, tracks)
        add(world, frame * FRAME_US, [track], source_id=other)
    # as nobody can by the triggers
    world.run("insert into semap.track_state_default (track_id, stamp, x_m, y_m) values (%s, %s, 1, 1)",
              tracks[0], to_datetime(3 * FRAME_US))  # fmt: skip
    with settling(world.dsn):
        await_frames(world, 1, other)
    assert frames(world) == 4 + 1
    add(world, 100 * SECOND_US, tracks)
    assert frames(world) == 5 + 1


def await_frames(world: World, most: int, source_id: int | None = None) -> None:
    asked = "select count(*) from semap.track_state_frame where source_id = coalesce(%s, source_id)"
    until(lambda: world.one(asked, source_id) <= most)


def test_a_day_without_a_partition(world: World, tracks: list[int]) -> None:
    world.run("select semap.ensure_partitions(array[date '1970-01-03'])")
    for day in range(1, 4):
        add(world, day * 86_400 * SECOND_US, tracks)
        add(world, day * 86_400 * SECOND_US + FRAME_US, tracks)
    while world.one("select semap.unfold_frames()"):
        pass
    assert world.rows("select tableoid::regclass::text, count(*) from semap.track_state group by 1 order by 1") == [
        ("semap.track_state_19700103", 6), ("semap.track_state_default", 3 * 2 + 9)
    ]  # fmt: skip


def test_writers_a_worker_and_an_editor_at_once(world: World) -> None:
    """Four sources send frames, one of them late states too, while rows are made and rooms and tracks go."""
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
                    pack_frame(sources[number], frame * FRAME_US, track_ids, x_m, y_m, nothing, nothing),
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
