"""Rows of a frame's detections: whether they can be tracked, in which order, and which of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.sensing.detections import Detections


def check(detections: Detections) -> None:
    """Raises InvalidInput for what no filter can take: positions, covariances or scores that are none."""
    where = f"detections in {detections.frame} at {detections.stamp_us} us"
    remedy = "Have the detector leave such a detection out, or say honestly how uncertain it is."
    count = len(detections.position_m)
    shapes: dict[str, tuple[NDArray[Any], tuple[int, ...]]] = {
        "position_m": (detections.position_m, (count, 2)),
        "covariance_m2": (detections.covariance_m2, (count, 2, 2)),
        "score": (detections.score, (count,)),
        "seen_by": (detections.seen_by, (count,)),
        "extent_m": (detections.extent_m, (count, 2)),
        "hint": (detections.hint, (count,)),
    }
    for name, (array, shape) in shapes.items():
        if array.shape != shape:
            raise InvalidInput(f"{name} has the shape {array.shape} instead of {shape}", remedy, where)
    if not np.isfinite(detections.position_m).all():
        raise InvalidInput("a position is not a finite number", remedy, where)
    if not is_covariance(detections.covariance_m2):
        raise InvalidInput("a covariance is not a symmetric positive matrix of finite numbers", remedy, where)
    if not ((detections.score >= 0) & (detections.score <= 1)).all():
        raise InvalidInput("a score is not a probability from 0 to 1", remedy, where)


def is_covariance(matrices: NDArray[np.float64]) -> bool:
    """Whether all of (n, 2, 2) are symmetric, positive semidefinite and finite."""
    if not np.isfinite(matrices).all():
        return False
    xx, xy, yx, yy = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1]
    rounding = 1e-9 * (np.abs(xx) + np.abs(yy))
    is_symmetric = np.abs(xy - yx) <= rounding
    is_positive = (xx >= 0) & (yy >= 0) & (xx * yy - xy * xy >= -rounding * rounding)
    return bool((is_symmetric & is_positive).all())


def in_order(detections: Detections) -> Detections:
    """By place, so that what follows does not depend on the order in which a detector gave them."""
    keys: list[NDArray[Any]] = [
        detections.hint,
        detections.seen_by,
        detections.covariance_m2[:, 1, 1],
        detections.covariance_m2[:, 0, 0],
        detections.score,
        detections.position_m[:, 1],
        detections.position_m[:, 0],
    ]
    return chosen(detections, np.lexsort(keys))


def chosen(detections: Detections, which: NDArray[Any]) -> Detections:
    """The rows that a mask or indices name."""
    return replace(
        detections,
        position_m=detections.position_m[which],
        covariance_m2=detections.covariance_m2[which],
        score=detections.score[which],
        seen_by=detections.seen_by[which],
        extent_m=detections.extent_m[which],
        hint=detections.hint[which],
    )
