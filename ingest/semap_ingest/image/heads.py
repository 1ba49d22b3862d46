"""Decoders of networks that give the maps of their last layers as they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from semap_ingest.image.candidates import (
    Candidates,
    Choice,
    Outputs,
    best_classes,
    best_of_present,
    corners_around,
    corners_of_input,
)


def decode_fastestdet(outputs: Outputs, choice: Choice) -> Candidates:
    """(1, 5 + classes, h, w): objectness, offset x, y, size x, y, classes; both kinds of score from 0 to 1.

    Score = objectness^0.6 * class^0.4, centre = cell + tanh(offset), size = sigmoid(size) of the whole input
    (the reference implementation's test.py).
    """
    maps = outputs[0][0]
    height, width = maps.shape[1:]
    cells = maps.reshape(len(maps), -1).astype(np.float64)
    there = np.flatnonzero(cells[0] ** 0.6 >= choice.min_score)
    scores = cells[0, there] ** 0.6 * cells[5:, there] ** 0.4
    best = best_classes(scores, choice)
    rows = there[best.rows]
    raw = cells[:, rows]
    centre = np.stack([rows % width, rows // width]) + np.tanh(raw[1:3])
    box = np.concatenate([centre / [[width], [height]], expit(raw[3:5])]).T
    return best.boxed(corners_around(box) * corners_of_input(choice))


@dataclass(frozen=True)
class DarknetHead:
    """One [yolo] section of a darknet configuration.

    anchors_px  (width, height) of those in its mask [px of the input]
    scale_xy    scale_x_y
    """

    stride: int
    anchors_px: tuple[tuple[float, float], ...]
    scale_xy: float = 1.0


# yolov4-tiny.cfg and yolov3-tiny.cfg: the same anchors, another mask for the finer head, another scale.
YOLOV4_TINY = (
    DarknetHead(32, ((81, 82), (135, 169), (344, 319)), 1.05),
    DarknetHead(16, ((23, 27), (37, 58), (81, 82)), 1.05),
)
YOLOV3_TINY = (
    DarknetHead(32, ((81, 82), (135, 169), (344, 319))),
    DarknetHead(16, ((10, 14), (23, 27), (37, 58))),
)


@dataclass(frozen=True)
class DarknetDecoder:
    """Decodes raw darknet heads, in the order of `heads`: each (1, anchors * (5 + classes), h, w).

    Of each anchor t_x, t_y, t_w, t_h, objectness, classes; size = anchor * exp(t), scores by sigmoid,
    centre = cell + scale_xy * sigmoid(t) - (scale_xy - 1) / 2
    (Redmon and Farhadi 2018; scale_x_y by Bochkovskiy et al. 2020).
    """

    heads: tuple[DarknetHead, ...]

    def __call__(self, outputs: Outputs, choice: Choice) -> Candidates:
        found = [_decode_head(o, head, choice) for o, head in zip(outputs, self.heads, strict=True)]
        return Candidates(
            np.concatenate([f.corners_px for f in found]),
            np.concatenate([f.score for f in found]),
            np.concatenate([f.class_number for f in found]),
        )


def _decode_head(output: NDArray[Any], head: DarknetHead, choice: Choice) -> Candidates:
    anchors = len(head.anchors_px)
    height, width = output.shape[2:]
    raw = output.reshape(anchors, -1, height * width)
    # A threshold before the sigmoid saves computing it for places where there is nothing.
    anchor, cell = np.nonzero(raw[:, 4] >= logit(choice.min_score))
    rows = raw[anchor, :, cell].astype(np.float64)
    best = best_of_present(expit(rows[:, 4]), expit(rows[:, 5:]), choice)
    rows, anchor, cell = rows[best.rows], anchor[best.rows], cell[best.rows]
    within = head.scale_xy * expit(rows[:, :2]) - (head.scale_xy - 1) / 2
    centre = (np.column_stack([cell % width, cell // width]) + within) * head.stride
    size = np.array(head.anchors_px)[anchor] * np.exp(rows[:, 2:4])
    return best.boxed(corners_around(np.hstack([centre, size])))
