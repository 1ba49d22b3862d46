"""Decoders of networks that give one list with a row (or a column) for each place of their grids.

Every decoder takes the outputs in the order that its layout's arrangement says, all of batch 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from semap_ingest.image.candidates import (
    Candidates,
    Choice,
    Numbers,
    Outputs,
    best_classes,
    best_of_present,
    corners_around,
    corners_of_input,
)

# Strides that detectors have had: P3 to P5, with P6, with P2; of tiny ones two or one.
PYRAMIDS = ((8, 16, 32), (8, 16, 32, 64), (4, 8, 16, 32), (16, 32), (8, 16), (8,), (16,), (32,))

REACH = 8
"""The sides of a box may be up to so many strides less one away: NanoDet's reg_max is 7."""
DISTANCE_COLUMNS = 4 * REACH


def places(strides: Sequence[int], input_px: tuple[int, int]) -> int:
    """How many cells the grids of these strides have in all."""
    return sum(width * height for width, height in _grids(strides, input_px))


def decode_objectness_rows(outputs: Outputs, choice: Choice) -> Candidates:
    """(1, n, 5 + classes): centre x, y, width, height [px of the input], objectness, classes.

    YOLOv5, v6, v7, and YOLOX exported with decoding.
    """
    rows = outputs[0][0]
    best = best_of_present(rows[:, 4], rows[:, 5:], choice)
    return best.boxed(corners_around(rows[best.rows, :4]))


def decode_class_columns(outputs: Outputs, choice: Choice) -> Candidates:
    """(1, 4 + classes + more, n): centre x, y, width, height [px of the input], classes. YOLOv8, v9, v11.

    What follows the classes is coefficients of masks or key points.
    """
    columns = outputs[0][0]
    best = best_classes(columns[4 : 4 + (choice.class_count or 0)], choice)
    return best.boxed(corners_around(columns[:4, best.rows].T))


def decode_class_rows(outputs: Outputs, choice: Choice) -> Candidates:
    """The same transposed: (1, n, 4 + classes)."""
    return decode_class_columns([outputs[0].transpose(0, 2, 1)], choice)


def decode_cell_rows(outputs: Outputs, choice: Choice) -> Candidates:
    """(1, n, 5 + classes) in units of cells: YOLOX as it is exported by default.

    Centre = (offset + cell) * stride, size = exp(size) * stride (Ge et al. 2021; demo_postprocess there).
    """
    rows = outputs[0][0]
    best = best_of_present(rows[:, 4], rows[:, 5:], choice)
    pyramid = pyramid_of(len(rows), choice.input_px)
    cell, stride = _cells(best.rows, pyramid, choice.input_px)
    raw = rows[best.rows, :4].astype(np.float64)
    size = np.exp(raw[:, 2:]) * stride[:, None]
    centre = (raw[:, :2] + cell) * stride[:, None]
    return best.boxed(corners_around(np.hstack([centre, size])))


def decode_distances(strides: Sequence[int], offset: float) -> Callable[[Outputs, Choice], Candidates]:
    """A decoder of (1, n, classes + 4 * 8): NanoDet, whose cells start at `offset` cells.

    The distance to a side is the mean of 0 to 7 strides under the softmax of eight numbers, for left, top,
    right and bottom (generalised focal loss, Li et al. 2020).
    """

    def decode(outputs: Outputs, choice: Choice) -> Candidates:
        rows = outputs[0][0]
        class_count = rows.shape[1] - DISTANCE_COLUMNS
        best = best_classes(rows[:, :class_count].T, choice)
        cell, stride = _cells(best.rows, strides, choice.input_px)
        raw = rows[best.rows, class_count:].astype(np.float64).reshape(-1, 4, REACH)
        distance = (softmax(raw, axis=2) @ np.arange(REACH)) * stride[:, None]
        centre = (cell + offset) * stride[:, None]
        return best.boxed(np.hstack([centre - distance[:, :2], centre + distance[:, 2:]]))

    return decode


def decode_boxes_and_confidences(outputs: Outputs, choice: Choice) -> Candidates:
    """Boxes (1, n, 1, 4) x_min, y_min, x_max, y_max from 0 to 1, and confidences (1, n, classes).

    YOLOv4 and yolov4-tiny exported from PyTorch.
    """
    best = best_classes(outputs[1][0].T, choice)
    boxes = outputs[0].reshape(-1, 4)[best.rows]
    return best.boxed(boxes * corners_of_input(choice))


def pyramid_of(count: int, input_px: tuple[int, int]) -> tuple[int, ...]:
    """The strides whose grids have so many cells in all; empty where none have."""
    return next((strides for strides in PYRAMIDS if places(strides, input_px) == count), ())


def _grids(strides: Sequence[int], input_px: tuple[int, int]) -> Iterator[tuple[int, int]]:
    for stride in strides:
        yield -(-input_px[0] // stride), -(-input_px[1] // stride)


def _cells(
    rows: NDArray[np.int64], strides: Sequence[int], input_px: tuple[int, int]
) -> tuple[Numbers, Numbers]:
    """Column and line (n, 2) of the cells, and their strides (n,); grids follow one another, line by line."""
    grids = list(_grids(strides, input_px))
    starts = np.cumsum([0, *(width * height for width, height in grids)])
    level = np.searchsorted(starts, rows, side="right") - 1
    within = rows - starts[level]
    width = np.array([width for width, _ in grids])[level]
    cell = np.column_stack([within % width, within // width]).astype(np.float64)
    return cell, np.array(strides, dtype=np.float64)[level]
