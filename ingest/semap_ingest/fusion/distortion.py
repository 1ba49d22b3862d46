"""How a lens bends rays, and back again: the models of sensor_msgs/CameraInfo.

A ray is told by where it meets the plane z = 1 of the optical frame: x and y, no unit. With s = x^2 +
y^2, and D in the order of OpenCV (calib3d, "Camera Calibration and 3D Reconstruction"; its fisheye module
for equidistant):

    x' = x g(s) + 2 p1 x y + p2 (s + 2 x^2)
    y' = y g(s) + p1 (s + 2 y^2) + 2 p2 x y

    plumb_bob            D = k1 k2 p1 p2 k3: g = 1 + k1 s + k2 s^2 + k3 s^3
    rational_polynomial  D = k1 k2 p1 p2 k3 k4 k5 k6: that g divided by 1 + k4 s + k5 s^2 + k6 s^3
    equidistant          D = k1 k2 k3 k4, p1 = p2 = 0:
                         g = (t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9) / sqrt(s) with t = atan(sqrt(s))

Such a polynomial fits a lens as far as it was calibrated. Farther out it may turn back, so that two rays
fall on one pixel. Where it first does is the limit of the lens, and what lies beyond is outside of the
model: NaN.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.sensing.image import Camera

PARAMETERS = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
MAX_STEPS = 40
TABLE_SIZE = 1025
FARTHEST_RAD = np.pi / 2 - 1e-6
CLOSE_ENOUGH = 1e-10
INSIDE = 0.98


@dataclass(frozen=True, eq=False)
class Lens:
    """The distortion of a camera.

    numerator, denominator   of g by powers of s; for equidistant the numerator is of t g by powers of t^2
    limit                    greatest sqrt(s) of the model; infinite if it holds everywhere
    radii, bent_radii        (m,) sqrt(s) up to the limit, and sqrt(x'^2 + y'^2) without the tangential part
    """

    is_equidistant: bool
    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    p1: float
    p2: float
    limit: float
    radii: NDArray[np.float64]
    bent_radii: NDArray[np.float64]


def lens_of(camera: Camera) -> Lens:
    """Raises InvalidInput for a model or a number of parameters that is not one of those above."""
    return _lens(camera.model, tuple(np.asarray(camera.distortion, dtype=np.float64).ravel().tolist()))


def distort(lens: Lens, rays: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where rays go, and how that changes with the ray.

    rays     (n, 2) x and y
    returns  (n, 2) x' and y', and (n, 2, 2) their derivatives by x and y; NaN beyond the limit of the lens
    """
    with np.errstate(over="ignore", invalid="ignore"):
        x, y = rays[:, 0], rays[:, 1]
        s = x * x + y * y
        g, slope = _radial(lens.is_equidistant, lens.numerator, lens.denominator, s)
        bent = rays * g[:, None]
        by_ray = np.empty((len(rays), 2, 2))
        by_ray[:, 0, 0] = g + 2 * slope * x * x
        by_ray[:, 0, 1] = by_ray[:, 1, 0] = 2 * slope * x * y
        by_ray[:, 1, 1] = g + 2 * slope * y * y
        if lens.p1 or lens.p2:
            bent[:, 0] += 2 * lens.p1 * x * y + lens.p2 * (s + 2 * x * x)
            bent[:, 1] += lens.p1 * (s + 2 * y * y) + 2 * lens.p2 * x * y
            by_ray[:, 0, 0] += 2 * lens.p1 * y + 6 * lens.p2 * x
            by_ray[:, 0, 1] += 2 * lens.p1 * x + 2 * lens.p2 * y
            by_ray[:, 1, 0] = by_ray[:, 0, 1]
            by_ray[:, 1, 1] += 6 * lens.p1 * y + 2 * lens.p2 * x
        is_outside = ~((s < lens.limit**2) & (_determinant(by_ray) > 0))
    if is_outside.any():
        bent[is_outside] = np.nan
        by_ray[is_outside] = np.nan
    return bent, by_ray


