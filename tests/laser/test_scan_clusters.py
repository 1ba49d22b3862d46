import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laser.leg_scene import STEP_RAD, cast, scan_of
from semap_ingest.laser.clusters import ClusterSettings, find_clusters
from semap_ingest.sensing.scan import Scan


def plain_clusters(scan: Scan, settings: ClusterSettings) -> list[list[int]]:
    """Beam numbers of each cluster, one point after the other."""
    clusters: list[list[int]] = []
    for beam, measured in enumerate(map(float, scan.ranges_m)):
        if not (math.isfinite(measured) and max(scan.range_min_m, 1e-30) <= measured <= scan.range_max_m):
            continue
        if clusters:
            before = clusters[-1][-1]
            other = float(scan.ranges_m[before])
            apart = math.dist(
                *(
                    (r * math.cos(a), r * math.sin(a))
                    for r, a in (
                        (measured, scan.angle_min_rad + beam * scan.angle_step_rad),
                        (other, scan.angle_min_rad + before * scan.angle_step_rad),
                    )
                )
            )
            allowed = max(settings.jump_m, settings.jump_beams * scan.angle_step_rad * min(measured, other))
            if apart <= allowed and (beam - before - 1) * scan.angle_step_rad <= settings.gap_rad:
                clusters[-1].append(beam)
                continue
        clusters.append([beam])

    def least(cluster: list[int]) -> int:
        is_coarse = float(scan.ranges_m[cluster[0]]) * scan.angle_step_rad > settings.coarse_m
        return max(settings.min_points - is_coarse, 1)

    return [cluster for cluster in clusters if len(cluster) >= least(cluster)]


ranges = st.lists(
    st.one_of(
        st.floats(0.25, 3.0, width=32),
        st.sampled_from([0.0, math.nan, math.inf, -math.inf, -1.0, 30.0, 1.0, 1.05, 1.1]),
    ),
    max_size=60,
)


@given(ranges, st.integers(1, 4), st.floats(0.003, 0.03))
@settings(max_examples=150, deadline=None)
def test_clusters_are_those_of_a_walk_along_the_points(
    measured: list[float], least: int, step_rad: float
) -> None:
    scan = scan_of(measured, step_rad)
    cutting = ClusterSettings(min_points=least)
    clusters = find_clusters(scan, cutting)
    beams = [list(clusters.beam[a:b]) for a, b in zip(clusters.first, clusters.stop, strict=True)]
    assert beams == plain_clusters(scan, cutting)
    assert list(clusters.beam[clusters.member]) == [beam for cluster in beams for beam in cluster]
    assert list(np.bincount(clusters.cluster_of, minlength=len(beams))) == [len(each) for each in beams]


def test_a_laser_that_turns_clockwise_sees_the_same_clusters() -> None:
    there = cast(np.array([[2.0, 0.3], [1.5, -0.4]]), wall_m=5.0)
    last = there.angle_min_rad + there.angle_step_rad * (len(there.ranges_m) - 1)
    back = Scan(0, "laser", last, -there.angle_step_rad, 0.05, 25.0, there.ranges_m[::-1])
    one, other = find_clusters(there), find_clusters(back)
    np.testing.assert_allclose(one.points_m, other.points_m, atol=1e-9)
    np.testing.assert_array_equal(one.first, other.first)


def test_a_leg_with_dropouts_stays_one() -> None:
    scan = cast(np.array([[2.0, 0.0]]))
    hit = np.flatnonzero(np.isfinite(scan.ranges_m))
    scan.ranges_m[hit[4:8]] = 0.0
    clusters = find_clusters(scan)
    assert list(clusters.count) == [len(hit) - 4]
    assert len(find_clusters(scan, ClusterSettings(gap_rad=3.5 * STEP_RAD))) == 2


@pytest.mark.parametrize("measured", [[], [math.nan] * 50, [math.inf] * 50, [0.0] * 50, [1.0]])
def test_a_scan_without_clusters(measured: list[float]) -> None:
    clusters = find_clusters(scan_of(measured))
    assert len(clusters) == 0
    assert clusters.mean(clusters.points_m[clusters.member]).shape == (0, 2)


def test_angles_that_are_no_numbers_give_no_points() -> None:
    assert len(find_clusters(scan_of([1.0] * 20, first_rad=math.nan))) == 0
