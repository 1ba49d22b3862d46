"""From ranges to persons on the map, however the laser is mounted and whichever way it turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fusion_scene import CAMERA, Person, boxes_of, pose, robot
from laser.leg_scene import cast
from scipy.spatial.transform import Rotation
from semap_ingest.fusion.persons import SensorGeometry, fuse
from semap_ingest.fusion.placed_clusters import place_clusters
from semap_ingest.laser.detector import LegDetector
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.detections import BOTH, LASER
from semap_ingest.sensing.scan import Scan

PERSONS = [Person(3.0, 0.8), Person(4.0, -0.7, heading=1.0, stride=0.4)]
MOUNTINGS_DEG = {
    "upright": (0, 0, 0),
    "upside down": (180, 0, 0),
    "upside down and turned": (180, 0, 40),
    "tilted a little": (4, -3, 20),
}
"""Roll, pitch and yaw."""


def clockwise(scan: Scan) -> Scan:
    return replace(
        scan,
        angle_min_rad=float(scan.angles_rad[-1]),
        angle_step_rad=-scan.angle_step_rad,
        ranges_m=scan.ranges_m[::-1],
    )


def mounted(name: str) -> np.ndarray:
    """(4, 4) map_T_laser"""
    map_T_laser = pose(0.1, -0.05, 0.3, 0.0)
    map_T_laser[:3, :3] = Rotation.from_euler("xyz", MOUNTINGS_DEG[name], degrees=True).as_matrix()
    return map_T_laser


def ranges_from(map_T_laser: np.ndarray) -> Scan:
    """What it measures of the shins, upright on the map, in its own plane."""
    in_plane = np.linalg.inv(map_T_laser[:2, :2])
    legs = np.concatenate([person.legs for person in PERSONS])
    return cast((legs - map_T_laser[:2, 3]) @ in_plane.T, 0.065, noise_m=0.005, rng=np.random.default_rng(1))


@pytest.mark.parametrize("turns_clockwise", [False, True])
@pytest.mark.parametrize("name", MOUNTINGS_DEG)
def test_persons_stand_where_they_are(name: str, turns_clockwise: bool) -> None:
    map_T_laser = mounted(name)
    scan = ranges_from(map_T_laser)
    clusters = LegDetector.open().detect(clockwise(scan) if turns_clockwise else scan)
    places = np.array([person.place for person in PERSONS])

    by_laser = fuse(None, clusters, SensorGeometry(None, None, map_T_laser), 0)
    believed = by_laser.position_m[by_laser.score > 0.3]
    assert len(believed) == len(PERSONS)
    apart = np.hypot(*(believed[:, None] - places).transpose(2, 0, 1))
    assert apart.min(axis=0).max() < 0.06
    assert (by_laser.seen_by == LASER).all()

    geometry = SensorGeometry(CAMERA, robot().map_T_camera, map_T_laser)
    by_both = fuse(boxes_of(PERSONS, geometry), clusters, geometry, 0)
    assert by_both.seen_by[:2].tolist() == [BOTH, BOTH]
    assert np.hypot(*(by_both.position_m[:2] - places).T).max() < 0.06


@pytest.mark.parametrize("name", MOUNTINGS_DEG)
def test_covariances_turn_with_the_laser(name: str) -> None:
    """As those of points in space that have no spread across the laser's plane."""
    generator = np.random.default_rng(3)
    roots = generator.normal(0, 0.1, (5, 2, 2))
    in_laser = roots @ roots.swapaxes(1, 2)
    centre = generator.uniform(-3, 3, (5, 2))
    clusters = LegClusters(0, "laser", centre, in_laser, np.full(5, 0.8), np.full(5, 0.1), np.full(5, 9))
    placed = place_clusters(clusters, mounted(name), 0.0)
    turn = Rotation.from_euler("xyz", MOUNTINGS_DEG[name], degrees=True)
    in_space = np.zeros((5, 3, 3))
    in_space[:, :2, :2] = in_laser
    expected = turn.as_matrix() @ in_space @ turn.as_matrix().T
    np.testing.assert_allclose(placed.covariance_m2, expected[:, :2, :2], atol=1e-12)
    in_plane = np.column_stack([centre, np.zeros(5)])
    np.testing.assert_allclose(placed.position_m, turn.apply(in_plane) + mounted(name)[:3, 3], atol=1e-12)
