"""Features of all clusters at once against one cluster after the other in plain Python."""

import math
from itertools import pairwise

import numpy as np
import pytest
from laser.leg_scene import cast, scan_of
from semap_ingest.laser.clusters import ScanClusters, find_clusters
from semap_ingest.laser.features import (
    CROWDED_M,
    FACE_M,
    FEATURES,
    JUMP_REACH_M,
    MAX_RADIUS_M,
    NEAREST_REACH_M,
    WALL_M,
    column,
    describe,
)
from semap_ingest.sensing.scan import Scan


def _angle(a: complex, b: complex) -> float:
    """From a to b, -pi to pi."""
    return math.atan2(a.real * b.imag - a.imag * b.real, a.real * b.real + a.imag * b.imag)


def plain(scan: Scan, clusters: ScanClusters, k: int) -> dict[str, float]:
    first, stop = int(clusters.first[k]), int(clusters.stop[k])
    everything = [complex(*p) for p in clusters.points_m]
    points, ranges = everything[first:stop], [abs(p) for p in everything[first:stop]]
    n = len(points)
    mean = sum(points) / n
    median = complex(float(np.median([p.real for p in points])), float(np.median([p.imag for p in points])))
    width = abs(points[-1] - points[0])
    scatter = np.array([[p.real - mean.real, p.imag - mean.imag] for p in points])
    line = float(np.linalg.svd(scatter, compute_uv=False)[1]) ** 2
    design = np.column_stack([2 * scatter, np.ones(n)])
    solution, _, rank, _ = np.linalg.lstsq(design, (scatter**2).sum(axis=1), rcond=None)
    radius = math.sqrt(solution[2] + solution[0] ** 2 + solution[1] ** 2)
    is_round = rank == 3 and radius < MAX_RADIUS_M
    circle = sum((math.hypot(*(p - solution[:2])) - radius) ** 2 for p in scatter) if is_round else line

    stretches = [b - a for a, b in pairwise(points)]
    lengths = [abs(s) for s in stretches]
    turns = [-_angle(a, b) for a, b in pairwise(stretches)]
    curvatures = []
    for a, b, c in zip(points, points[1:], points[2:], strict=False):
        area = ((b - a).real * (c - a).imag - (b - a).imag * (c - a).real) / 2
        curvatures.append(-4 * area / (abs(b - a) * abs(c - b) * abs(c - a)))
    inscribed = [abs(_angle(points[0] - p, points[-1] - p)) for p in points[1:-1]]

    def beside(edge: int, step: int) -> tuple[float, float]:
        other, beam = edge + step, int(clusters.beam[edge])
        if not 0 <= other < len(everything):
            return JUMP_REACH_M, float(beam in (0, len(scan.ranges_m) - 1))
        is_next = abs(int(clusters.beam[other]) - beam) == 1
        jump = min(abs(everything[other] - everything[edge]), JUMP_REACH_M)
        return jump, float(is_next and abs(everything[other]) < abs(everything[edge]))

    nearest, nearest_width = NEAREST_REACH_M, 0.0
    for j in range(len(clusters)):
        other = everything[int(clusters.first[j]) : int(clusters.stop[j])]
        other_width = abs(other[-1] - other[0])
        apart = abs(sum(other) / len(other) - mean)
        if j != k and 0.02 <= other_width <= 0.35 and apart < nearest:
            nearest, nearest_width = apart, other_width

    (jump_before, occluded_before), (jump_after, occluded_after) = beside(first, -1), beside(stop - 1, 1)
    bulge = (ranges[0] + ranges[-1]) / 2 - sum(ranges[1:-1]) / (n - 2)
    spacing = abs(median) * abs(scan.angle_step_rad)
    span = (int(clusters.beam[stop - 1]) - int(clusters.beam[first])) * scan.angle_step_rad
    across = (ranges[0] + ranges[-1]) * math.sin(min(abs(span), math.pi) / 2)
    return {
        "std_m": math.sqrt(sum(abs(p - mean) ** 2 for p in points) / (n - 1)),
        "median_deviation_m": sum(abs(p - median) for p in points) / n,
        "jump_before_m": jump_before,
        "jump_after_m": jump_after,
        "width_m": width,
        "radius_m": radius if is_round else MAX_RADIUS_M,
        "boundary_m": sum(lengths),
        "regularity_m": float(np.std(lengths)),
        "curvature_per_m": float(np.mean(curvatures)),
        "turn_rad": float(np.mean(turns)),
        "inscribed_rad": float(np.mean(inscribed)),
        "inscribed_std_rad": float(np.std(inscribed)),
        "distance_m": abs(median),
        "occluded_before": occluded_before,
        "occluded_after": occluded_after,
        "line_rms_m": math.sqrt(line / n),
        "circle_rms_m": math.sqrt(circle / n),
        "bulge_m": bulge,
        "depth_m": max(ranges) - min(ranges),
        "nearest_m": nearest,
        "nearest_width_m": nearest_width,
        "spacing_m": spacing,
        "points_per_width": n * spacing / max(width, 1e-3),
        "across_m": across,
        "slant": abs(ranges[-1] - ranges[0]) / max(width, 1e-3),
        "bulge_per_across": bulge / max(across, 1e-3),
        **around(scan, clusters, k, mean, width),
    }


