"""The error ellipse of the newest state is that of the present, whichever way it came there."""

from __future__ import annotations

import random

import pytest
import shapely
from stateful_oracle import Asked, Sample
from test_107_error_ellipse import WITHIN, covariance_of, in_real, share_inside
from world import SECOND_US, World

from semap.store.database.connection import open_engine
from semap.store.motion import moment, track_history
from semap.store.motion.tracks import get_track
from semap.store.operate.doctor.verification import verify
from semap.timeline.stamp import to_datetime

PRESENT = "select x_m, std_m, std_across_m, std_yaw_rad from semap.track_place where track_id = %s"
FRAME = """
    insert into semap.track_state (track_id, stamp, x_m, y_m, std_m, std_across_m, std_yaw_rad)
    select track_id, %s, track_id %% 50 + 0.5 + %s, track_id / 50 + 0.5, 2, 1 + %s, %s from semap.track where map_id = %s
"""


def sample(second: float, x_m: float, *ellipse: float, is_last: bool = False) -> Sample:
    std_m, across_m, yaw_rad = in_real(*ellipse)
    return Sample(int(second * SECOND_US), x_m, 1.0, None, std_m, is_last, across_m, yaw_rad)


def test_in_calm_and_out_of_it_late_and_at_another_source(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 40, 3))
    track = world.add_track("a")
    for second, x_m, *ellipse in (
        (1, 1.5, 0.3, 0.1, 0.5),
        (2, 1.51, 0.5, 0.2, -1.0),
        (3, 39.9, 0.25, 0.0, 1.5),
    ):
        world.add_samples(track, [sample(second, x_m, *ellipse)])
        assert world.rows(PRESENT, track) == [(x_m, *map(pytest.approx, in_real(*ellipse)))]
    before = world.rows(PRESENT, track)
    world.add_samples(track, [sample(2.5, 9, 1, 0.5, 0.1)])
    assert world.rows(PRESENT, track) == before
    world.run("select semap.hand_over_tracks(array[%s]::bigint[], %s)", track, world.add_source("other"))
    assert world.rows(PRESENT, track) == before
    world.add_samples(track, [Sample(4 * SECOND_US, 39.8, 1.0, None, 0.5)])
    assert world.rows(PRESENT, track) == [(39.8, 0.5, None, None)]


def test_places_that_are_written_late_come_with_their_ellipses(world: World) -> None:
    for n in range(210):
        world.add_track(f"t{n}")
    for frame in range(4):
        world.run(
            FRAME, to_datetime(SECOND_US + frame * 100_000), frame / 16, frame / 8, frame / 4, world.map_id
        )
    asked = "select distinct x_m - track_id %% 50, std_m, std_across_m, std_yaw_rad from semap.track_now where map_id = %s"
    assert world.rows(asked, world.map_id) != [(0.6875, 2, 1.375, 0.75)], "not written yet"
    wanted = world.rows("select distinct x_m - track_id %% 50, std_m, std_across_m, std_yaw_rad from semap.present_places(%s)",
                        world.map_id)  # fmt: skip
    world.run("select semap.flush_maps(array[%s]::integer[])", world.map_id)
    assert world.rows(asked, world.map_id) == wanted == [(0.6875, 2, 1.375, 0.75)]


def test_a_repair_brings_the_ellipse_back(world: World) -> None:
    track = world.add_track("a")
    world.add_samples(track, [sample(1, 2, 0.5, 0.125, 0.25)])
    before = world.rows(PRESENT, track)
    world.run("update semap.track_now set x_m = 9, std_m = 1, std_across_m = null, std_yaw_rad = null")
    world.run("select semap.repair_presents(%s)", world.map_id)
    assert world.rows(PRESENT, track) == before


