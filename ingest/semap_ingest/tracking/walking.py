"""How a person walks, and how exactly a detection shows it.

At the height of a laser the middle of the legs sways about the middle of the body, along the way, in time
with the steps: in double support both feet stand while the body goes on, then one swings past it. That error
is not white: it keeps its sign for a part of a step, so that more frames a second bring no more knowledge of
it. A filter that takes it for white noise becomes sure of what it does not know, and its velocity sways as
well. So the sway's variance is multiplied by how many detections of its track, of whichever sensor, fall into
that time: white noise of the same power density at the frequencies of walking.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.tracking.map_tracks import MapTracks

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Walking:
    """How much a person's velocity changes, and the legs sway.

    acceleration_density  of the white noise of acceleration on each axis [m^2/s^3]
    stance_std_m          of the middle of the legs about that of the body when standing, on each axis
    sway_std_m            more than that along the way, at `full_stride_mps`; in proportion to the speed
    sway_time_s           how long the sway keeps its sign
    first_frames          how many detections of a new track are taken to fall into that time
    speed_std_mps         of a new track, on each axis
    """

    acceleration_density: float = 0.5
    stance_std_m: float = 0.03
    sway_std_m: float = 0.09
    full_stride_mps: float = 1.2
    sway_time_s: float = 0.25
    first_frames: float = 4.0
    speed_std_mps: float = 0.8


def frames_within(tracks: MapTracks, stamp_us: int, walking: Walking) -> Floats:
    """(n,) how many detections fall into the sway's time with one at that stamp, older ones counting less.

    At a steady rate that is the time over the period, whichever sensors they are of.
    """
    since_s = (stamp_us - tracks.seen_us) / 1e6
    return np.asarray(1.0 + tracks.frames * np.maximum(1.0 - since_s / walking.sway_time_s, 0.0), np.float64)


def sway_covariance(tracks: MapTracks, frames: Floats, walking: Walking) -> Floats:
    """(n, 2, 2) [m^2], to be added to a detection's covariance.

    frames  (n,) as `frames_within` says
    """
    velocity = tracks.mean[:, 2:]
    speed_mps = np.hypot(velocity[:, 0], velocity[:, 1])
    along_m = walking.sway_std_m * velocity / np.maximum(speed_mps, walking.full_stride_mps)[:, None]
    covariance = walking.stance_std_m**2 * np.eye(2) + along_m[:, :, None] * along_m[:, None, :]
    return np.asarray(frames[:, None, None] * covariance, np.float64)