def around(scan: Scan, clusters: ScanClusters, k: int, mean: complex, width: float) -> dict[str, float]:
    first, stop = int(clusters.first[k]), int(clusters.stop[k])
    everything = [complex(*p) for p in clusters.points_m]
    others = [p for j, p in enumerate(everything) if not first <= j < stop]
    reach = [max(abs(p - mean) - width / 2, 0.0) for p in others]
    ahead = mean / abs(mean)
    beside = [r for p, r in zip(others, reach, strict=True) if ((p - mean) * ahead.conjugate()).real < FACE_M]
    step = abs(scan.angle_step_rad)
    apart = []
    for j in range(len(clusters)):
        other = everything[int(clusters.first[j]) : int(clusters.stop[j])]
        if j != k and 0.02 <= abs(other[-1] - other[0]) <= 0.35:
            apart.append(abs(sum(other) / len(other) - mean))
    wall = np.array([[p.real, p.imag] for p, r in zip(others, reach, strict=True) if r < WALL_M]).reshape(
        -1, 2
    )
    off = spread = 1.0
    if len(wall) >= 3:
        middle = wall.mean(axis=0)
        _, (long, short), axes = np.linalg.svd(wall - middle)
        off = min(abs(float(axes[1] @ (middle - [mean.real, mean.imag]))), 1.0)
        spread = float(short / max(long, 1e-9))

    def gap(edge: int, other: int) -> float:
        is_there = 0 <= other < len(everything)
        return float(np.clip(abs(everything[other]) - abs(everything[edge]), -1, 1)) if is_there else 0.0

    crowds = [sum(abs(p) * step for p, r in zip(others, reach, strict=True) if r < w) for w in CROWDED_M]
    return {
        "gap_before_m": gap(first, first - 1),
        "gap_after_m": gap(stop - 1, stop),
        "alone_m": min([*reach, 1.0]),
        "alone_beside_m": min([*beside, 1.0]),
        **{f"crowd_{n}_m": length for n, length in enumerate(crowds)},
        "narrow_1": sum(a <= 1.0 for a in apart),
        "narrow_2": sum(a <= 2.0 for a in apart),
        "wall_off_m": off,
        "wall_spread": spread,
    }


@pytest.mark.parametrize("seed", range(6))
def test_every_feature_is_that_of_plain_python(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle, reach = rng.uniform(-2.2, 2.2, 14), rng.uniform(0.4, 5.0, 14)
    legs = reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    scan = cast(legs, 0.07, wall_m=4.0, noise_m=0.015, rng=rng)
    scan.ranges_m[rng.random(len(scan.ranges_m)) < 0.05] = 0.0
    clusters = find_clusters(scan)
    described = describe(scan, clusters)
    expected = [plain(scan, clusters, k) for k in range(len(clusters))]
    assert len(clusters) > 8
    for name in FEATURES:
        np.testing.assert_allclose(
            column(described, name), [each[name] for each in expected], rtol=2e-4, atol=2e-6, err_msg=name
        )


def test_a_round_leg_is_round_and_bulges_towards_the_laser() -> None:
    scan = cast(np.array([[1.5, 0.2]]), 0.06)
    described = describe(scan, find_clusters(scan))
    np.testing.assert_allclose(column(described, "radius_m"), [0.06], rtol=1e-3)
    np.testing.assert_allclose(column(described, "curvature_per_m"), [1 / 0.06], rtol=1e-2)
    assert column(described, "circle_rms_m")[0] < 1e-5
    assert column(described, "bulge_m")[0] > 0.02


def test_a_hollow_bulges_away_from_the_laser() -> None:
    angle = np.linspace(-0.05, 0.05, 17)
    scan = scan_of(2.0 + 0.1 * np.cos(angle * 30), 0.1 / 16, -0.05)
    described = describe(scan, find_clusters(scan))
    assert column(described, "curvature_per_m")[0] < 0
    assert column(described, "turn_rad")[0] < 0


@pytest.mark.parametrize("skip", [2, 3])
def test_a_leg_looks_the_same_to_a_coarser_laser(skip: int) -> None:
    """Nothing of it counts beams: what changes is by how much its edges are uncertain, and the spacing itself."""
    fine = cast(np.array([[1.2, 0.2], [1.3, -0.2]]), 0.07, wall_m=3.0)
    coarse = scan_of(fine.ranges_m[::skip], fine.angle_step_rad * skip, fine.angle_min_rad)
    (leg, *_), (same, *_) = (
        each[(column(each, "distance_m") < 2)]
        for each in (describe(s, find_clusters(s)) for s in (fine, coarse))
    )
    spacing_m = 1.3 * coarse.angle_step_rad
    apart = dict(zip(FEATURES, np.abs(leg - same).tolist(), strict=True))
    for name in (
        "width_m",
        "across_m",
        "std_m",
        "line_rms_m",
        "boundary_m",
        "depth_m",
        "nearest_m",
        "alone_m",
    ):
        assert apart[name] <= 2 * spacing_m, name
    assert apart["narrow_1"] == apart["narrow_2"] == 0


@pytest.mark.parametrize(
    ("measured", "step_rad"),
    [
        ([1.0] * 30, 0.0),
        ([1.0, 1.0, 1.0], 0.006),
        ([1e-6] * 40, 0.006),
        (list(np.linspace(0.5, 24.0, 2000)), 1e-5),
        ([1.0] * 900, -0.007),
        ([2.0, 2.0], 0.006),
    ],
)
def test_degenerate_clusters_have_finite_features(measured: list[float], step_rad: float) -> None:
    scan = Scan(0, "laser", -1.0, step_rad, 0.0, 25.0, np.array(measured, np.float32))
    clusters = find_clusters(scan)
    described = describe(scan, clusters)
    assert described.shape == (len(clusters), len(FEATURES))
    assert np.isfinite(described).all()


def test_very_many_beams() -> None:
    rng = np.random.default_rng(0)
    scan = scan_of(np.repeat(rng.uniform(0.5, 20.0, 30_000), 10), 1.57e-5)
    clusters = find_clusters(scan)
    described = describe(scan, clusters)
    assert len(clusters) > 20_000
    assert np.isfinite(described).all()
