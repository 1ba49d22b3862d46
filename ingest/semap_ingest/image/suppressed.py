"""Decoders of models that do their own suppression; corners in px of the input unless said otherwise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semap_ingest.image.candidates import (
    Candidates,
    Choice,
    Numbers,
    Outputs,
    corners_around,
    corners_of_input,
)


def decode_boxes_scores_classes(outputs: Outputs, choice: Choice) -> Candidates:
    """Corners (1, n, 4), scores (1, n), classes (1, n), with or without the batch's dimension."""
    return _wanted(outputs[0].reshape(-1, 4), outputs[1].ravel(), outputs[2].ravel(), choice)


def decode_counted(outputs: Outputs, choice: Choice) -> Candidates:
    """How many (1, 1), corners (1, n, 4), scores (1, n), classes (1, n): only so many count. EfficientNMS."""
    count = max(0, int(outputs[0].ravel()[0]))
    rows = (
        outputs[1].reshape(-1, 4)[:count],
        outputs[2].ravel()[:count],
        outputs[3].ravel()[:count],
    )
    return _wanted(*rows, choice)


def decode_score_class_rows(outputs: Outputs, choice: Choice) -> Candidates:
    """(1, n, 6): corners, score, class. YOLOv10, and YOLO exports with suppression of their own."""
    rows = outputs[0][0]
    return _wanted(rows[:, :4], rows[:, 4], rows[:, 5], choice)


def decode_corners_score_labels(outputs: Outputs, choice: Choice) -> Candidates:
    """(1, n, 5): corners, score; and classes (1, n). MMDetection, exported by itself or by MMDeploy."""
    rows = outputs[0][0]
    return _wanted(rows[:, :4], rows[:, 4], outputs[1].ravel(), choice)


def decode_tensorflow(outputs: Outputs, choice: Choice) -> Candidates:
    """Corners (1, n, 4) y_min, x_min, y_max, x_max from 0 to 1, scores (1, n), classes (1, n) from 1."""
    corners = _swapped(outputs[0].reshape(-1, 4)) * corners_of_input(choice)
    return _wanted(corners, outputs[1].ravel(), outputs[2].ravel() - 1, choice)


def decode_batch_class_score_rows(outputs: Outputs, choice: Choice) -> Candidates:
    """(n, 7): number in the batch, corners, class, score. YOLOv7 exported end to end."""
    rows = outputs[0]
    return _wanted(rows[:, 1:5], rows[:, 6], rows[:, 5], choice)


def _swapped(boxes: Numbers) -> Numbers:
    return boxes[:, [1, 0, 3, 2]]


def _in_order(boxes: Numbers) -> Numbers:
    """NonMaxSuppression takes any two opposite corners."""
    return np.hstack([np.minimum(boxes[:, :2], boxes[:, 2:]), np.maximum(boxes[:, :2], boxes[:, 2:])])


CORNERS: dict[str, Callable[[Numbers], Numbers]] = {
    "xyxy": _in_order,
    "yxyx": lambda boxes: _in_order(_swapped(boxes)),
    "cxcywh": corners_around,
}


def decode_selected(order: str) -> Callable[[Outputs, Choice], Candidates]:
    """A decoder of ONNX's NonMaxSuppression: boxes (1, n, 4), scores (1, classes, n), selected (k, 3).

    A row of `selected` is number in the batch, class, box; `order` is that of the numbers in a box.
    """

    def decode(outputs: Outputs, choice: Choice) -> Candidates:
        boxes, scores, selected = outputs
        number, box = selected[:, 1].astype(np.int64), selected[:, 2].astype(np.int64)
        return _wanted(CORNERS[order](boxes[0, box]), scores[0, number, box], number, choice)

    return decode


def _wanted(corners_px: Numbers, score: Numbers, class_number: NDArray[Any], choice: Choice) -> Candidates:
    is_number = np.isfinite(class_number) & (class_number >= 0)
    number = np.where(is_number, class_number, 0).astype(np.int64)
    kept = choice.allows(number, score) & is_number
    return Candidates(
        corners_px[kept].astype(np.float64),
        score[kept].astype(np.float64),
        number[kept],
    )
