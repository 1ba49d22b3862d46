"""Where the robot is in the map, told by messages while tf tells only where it is in its odometry.

The pose of the robot in the map, less that in the top of its own tree (odom) at the same stamp, is the place
of that top in the map. Between two messages it is interpolated as any transform; after the last it stays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from semap_ingest.frames.rigid import inverse
from semap_ingest.frames.transform_buffer import Missing, TransformBuffer
from semap_ingest.sensing.transform import Transform


class Localisation:
    """Mutable: what is told waits for the odometry of its stamp.

    buffer     is asked for the odometry
    map_frame  the frame in which places are told
    """

    def __init__(self, buffer: TransformBuffer, map_frame: str) -> None:
        self._buffer, self._map_frame = buffer, map_frame
        self._waiting: list[Transform] = []
        self._last: Transform | None = None

    def tell(self, map_T_robot: Transform) -> None:
        self._waiting.append(map_T_robot)

    def take(self) -> list[Transform]:
        """Where the top of the robot's tree was in the map, as far as the odometry has come."""
        found, still = [], []
        for told in self._waiting:
            top = self._buffer.top_below(told.child, self._map_frame, told.stamp_us)
            top_T_robot = self._buffer.lookup(top, told.child, told.stamp_us)
            if top_T_robot is Missing.NOT_YET:
                still.append(told)
            elif not isinstance(top_T_robot, Missing):
                map_T_robot = np.eye(4)
                map_T_robot[:3, :3] = Rotation.from_quat(told.quaternion).as_matrix()
                map_T_robot[:3, 3] = told.translation_m
                map_T_top = map_T_robot @ inverse(top_T_robot)
                turn = Rotation.from_matrix(map_T_top[:3, :3]).as_quat()
                found.append(Transform(told.stamp_us, told.parent, top, map_T_top[:3, 3], turn))
        self._waiting = still
        self._last = max((*found, *filter(None, [self._last])), key=lambda each: each.stamp_us, default=None)
        return found

    def finish(self, newest_us: int) -> list[Transform]:
        """There is nothing more to come: the last place holds up to this stamp."""
        found = self.take()
        if self._last is None or self._last.stamp_us >= newest_us:
            return found
        return [*found, replace(self._last, stamp_us=newest_us)]
