"""The states of doors: what was seen of their leaves, in the order of stamps, by a plain oracle."""

from __future__ import annotations

import math
import random
from itertools import pairwise
from uuid import uuid4

import numpy as np
import pytest
from door_plan import SCAN_US, Door, DoorPlan, LeafOracle
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from world import World

GATE = Door("gate", 4.0, 3.0, math.radians(30))
BACK = Door("back", 9.0, 3.0, math.radians(200), hinge="right", width_m=1.1)


@pytest.fixture
def plan(world: World) -> DoorPlan:
    return DoorPlan(world)


def swing(time_s: float) -> float:
    """Angle [rad]: closed, 0 to 95 degrees within 1.3 s from 2 s on, and back within 1.2 s from 6 s on."""

    def smooth(part: float) -> float:
        part = min(max(part, 0.0), 1.0)
        return part**3 * (10 - 15 * part + 6 * part**2)

    return math.radians(95) * (smooth((time_s - 2) / 1.3) - smooth((time_s - 6) / 1.2))


def first_s(holds, start_s: float = 0.0) -> float:
    return next(t for t in np.arange(start_s, 20, 0.001) if holds(math.degrees(swing(t))))


def test_a_door_that_opens_and_closes_is_told_within_150_ms(plan: DoorPlan) -> None:
    """Six doors, seen at different moments with different noise."""
    dice = random.Random(1)
    lines = []
    for number in range(6):
        door = plan.add(Door(f"d{number}", 3.0 * number, 0.0, number))
        begin_us = dice.randrange(SCAN_US)
        for stamp_us in range(begin_us, 10_000_000, SCAN_US):
            noisy = swing(stamp_us / 1e6) + dice.gauss(0, 0.01)
            lines.append(door.seen(stamp_us, noisy, 0.01, aside_m=dice.gauss(0, 0.01)))
    plan.observe(lines)
    truth_s = {
        "opening": first_s(lambda angle: angle > 10),
        "open": first_s(lambda angle: angle > 70),
        "closing": first_s(lambda angle: angle < 95 - 8, 5),
        "closed": first_s(lambda angle: angle < 6, 6.5),
    }
    for name in plan.ids:
        first, *changes = [(state, stamp_us) for door, state, stamp_us in plan.states() if door == name]
        assert first[0] == "closed"
        assert [state for state, _ in changes] == list(truth_s)
        for state, stamp_us in changes:
            assert -0.03 <= stamp_us / 1e6 - truth_s[state] <= 0.15, state


def test_noise_about_a_threshold_makes_no_states_beyond_it(plan: DoorPlan) -> None:
    """Each state at most once in 20 s."""
    levels = {6: {"closed"}, 10: {"closed", "opening", "open"}, 70: {"open"}}
    dice = random.Random(2)
    for level, expected in levels.items():
        door = plan.add(Door(f"d{level}", level, 0.0))
        plan.observe(
            door.seen((n + 1) * SCAN_US, math.radians(level) + dice.gauss(0, 0.012), 0.012)
            for n in range(300)
        )
        told = [state for name, state, _ in plan.states() if name == door.name]
        assert len(told) == len(set(told))
        assert set(told) <= expected


def test_one_line_that_is_no_leaf_changes_nothing(plan: DoorPlan) -> None:
    """A single outlier, in each state, however exact it claims to be."""
    plan.add(GATE)
    for state_deg, outlier_deg in ((0, 45), (85, 30)):
        start_us = 1_000_000 + state_deg * 1_000_000
        plan.observe(GATE.seen(start_us + n * SCAN_US, math.radians(state_deg), 0.002) for n in range(10))
        before = plan.states()
        plan.observe([GATE.seen(start_us + 10 * SCAN_US, math.radians(outlier_deg), 0.002)])
        plan.observe(GATE.seen(start_us + n * SCAN_US, math.radians(state_deg), 0.002) for n in range(11, 20))
        assert plan.states() == before


def test_a_leaf_left_ajar_is_open_and_a_door_not_seen_keeps_its_state(plan: DoorPlan) -> None:
    plan.add(GATE)
    angles = [0, 0, 5, 15, 25, 35, 40, *[40] * 8]
    plan.observe(GATE.seen((n + 1) * SCAN_US, math.radians(a)) for n, a in enumerate(angles))
    # at 40 degrees from the seventh scan on: at rest 0.4 s later
    assert plan.states()[1:] == [("gate", "opening", 4 * SCAN_US), ("gate", "open", 13 * SCAN_US)]
    assert plan.present("gate")[0] == "open"
    plan.observe([GATE.seen(3_600_000_000, math.radians(41))])
    assert len(plan.states()) == 3


angle = st.one_of(st.integers(-4, 105), st.sampled_from([5.9, 6.1, 9.9, 10.1, 61.9, 62.1, 69.9, 70.1]))
course = st.lists(
    st.tuples(st.integers(1, 300_000), angle, st.sampled_from([0.1, 0.6, 1.9])), min_size=1, max_size=40
)
QUICK = settings(
    max_examples=12,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@QUICK
@given(
    gate=course,
    back=course,
    cuts=st.lists(st.integers(0, 80), max_size=6),
    shuffler=st.randoms(use_true_random=False),
)
def test_any_cut_gives_the_states_of_the_oracle(database: str, gate, back, cuts, shuffler) -> None:
    check(database, gate, back, cuts, shuffler)


@pytest.mark.slow
@settings(QUICK, max_examples=300)
@given(
    gate=course,
    back=course,
    cuts=st.lists(st.integers(0, 80), max_size=6),
    shuffler=st.randoms(use_true_random=False),
)
def test_any_cut_gives_the_states_of_the_oracle_in_many_plays(
    database: str, gate, back, cuts, shuffler
) -> None:
    check(database, gate, back, cuts, shuffler)


def check(database: str, gate, back, cuts, shuffler) -> None:
    world = World(database, f"map {uuid4()}")
    plan = DoorPlan(world)
    expected, lines = [], []
    for door, steps in ((GATE, gate), (BACK, back)):
        plan.add(door)
        oracle, stamp_us = LeafOracle(), 1_000_000
        for place, (after_us, degrees, std_deg) in enumerate(steps):
            stamp_us += after_us
            # no two angles differ by a whole number: a threshold is met, or not, in any arithmetic
            angle_deg = degrees + 0.01 * (place * 0.618034 % 1) + 0.005
            line = door.seen(stamp_us, math.radians(angle_deg), math.radians(std_deg))
            lines.append(line)
            oracle.see(stamp_us, angle_deg, float(np.degrees(np.float32(line[4]))))
        expected += [(door.name, state, at_us) for at_us, state in oracle.changes]
    lines.sort(key=lambda line: line[0])
    bounds = sorted({0, len(lines), *(min(cut, len(lines)) for cut in cuts)})
    bounds = [b for b in bounds if b in (0, len(lines)) or lines[b - 1][0] < lines[b][0]]
    try:
        for low, high in pairwise(bounds):
            batch = lines[low:high]
            shuffler.shuffle(batch)
            plan.observe(batch)
        assert sorted(plan.states()) == sorted(expected)
        assert plan.late() == 0
        # once more: all of it is late
        plan.observe(lines)
        assert sorted(plan.states()) == sorted(expected)
        assert plan.late() == len(lines)
    finally:
        world.close()