def test_all_who_show_a_state_show_its_ellipse(world: World) -> None:
    track = world.add_track("a")
    world.add_samples(track, [sample(1, 2, 0.5, 0.125, 0.25), sample(2, 3, 0.5, 0.25, -0.5)])
    engine = open_engine(world.dsn, "semap_read", size=1)
    at, end = (to_datetime(second * SECOND_US) for second in (1, 9))
    with engine.begin() as connection:
        now = get_track(connection, track).state
        (shown,) = moment.moment(connection, world.name, end).tracks
        first, second = track_history.history(connection, track, at, end, after=to_datetime(0), limit=9)
        assert track_history.state_at(connection, track, at) == first
    engine.dispose()
    assert (first.std_m, first.std_across_m, first.std_yaw_rad) == (0.5, 0.125, 0.25)
    for each in (now, shown, second):
        assert (each.x_m, each.std_m, each.std_across_m, each.std_yaw_rad) == (3, 0.5, 0.25, -0.5)


def test_a_relation_is_as_probable_as_random_positions_have_it(world: World) -> None:
    ell = shapely.Polygon([(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)])
    world.ask(Asked(enter_probability=0.9, leave_probability=0.1, widest_std_m=10.0))
    world.add_room("ell", ell)
    dice = random.Random(5)
    for n in range(40):
        std_m = dice.choice([0.2, 0.8, 2.0])
        ellipse = in_real(std_m, std_m * dice.choice([0.01, 0.2, 0.7]), dice.uniform(-1.5, 1.5))
        place = (dice.uniform(-1, 7), dice.uniform(-1, 7))
        track = world.add_track(f"t{n}")
        world.add_samples(track, [Sample(SECOND_US, *place, None, ellipse[0], False, *ellipse[1:])])
        found = world.one("select semap.relation_probability(%s, region_id) from semap.region", track)
        share = share_inside(ell, place, covariance_of(*ellipse))
        assert found == pytest.approx(share, abs=WITHIN), (place, ellipse)


@pytest.mark.parametrize("seed", range(2))
def test_the_doctor_follows_ellipses_too(world: World, seed: int) -> None:
    world.ask(Asked(enter_probability=0.95, leave_probability=0.05, widest_std_m=1.0))
    world.run("update semap.source set jump_m = null")
    for n in range(3):
        world.add_room(f"r{n}", shapely.box(2 * n, 0, 2 * n + 2, 6))
    dice = random.Random(seed)
    for n in range(30):
        track, x_m = world.add_track(f"t{n}"), dice.uniform(0, 6)
        for step in range(1, 15):
            x_m += dice.gauss(0, 0.5)
            world.add_samples(
                track, [sample(step, x_m, 0.5, 0.5 * dice.choice([0, 0.1, 1]), dice.uniform(-2, 2))]
            )
    world.run("select pg_drop_replication_slot(semap.rule_slot())")
    assert world.one("select count(*) from semap.relation where raw <> pending or pending <> confirmed") > 3
    verification = verify(world.dsn, lambda said: None)
    with verification.connection:
        assert [each for each in verification.look("world") if each.differ] == []


def test_the_doctor_names_a_relation_that_an_ellipse_ends(world: World) -> None:
    """Outside of a wall, 30 cm from it: what leaves the room is how exact the place is across the wall."""
    world.ask(Asked(enter_probability=0.9, leave_probability=0.1, widest_std_m=1.0))
    world.add_room("room", shapely.box(0, 0, 4, 4))
    track = world.add_track("a")
    world.add_samples(track, [Sample(SECOND_US, 2.0, 2.0, None, 0.5)])
    world.add_samples(track, [Sample(2 * SECOND_US, 2.0, -0.3, None, 0.5)])
    world.run("select pg_drop_replication_slot(semap.rule_slot())")
    assert world.relations() == {("a", "room", SECOND_US)}

    def differing() -> set[str]:
        verification = verify(world.dsn, lambda said: None)
        with verification.connection:
            return {each.name for each in verification.look("world") if each.differ}

    for across_m, yaw_rad, named in (
        (0.05, 0.0, {"stateful relations"}),
        (0.05, 1.5, set()),
        (0.4, 0.0, set()),
    ):
        at = to_datetime(2 * SECOND_US)
        world.run("update semap.state_chunk set std_across_m = array[%s]::real[], std_yaw_rad = array[%s]::real[]"
                  " where from_stamp = %s", across_m, yaw_rad, at)  # fmt: skip
        world.run("update semap.track_now set std_across_m = %s, std_yaw_rad = %s where stamp = %s",
                  across_m, yaw_rad, at)  # fmt: skip
        assert differing() == named, (across_m, yaw_rad)
