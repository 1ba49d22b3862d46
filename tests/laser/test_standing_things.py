import numpy as np
from semap_ingest.laser.standing import Standing, StandingThings

PERIOD_US = 66_667
NOBODY = np.zeros((0, 2))


def watch(things, first, count, place, persons=NOBODY, score=0.2):
    """So many scans with clusters at `place(i)`, which look so much like legs."""
    for i in range(first, first + count):
        centre = np.array(place(i), float).reshape(-1, 2)
        things.learn(i * PERIOD_US, centre, np.full(len(centre), score), persons)


def test_what_stands_for_three_seconds_is_a_thing_and_not_before():
    things = StandingThings()
    post = [[2.0, 1.0]]
    watch(things, 0, 44, lambda i: post)
    assert not things.are_things(np.array(post)).any()
    watch(things, 44, 3, lambda i: post)
    assert things.are_things(np.array([[2.0, 1.0], [2.1, 1.0], [2.2, 1.0]])).tolist() == [True, True, False]


def test_noise_and_missed_scans_make_no_difference():
    noise = np.random.default_rng(1)
    things = StandingThings()
    watch(things, 0, 100, lambda i: [] if i % 3 == 0 else [[2.0, 1.0, *noise.normal(0, 0.02, 2)]])
    assert things.are_things(np.array([[2.0, 1.0]])).all()


def test_somebody_who_stands_before_a_laser_for_a_minute_is_none():
    things = StandingThings()
    watch(things, 0, 900, lambda i: [[2.0, 1.0]], score=0.8)
    assert not things.are_things(np.array([[2.0, 1.0]])).any()


def test_it_takes_the_same_time_at_any_rate():
    for rate_hz in (5, 7.5, 40):
        things = StandingThings()
        stamps = np.arange(0, 3_000_001, round(1e6 / rate_hz))
        for stamp_us in stamps[:-1]:
            things.learn(int(stamp_us), np.array([[2.0, 1.0]]), np.array([0.2]), NOBODY)
        assert not things.are_things(np.array([[2.0, 1.0]])).any()
        things.learn(3_000_000, np.array([[2.0, 1.0]]), np.array([0.2]), NOBODY)
        assert things.are_things(np.array([[2.0, 1.0]])).all()


def test_a_person_who_walks_or_who_is_known_is_none():
    things = StandingThings()
    watch(things, 0, 100, lambda i: [[i * 0.05, 0.0]])
    assert not things.are_things(np.array([[4.95, 0.0], [4.0, 0.0]])).any()
    watch(things, 100, 100, lambda i: [[9.0, 0.0]], persons=np.array([[9.2, 0.1]]))
    assert not things.are_things(np.array([[9.0, 0.0]])).any()


def test_a_thing_stays_one_while_a_person_stands_beside_it():
    things = StandingThings()
    watch(things, 0, 60, lambda i: [[2.0, 1.0]])
    watch(things, 60, 60, lambda i: [[2.0, 1.0], [2.2, 1.0]], persons=np.array([[2.2, 1.1]]))
    assert things.are_things(np.array([[2.0, 1.0], [2.2, 1.0]])).tolist() == [True, False]


def test_a_thing_that_is_gone_is_forgotten():
    things = StandingThings(Standing(forgotten_us=1_000_000))
    watch(things, 0, 60, lambda i: [[2.0, 1.0]])
    watch(things, 60, 20, lambda i: [])
    assert not things.are_things(np.array([[2.0, 1.0]])).any()


def test_nothing_is_no_thing():
    things = StandingThings()
    things.learn(0, NOBODY, np.zeros(0), NOBODY)
    assert things.are_things(NOBODY).shape == (0,)
    assert not things.are_things(np.array([[0.0, 0.0]])).any()
