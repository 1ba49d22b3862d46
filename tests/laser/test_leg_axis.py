import numpy as np
import pytest
from laser.leg_scene import STEP_RAD, cast
from semap_ingest.laser.axis import locate_axes
from semap_ingest.laser.clusters import ClusterSettings, find_clusters

TRIES = 120


def errors(radius_m: float, distance_m: float, noise_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors along and across the beam (k, 2), their covariances (k, 2, 2) in the scan, errors in the scan."""
    rng = np.random.default_rng(7)
    turned, missed, said = [], [], []
    for angle in rng.uniform(-2, 2, TRIES):
        towards = np.array([np.cos(angle), np.sin(angle)])
        clusters = find_clusters(
            cast(distance_m * towards, radius_m, noise_m=noise_m, rng=rng), ClusterSettings(min_points=2)
        )
        centre, covariance = locate_axes(clusters, STEP_RAD, np.zeros(len(clusters), bool))
        largest = int(np.argmax(clusters.count))
        error = centre[largest] - distance_m * towards
        turned.append([error @ towards, error @ [-towards[1], towards[0]]])
        missed.append(error)
        said.append(covariance[largest])
    return np.array(turned), np.array(said), np.array(missed)


@pytest.mark.parametrize("radius_m", [0.05, 0.065, 0.08])
@pytest.mark.parametrize("distance_m", [1.0, 3.0, 7.0])
@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_the_axis_is_found_behind_the_visible_face(
    radius_m: float, distance_m: float, noise_m: float
) -> None:
    turned, said, missed = errors(radius_m, distance_m, noise_m)
    along, across = turned.mean(axis=0)
    # the visible face lies 4 to 6 cm before the axis
    assert abs(along) < 0.015
    assert abs(across) < 0.004
    normalised = np.einsum("ni,nij,nj->n", missed, np.linalg.inv(said), missed)
    assert normalised.mean() < 2.5  # two degrees of freedom


def test_noise_as_expected_gives_errors_as_said() -> None:
    _, said, missed = errors(0.065, 4.0, 0.02)
    normalised = np.einsum("ni,nij,nj->n", missed, np.linalg.inv(said), missed)
    assert 0.5 < normalised.mean() < 2.5


def test_two_legs_side_by_side_are_taken_by_their_middle() -> None:
    scan = cast(np.array([[2.0, -0.075], [2.0, 0.075]]), 0.07)
    clusters = find_clusters(scan)
    centre, covariance = locate_axes(clusters, STEP_RAD, np.zeros(len(clusters), bool))
    assert len(clusters) == 1
    np.testing.assert_allclose(centre, [[2.0, 0.0]], atol=0.02)
    assert covariance[0, 1, 1] > covariance[0, 0, 0]


def test_an_edge_that_something_hides_makes_the_axis_uncertain_across() -> None:
    clusters = find_clusters(cast(np.array([3.0, 0.0])))
    _, free = locate_axes(clusters, STEP_RAD, np.array([False]))
    _, hidden = locate_axes(clusters, STEP_RAD, np.array([True]))
    assert hidden[0, 1, 1] > 1.5 * free[0, 1, 1]


@pytest.mark.parametrize("step_rad", [0.0, STEP_RAD, -STEP_RAD])
def test_covariances_are_symmetric_and_positive(step_rad: float) -> None:
    rng = np.random.default_rng(1)
    legs = np.column_stack([rng.uniform(0.3, 6, 20), rng.uniform(-4, 4, 20)])
    clusters = find_clusters(
        cast(legs, 0.06, wall_m=6.5, noise_m=0.02, rng=rng), ClusterSettings(min_points=1)
    )
    centre, covariance = locate_axes(clusters, step_rad, rng.random(len(clusters)) < 0.5)
    assert np.isfinite(centre).all()
    np.testing.assert_allclose(covariance, covariance.transpose(0, 2, 1), atol=1e-12)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
