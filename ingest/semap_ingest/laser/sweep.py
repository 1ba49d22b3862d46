"""A sweep of a laser that moved meanwhile, as it would have been from where it began.

Each beam was sent from where the laser was at its time: between its poses at the first and at the last beam,
as `laser_geometry` of ROS takes it (linear and slerp).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semap_ingest.sensing.scan import Scan


def straightened(scan: Scan, first_T_last: NDArray[np.float64]) -> Scan:
    """The same points, seen from the pose of the first beam.

    first_T_last  (4, 4) pose of the laser at its last beam, in its frame at its first
    """
    share = np.linspace(0.0, 1.0, len(scan.ranges_m))
    turns = Rotation.from_rotvec(share[:, None] * Rotation.from_matrix(first_T_last[:3, :3]).as_rotvec())
    angles_rad = scan.angles_rad
    beams = np.column_stack([np.cos(angles_rad), np.sin(angles_rad), np.zeros(len(angles_rad))])
    turned = turns.apply(beams)
    ranges_m = scan.ranges_m.astype(np.float64)
    ends_m = np.where(scan.is_return, ranges_m, 0.0)[:, None] * turned + share[:, None] * first_T_last[:3, 3]
    seen = np.where(scan.is_return[:, None], ends_m, turned)
    new_rad = np.unwrap(np.arctan2(seen[:, 1], seen[:, 0]))
    new_rad += 2 * np.pi * np.round((angles_rad[0] - new_rad[0]) / (2 * np.pi))
    moved_m = np.hypot(ends_m[:, 0], ends_m[:, 1])
    # What came back stays what came back, though the laser went nearer to it than it can measure.
    moved_m = np.clip(moved_m, scan.range_min_m, scan.range_max_m)
    new_m = np.where(scan.is_return, moved_m, ranges_m).astype(np.float32)
    return replace(scan, ranges_m=new_m, beam_s=0.0, own_angles_rad=new_rad)
