"""Where a map lies on the earth."""

from __future__ import annotations

from dataclasses import dataclass

from semap.model.pose import IDENTITY, Pose


@dataclass(frozen=True)
class Anchor:
    """`pose` is earth_T_map in the metric system `epsg`."""

    epsg: int
    pose: Pose = IDENTITY
