"""A room to look into, and plain counterparts of what the renderer computes."""

from __future__ import annotations

import numpy as np
from semap_ingest.sensing.image import Camera
from semap_ingest.simulation.camera_view import CameraView, View
from semap_ingest.simulation.moment import Body, Moment, Surfaces

CAMERA = Camera(
    "camera_optical",
    640,
    480,
    np.array([[320.0, 0.0, 319.5], [0.0, 322.0, 238.0], [0.0, 0.0, 1.0]]),
    np.array([-0.08, 0.01, 0.001, -0.002, 0.0]),
)
MAGENTA = np.full((4, 3), (255, 0, 255), np.uint8)
GREEN = np.full((4, 3), (0, 255, 0), np.uint8)
NOTHING = Surfaces(np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros((0, 3), np.uint8))


def pose(x_m=0.0, y_m=0.0, yaw=0.0, z_m=1.2, pitch=0.0):
    """map_T_camera; looks along x for yaw 0, down for a positive pitch."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    level = np.array([[sin, 0.0, cos], [-cos, 0.0, sin], [0.0, -1.0, 0.0]])
    tilt = np.array([[1, 0, 0], [0, np.cos(pitch), np.sin(pitch)], [0, -np.sin(pitch), np.cos(pitch)]])
    place = np.eye(4)
    place[:3, :3] = level @ tilt
    place[:3, 3] = x_m, y_m, z_m
    return place


def surfaces(*rows):
    """Rows of two ends, lower and upper edge, colour."""
    ends, heights, colours = zip(*rows, strict=True)
    return Surfaces(np.array(ends, float), np.array(heights, float), np.array(colours, np.uint8))


def body(x_m, y_m, *, heading=np.pi, name="anna", clothes=MAGENTA, phase=0.0, swing=0.0, height_m=1.75):
    forward = np.array([np.cos(heading), np.sin(heading)])
    aside = 0.1 * np.array([-forward[1], forward[0]])
    place, reach = np.array([x_m, y_m]), 0.33 * swing * np.cos(phase) * forward
    shins = np.array([place + aside + reach, place - aside - reach])
    return Body(name, place, heading, shins, 0.055, phase, swing, height_m, 0.5, 0.3, clothes)


def moment(*bodies):
    return Moment(0.0, (0.0, 0.0, 0.0), {}, bodies)


def look(*bodies, fixed=NOTHING, leaves=NOTHING, place=None, seed=5) -> View:
    is_plain = fixed is NOTHING and place is None
    view = (
        EMPTY
        if is_plain
        else CameraView(CAMERA, pose() if place is None else place, fixed, np.random.default_rng(1))
    )
    return view.render(moment(*bodies), leaves, np.random.default_rng(seed))


EMPTY = CameraView(CAMERA, pose(), NOTHING, np.random.default_rng(1))


def is_magenta(pixels):
    red, green, blue = np.moveaxis(pixels.astype(int), 2, 0)
    return np.minimum(red, blue) - green > 40


def is_green(pixels):
    red, green, blue = np.moveaxis(pixels.astype(int), 2, 0)
    return green - np.maximum(red, blue) > 40


def box_of(mask):
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5])


def plumb_bob(point_m, camera=CAMERA):
    """sensor_msgs/CameraInfo's model, written out."""
    x, y = point_m[0] / point_m[2], point_m[1] / point_m[2]
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    (fx, _, cx), (_, fy, cy) = camera.matrix[0], camera.matrix[1]
    return np.array([fx * bent_x + cx, fy * bent_y + cy])


def pixel_of(point_m, place, camera=CAMERA):
    """Of a point in the map."""
    return plumb_bob(np.linalg.inv(place)[:3, :3] @ (np.asarray(point_m, float) - place[:3, 3]), camera)
