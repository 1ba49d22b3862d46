"""The batch against filterpy, one track at a time."""

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal
from semap_ingest.tracking.kalman import Gaussians, distances, predict, update

STEPS_S = st.floats(0.001, 5.0)


def random_covariances(random: np.random.Generator, count: int, size: int) -> np.ndarray:
    roots = random.normal(size=(count, size, size))
    return roots @ np.swapaxes(roots, 1, 2) + 0.01 * np.eye(size)


def random_states(random: np.random.Generator, count: int, axes: int) -> Gaussians:
    return Gaussians(random.normal(0, 5, (count, 2 * axes)), random_covariances(random, count, 2 * axes))


def filters(states: Gaussians) -> list[KalmanFilter]:
    """One of filterpy's for each track, with our order of the state."""
    axes = states.mean.shape[1] // 2
    made = []
    for mean, covariance in zip(states.mean, states.covariance, strict=True):
        one = KalmanFilter(dim_x=2 * axes, dim_z=axes)
        one.H = np.hstack([np.eye(axes), np.zeros((axes, axes))])
        one.x, one.P = mean[:, None].copy(), covariance.copy()
        made.append(one)
    return made


def transition(axes: int, step_s: float) -> np.ndarray:
    return np.kron([[1.0, step_s], [0.0, 1.0]], np.eye(axes))


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 4),
    axes=st.integers(1, 4),
    steps=st.lists(st.tuples(STEPS_S, st.floats(0.01, 10), st.booleans()), min_size=1, max_size=8),
)
@settings(max_examples=60, deadline=None)
def test_equal_to_filterpy_over_any_sequence(
    seed: int, count: int, axes: int, steps: list[tuple[float, float, bool]]
) -> None:
    random = np.random.default_rng(seed)
    states = random_states(random, count, axes)
    oracles = filters(states)
    for step_s, density, is_detected in steps:
        states = predict(states, step_s, density)
        for oracle in oracles:
            noise = Q_continuous_white_noise(2, step_s, density, axes, order_by_dim=False)
            oracle.predict(F=transition(axes, step_s), Q=noise)
        if is_detected:
            measured = random.normal(0, 5, (count, axes))
            covariance = random_covariances(random, count, axes)
            states = update(states, measured, covariance)
            for oracle, place, uncertainty in zip(oracles, measured, covariance, strict=True):
                oracle.update(place[:, None], R=uncertainty)
    for mean, covariance, oracle in zip(states.mean, states.covariance, oracles, strict=True):
        np.testing.assert_allclose(mean, oracle.x[:, 0], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(covariance, oracle.P, rtol=1e-9, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), first_s=STEPS_S, second_s=STEPS_S)
@settings(max_examples=30, deadline=None)
def test_two_steps_are_one_of_both_together(seed: int, first_s: float, second_s: float) -> None:
    states = random_states(np.random.default_rng(seed), 3, 2)
    density = np.array([0.1, 1.0, 3.0])
    twice = predict(predict(states, first_s, density), second_s, density)
    once = predict(states, first_s + second_s, density)
    np.testing.assert_allclose(twice.mean, once.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(twice.covariance, once.covariance, rtol=1e-9, atol=1e-9)


def test_distances_are_the_likelihood_of_each_measurement_of_each_track() -> None:
    random = np.random.default_rng(1)
    states, measured = random_states(random, 4, 2), random.normal(0, 5, (3, 2))
    covariance = random_covariances(random, 12, 2).reshape(4, 3, 2, 2)
    found = distances(states, measured, covariance)
    for track in range(4):
        for row in range(3):
            spread = states.covariance[track, :2, :2] + covariance[track, row]
            density = multivariate_normal(states.mean[track, :2], spread).logpdf(measured[row])
            ours = -0.5 * (found.squared[track, row] + found.log_determinant[track, row]) - np.log(2 * np.pi)
            assert abs(ours - density) < 1e-9


def test_an_exact_measurement_leaves_a_valid_covariance() -> None:
    states = random_states(np.random.default_rng(2), 5, 2)
    for _ in range(200):
        states = update(predict(states, 0.05, 1.0), np.zeros((5, 2)), np.tile(1e-12 * np.eye(2), (5, 1, 1)))
    assert (np.linalg.eigvalsh(states.covariance) > -1e-15).all()
    np.testing.assert_array_equal(states.covariance, np.swapaxes(states.covariance, 1, 2))
