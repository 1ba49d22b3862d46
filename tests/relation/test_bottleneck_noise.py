"""75 people who cross one line once: at full rate, once a second, and with the noise of a tracker."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from data_sets import data_set
from numpy.typing import NDArray
from stateful_oracle import Asked, Sample
from world import World

LINE_M = -0.6
FRAMES_PER_S = 25
BEYOND = shapely.box(-20, -20, 20, LINE_M)
DEFAULT_DEBOUNCE = {"enter_margin_m": 0.15, "leave_margin_m": 0.15}
WAY = {"longest_gap": 30.0, "fastest_mps": 30.0}


@pytest.fixture(scope="module")
def walkers() -> dict[int, NDArray[np.float64]]:
    """Frame, x [m] and y [m] of each person, by number."""
    rows = np.loadtxt(data_set("bottleneck") / "040_c_56_h-.txt")
    return {int(person): rows[rows[:, 0] == person][:, 1:4] for person in np.unique(rows[:, 0])}


def crossings(world: World, walkers: dict[int, NDArray[np.float64]], *, every: int = 1, noise_m: float = 0.0):
    """Kind, stamp [s] and moment of the edge [s] of each change that is no first or last sight."""
    dice = np.random.default_rng(7)
    world.add_room("beyond", BEYOND)
    for person, seen in walkers.items():
        track_id = world.add_track(str(person))
        places = seen[:, 1:] + dice.normal(0, noise_m, seen[:, 1:].shape) if noise_m else seen[:, 1:]
        kept = np.unique(np.append(np.arange(0, len(seen), every), len(seen) - 1))
        world.add_samples(
            track_id,
            [Sample(int(seen[n, 0] * 1e6 / FRAMES_PER_S), *map(float, places[n]), None) for n in kept],
        )
    return world.rows(
        "select kind::text, extract(epoch from stamp)::float8, extract(epoch from transition_at)::float8, track_name"
        " from semap.relation_change where map_id = %s and cause = 'moved' order by change_id",
        world.map_id,
    )


def moments(walkers: dict[int, NDArray[np.float64]]) -> dict[str, float]:
    """When each person crosses the line [s], on the straight way between two frames."""
    found = {}
    for person, seen in walkers.items():
        (n,) = np.flatnonzero((seen[:-1, 2] >= LINE_M) & (seen[1:, 2] < LINE_M))[-1:]
        (frame, _, y), (after, _, y_after) = seen[n], seen[n + 1]
        found[str(person)] = (frame + (after - frame) * (y - LINE_M) / (y - y_after)) / FRAMES_PER_S
    return found


@pytest.mark.parametrize("every", [1, FRAMES_PER_S])
def test_everyone_crosses_once_at_any_rate(world: World, walkers: dict, every: int) -> None:
    world.ask(Asked(**WAY))
    found = crossings(world, walkers, every=every)
    assert [kind for kind, *_ in found] == ["began"] * 75
    exact = moments(walkers)
    off_s = [abs(edge_s - exact[name]) for _, _, edge_s, name in found]
    assert max(off_s) <= (1e-6 if every == 1 else 0.5)
    assert all(edge_s <= stamp_s < edge_s + every / FRAMES_PER_S + 0.05 for _, stamp_s, edge_s, _ in found)


def test_noise_multiplies_crossings_and_the_default_debounce_makes_them_75_again(
    world: World, walkers: dict
) -> None:
    world.ask(Asked(**WAY))
    flickering = crossings(world, walkers, noise_m=0.05)
    assert len(flickering) > 75 * 3 // 2
    calm = World(world.dsn, "debounced")
    try:
        calm.ask(Asked(**WAY, **DEFAULT_DEBOUNCE))
        found = crossings(calm, walkers, noise_m=0.05)
        assert [kind for kind, *_ in found] == ["began"] * 75
        exact = moments(walkers)
        off_s = [abs(edge_s - exact[name]) for _, _, edge_s, name in found]
        assert np.median(off_s) < 0.1
    finally:
        calm.close()