def undistort(lens: Lens, bent: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rays that `distort` bends to these, by Newton's method; NaN where there is none.

    Also NaN within a hair of the limit of the lens, if its tangential part makes the ray uncertain there.

    bent     (n, 2) x' and y'
    returns  (n, 2) x and y
    """
    rays = _first_guess(lens, bent)
    before = np.zeros_like(rays)
    found = np.full_like(rays, np.nan)
    close_enough = CLOSE_ENOUGH * (1 + np.abs(bent))
    for _ in range(MAX_STEPS):
        reached, by_ray = distort(lens, rays)
        missed = bent - reached
        is_found = (np.abs(missed) <= close_enough).all(axis=1)
        found[is_found] = rays[is_found]
        if (is_found | np.isnan(rays[:, 0])).all():
            break
        step = np.empty_like(rays)
        step[:, 0] = by_ray[:, 1, 1] * missed[:, 0] - by_ray[:, 0, 1] * missed[:, 1]
        step[:, 1] = by_ray[:, 0, 0] * missed[:, 1] - by_ray[:, 1, 0] * missed[:, 0]
        step /= _determinant(by_ray)[:, None]
        has_left = np.isnan(missed[:, :1])
        before, rays = np.where(has_left, before, rays), np.where(has_left, (before + rays) / 2, rays + step)
    return found


def _first_guess(lens: Lens, bent: NDArray[np.float64]) -> NDArray[np.float64]:
    """Without the tangential part; NaN where no ray can go."""
    radius = np.hypot(bent[:, 0], bent[:, 1])
    farthest = lens.bent_radii[-1] + 3 * (abs(lens.p1) + abs(lens.p2)) * lens.radii[-1] ** 2
    guess = np.minimum(np.interp(radius, lens.bent_radii, lens.radii), INSIDE * lens.limit)
    guess[~(radius <= farthest)] = np.nan
    return np.asarray(bent * (guess / np.where(radius > 0, radius, 1.0))[:, None])


def _radial(
    is_equidistant: bool,
    numerator: tuple[float, ...],
    denominator: tuple[float, ...],
    s: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) g, and its derivative by s."""
    if is_equidistant:
        return _radial_of_angle(numerator, s)
    _, k1, k2, k3 = numerator
    above, above_slope = 1 + s * (k1 + s * (k2 + s * k3)), k1 + s * (2 * k2 + 3 * s * k3)
    _, k4, k5, k6 = denominator
    if not (k4 or k5 or k6):
        return above, above_slope
    below, below_slope = 1 + s * (k4 + s * (k5 + s * k6)), k4 + s * (2 * k5 + 3 * s * k6)
    with np.errstate(divide="ignore", invalid="ignore"):
        return above / below, (above_slope * below - above * below_slope) / below**2


def _radial_of_angle(
    numerator: tuple[float, ...], s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    radius = np.sqrt(s)
    angle = np.arctan(radius)
    squared = angle * angle
    _, k1, k2, k3, k4 = numerator
    bent = angle * (1 + squared * (k1 + squared * (k2 + squared * (k3 + squared * k4))))
    by_angle = 1 + squared * (3 * k1 + squared * (5 * k2 + squared * (7 * k3 + squared * 9 * k4)))
    # Near the axis both quotients are 0 / 0; there the series of g is 1 + (k1 - 1/3) s.
    is_axis = s < 1e-8
    safe_s, safe_radius = np.where(is_axis, 1.0, s), np.where(is_axis, 1.0, radius)
    g = np.where(is_axis, 1 + (k1 - 1 / 3) * s, bent / safe_radius)
    slope = np.where(is_axis, k1 - 1 / 3, (by_angle / (1 + s) - g) / (2 * safe_s))
    return g, slope


@lru_cache(maxsize=64)
def _lens(model: str, parameters: tuple[float, ...]) -> Lens:
    if model not in PARAMETERS:
        raise InvalidInput(
            f"The distortion model {model} is not known.", f"Use one of {', '.join(PARAMETERS)}.", "camera"
        )
    count = PARAMETERS[model]
    if not np.isfinite(parameters).all() or any(parameters[count:]):
        raise InvalidInput(
            f"The distortion {list(parameters)} does not fit the model {model}.",
            f"{model} has {count} parameters, all of them numbers.",
            "camera",
        )
    ks = [*parameters[:count], *[0.0] * (count - len(parameters))]
    if model == "equidistant":
        return _measured(True, (1.0, *ks), (1.0,), 0.0, 0.0)
    k1, k2, p1, p2, k3, *below = ks
    return _measured(False, (1.0, k1, k2, k3), (1.0, *(below or (0.0, 0.0, 0.0))), p1, p2)


def _measured(
    is_equidistant: bool, numerator: tuple[float, ...], denominator: tuple[float, ...], p1: float, p2: float
) -> Lens:
    """The lens with its limit: where the radius stops to grow, or the denominator is zero."""

    def grows(angles: NDArray[np.float64]) -> NDArray[np.bool_]:
        s = np.tan(angles) ** 2
        g, slope = _radial(is_equidistant, numerator, denominator, s)
        return np.asarray((g + 2 * s * slope > 0) & (polyval(s, denominator) > 0))

    angles = np.linspace(0, FARTHEST_RAD, TABLE_SIZE)
    stops = np.flatnonzero(~grows(angles))
    limit = np.inf
    if len(stops):
        inside, outside = angles[stops[0] - 1], angles[stops[0]]
        for _ in range(4):
            between = np.linspace(inside, outside, TABLE_SIZE)
            first = np.flatnonzero(~grows(between))[0]
            inside, outside = between[first - 1], between[first]
        limit = float(np.tan(outside))
        angles = np.linspace(0, inside, TABLE_SIZE)
    radii = np.tan(angles)
    g, _ = _radial(is_equidistant, numerator, denominator, radii**2)
    return Lens(is_equidistant, numerator, denominator, p1, p2, limit, radii, radii * g)


def _determinant(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    return matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
