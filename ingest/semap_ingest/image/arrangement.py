"""Whether a model's outputs can be of a layout, and how likely they are.

Each layout has two questions, asked of the evidence: `arrange` says in which order its decoder takes the
outputs, or None where their shapes, types and names cannot be of that layout; `likely` weighs what else is
known: how many cells the grids of an input of this size have, words in names, metadata that only some
exporters write, and whether the centres of boxes are counted in px or in cells.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from semap_ingest.image.dense import DISTANCE_COLUMNS, PYRAMIDS, places, pyramid_of
from semap_ingest.image.heads import DarknetHead
from semap_ingest.image.tensor import Tensor

MOST_QUERIES = 1000
COCO_CLASSES = 80
COCO_IDS = 91
"""The numbers of COCO's categories reach to 90, with gaps, and 0 is none."""
MOST_CELLS = 8.0
"""So far from its own cell, in cells, may the centre of a box be at most."""


@dataclass(frozen=True)
class Evidence:
    """What is known of a model.

    outputs          with the shapes that they had in a first run
    class_count      of the names that were given or are in the metadata; None: there are none
    has_sizes_input  it asks for the image's size, to scale boxes by itself
    arrays           the outputs of that run; empty where there was none
    """

    outputs: tuple[Tensor, ...]
    input_px: tuple[int, int]
    class_count: int | None = None
    metadata: Mapping[str, str] = field(default_factory=dict)
    has_sizes_input: bool = False
    arrays: Sequence[NDArray[Any]] = ()

    @cached_property
    def centre_unit(self) -> Literal["px", "cells"] | None:
        """In what the first two numbers of the rows of the one list are counted; None: they do not tell.

        Counted in px of the input, they reach all over it; counted from their own cell, they stay near 0.
        """
        if self.only_list is None or not self.arrays:
            return None
        centres = np.abs(self.arrays[0][0][:, :2].astype(np.float64))
        told = centres[np.isfinite(centres).all(axis=1) & (centres > 0).any(axis=1)]
        if len(told) < len(centres) / 2:
            return None
        reach = np.percentile(told, 90)
        return "cells" if reach <= MOST_CELLS else "px"

    @property
    def only_list(self) -> tuple[int, int] | None:
        """The last two sizes of the one output of shape (1, a, b)."""
        sizes = [output.sizes for output in self.outputs]
        if not (sizes and len(sizes[0]) == 3 and sizes[0][0] == 1):
            return None
        # A segmentation model adds prototypes of masks, which nobody here wants.
        if len(sizes) > 1 and not (self.metadata.get("task") == "segment" and len(sizes) == 2):
            return None
        return sizes[0][1], sizes[0][2]

    @property
    def is_rtdetr(self) -> bool:
        return "rtdetr" in self.metadata.get("description", "").lower().replace("-", "")

    def anchors_per_cell(self, count: int) -> int:
        """1 or 3 where `count` is so many for each cell of grids that fit the input; else 0."""
        if pyramid_of(count, self.input_px):
            return 1
        several = [strides for strides in PYRAMIDS if len(strides) > 1]
        return 3 if any(3 * places(strides, self.input_px) == count for strides in several) else 0

    def may_be_queries(self, count: int) -> bool:
        return count <= MOST_QUERIES and not self.anchors_per_cell(count)

    def allows(self, class_count: int) -> bool:
        return class_count >= 1 and self.class_count in (None, class_count)


@dataclass(frozen=True)
class Arrangement:
    """order: which outputs the decoder takes; class_count: None where shapes do not tell"""

    order: tuple[int, ...]
    class_count: int | None


Arrange = Callable[[Evidence], Arrangement | None]
Likely = Callable[[Evidence], bool]


def always(_: Evidence) -> bool:
    return True


def rows_with(before_classes: int) -> Arrange:
    """(1, n, before_classes + classes)"""

    def arrange(evidence: Evidence) -> Arrangement | None:
        sizes = evidence.only_list
        if sizes is None or not evidence.allows(sizes[1] - before_classes):
            return None
        return Arrangement((0,), sizes[1] - before_classes)

    return arrange


def cell_rows_with(before_classes: int) -> Arrange:
    """The same, with a row for each cell of grids that fit the input."""

    def arrange(evidence: Evidence) -> Arrangement | None:
        sizes = evidence.only_list
        if sizes is None or not pyramid_of(sizes[0], evidence.input_px):
            return None
        return rows_with(before_classes)(evidence)

    return arrange


def distance_rows(strides: Sequence[int]) -> Arrange:
    """(1, n, classes + 32): classes, then how far each side is, with a row for each cell of these strides."""

    def arrange(evidence: Evidence) -> Arrangement | None:
        sizes = evidence.only_list
        if sizes is None or places(strides, evidence.input_px) != sizes[0]:
            return None
        class_count = sizes[1] - DISTANCE_COLUMNS
        return Arrangement((0,), class_count) if evidence.allows(class_count) else None

    return arrange


def class_columns(evidence: Evidence) -> Arrangement | None:
    """(1, 4 + classes, n), or more than that where metadata say that masks or key points follow."""
    sizes = evidence.only_list
    if sizes is None:
        return None
    more_follow = evidence.metadata.get("task") in ("segment", "pose")
    if more_follow and evidence.class_count and sizes[0] > 4 + evidence.class_count:
        return Arrangement((0,), evidence.class_count)
    return Arrangement((0,), sizes[0] - 4) if evidence.allows(sizes[0] - 4) else None


def row_of(columns: int) -> Arrange:
    """(1, n, columns)"""

    def arrange(evidence: Evidence) -> Arrangement | None:
        sizes = evidence.only_list
        return Arrangement((0,), None) if sizes and sizes[1] == columns else None

    return arrange


def flat_rows_of(columns: int) -> Arrange:
    """(n, columns)"""

    def arrange(evidence: Evidence) -> Arrangement | None:
        sizes = [output.sizes for output in evidence.outputs]
        fits = len(sizes) == 1 and len(sizes[0]) == 2 and sizes[0][1] == columns
        return Arrangement((0,), None) if fits else None

    return arrange


def one_map(evidence: Evidence) -> Arrangement | None:
    """(1, 5 + classes, h, w), with more than one cell"""
    sizes = [output.sizes for output in evidence.outputs]
    if not (len(sizes) == 1 and len(sizes[0]) == 4 and sizes[0][0] == 1 and sizes[0][2] * sizes[0][3] > 1):
        return None
    class_count = sizes[0][1] - 5
    return Arrangement((0,), class_count) if evidence.allows(class_count) else None


def darknet_maps(heads: Sequence[DarknetHead]) -> Arrange:
    """(1, anchors * (5 + classes), h, w) for each head, in any order; the strides tell which is which."""

    def arrange(evidence: Evidence) -> Arrangement | None:
        sizes = [output.sizes for output in evidence.outputs]
        with_grid = {s[2:]: i for i, s in enumerate(sizes) if len(s) == 4 and s[0] == 1}
        width, height = evidence.input_px
        grids = [(-(-height // head.stride), -(-width // head.stride)) for head in heads]
        order = tuple(with_grid[grid] for grid in grids if grid in with_grid)
        if not len(sizes) == len(heads) == len(order):
            return None
        channels = {sizes[i][1] / len(head.anchors_px) for i, head in zip(order, heads, strict=True)}
        class_count = channels.pop() - 5
        if channels or not class_count.is_integer() or not evidence.allows(int(class_count)):
            return None
        return Arrangement(order, int(class_count))

    return arrange


def boxes_and_classes(evidence: Evidence) -> Arrangement | None:
    """Boxes (1, n, 4) or (1, n, 1, 4), and (1, n, classes), in any order."""
    if len(evidence.outputs) != 2:
        return None
    for boxes, classes in ((0, 1), (1, 0)):
        box, score = evidence.outputs[boxes].sizes, evidence.outputs[classes].sizes
        is_named_so = "box" in evidence.outputs[boxes].name or "box" not in evidence.outputs[classes].name
        if (
            is_named_so
            and len(score) == 3
            and box in ((1, score[1], 4), (1, score[1], 1, 4))
            and evidence.allows(score[2])
        ):
            return Arrangement((boxes, classes), score[2])
    return None


def boxes_and_ids(evidence: Evidence) -> Arrangement | None:
    """Boxes (1, n, 4) and (1, n, classes), with a place more than there are names, or for each COCO id.

    A segmentation model adds masks, which nobody here wants.
    """
    outputs = [i for i, output in enumerate(evidence.outputs) if "mask" not in output.name.lower()]
    for boxes, classes in (outputs, outputs[::-1]) if len(outputs) == 2 else ():
        box, score = evidence.outputs[boxes].sizes, evidence.outputs[classes].sizes
        if len(score) != 3 or box != (1, score[1], 4) or _says(evidence, classes, "det", "box"):
            continue
        if score[2] == COCO_IDS or evidence.class_count in (score[2], score[2] - 1):
            return Arrangement((boxes, classes), score[2])
    return None


def corners_score_and_labels(evidence: Evidence) -> Arrangement | None:
    """(1, n, 5) and whole numbers (1, n), perhaps with masks."""
    outputs = [i for i, output in enumerate(evidence.outputs) if "mask" not in output.name.lower()]
    for rows, labels in (outputs, outputs[::-1]) if len(outputs) == 2 else ():
        row, label = evidence.outputs[rows], evidence.outputs[labels]
        if label.type.startswith("int") and len(label.sizes) == 2 and row.sizes == (1, label.sizes[1], 5):
            return Arrangement((rows, labels), evidence.class_count)
    return None


def tensorflow_lists(evidence: Evidence) -> Arrangement | None:
    """detection_boxes (1, n, 4), detection_scores and detection_classes (1, n), beside anything else."""
    roles = ("detection_boxes", "detection_scores", "detection_classes")
    by_name = {output.name.partition(":")[0]: i for i, output in enumerate(evidence.outputs)}
    if not by_name.keys() >= set(roles):
        return None
    order = tuple(by_name[role] for role in roles)
    if not _one_for_each_box([evidence.outputs[i] for i in order]):
        return None
    return Arrangement(order, evidence.class_count or COCO_IDS - 1)


def _says(evidence: Evidence, output: int, *words: str) -> bool:
    return any(word in evidence.outputs[output].name.lower() for word in words)


def named(*words: Sequence[str], asks_for_sizes: bool = False) -> Arrange:
    """One output for each of `words`, with one of them in its name, of as many things as there are boxes.

    TensorFlow's are called so too (detection_boxes), and hold something else.
    """

    def arrange(evidence: Evidence) -> Arrangement | None:
        names = [output.name.lower() for output in evidence.outputs]
        hits = [[i for i, name in enumerate(names) if any(word in name for word in role)] for role in words]
        order = tuple(hit[0] for hit in hits if len(hit) == 1)
        if len(names) != len(words) or len(set(order)) != len(words) or "detection_" in " ".join(names):
            return None
        is_one_each = _one_for_each_box([evidence.outputs[i] for i in order[-3:]])
        is_counted = len(order) == 3 or prod(evidence.outputs[order[0]].sizes) == 1
        fits = is_one_each and is_counted and evidence.has_sizes_input == asks_for_sizes
        return Arrangement(order, None) if fits else None

    return arrange


def _one_for_each_box(outputs: Sequence[Tensor]) -> bool:
    """Whether these are boxes (..., n, 4), and n scores and n classes."""
    boxes, scores, classes = (output.sizes for output in outputs)
    return boxes[-1:] == (4,) and prod(boxes) == 4 * prod(scores) == 4 * prod(classes)


def boxes_scores_selected(evidence: Evidence) -> Arrangement | None:
    """(1, n, 4), (1, classes, n), and whole numbers (k, 3)."""
    sizes = [output.sizes for output in evidence.outputs]
    selected = [
        i
        for i, o in enumerate(evidence.outputs)
        if len(o.sizes) == 2 and o.sizes[1] == 3 and o.type.startswith("int")
    ]
    lists = [i for i, s in enumerate(sizes) if len(s) == 3 and s[0] == 1]
    if len(sizes) != 3 or len(selected) != 1 or len(lists) != 2:
        return None
    for boxes, scores in (lists, lists[::-1]):
        if sizes[boxes][2] == 4 and sizes[scores][2] == sizes[boxes][1] and evidence.allows(sizes[scores][1]):
            return Arrangement((boxes, scores, selected[0]), sizes[scores][1])
    return None


def likely_rows(before_classes: int, *anchors: int, or_long: bool = False) -> Likely:
    """A list of so many `anchors` for each cell; `or_long`: or one of no grid that is too long for queries.

    84, 85 and 112 columns are those of COCO, where no class names are known, or one too many or too few.
    """

    def likely(evidence: Evidence) -> bool:
        count, columns = evidence.only_list or (0, 0)
        may_be_coco = evidence.class_count in (None, COCO_CLASSES - 1, COCO_CLASSES + 1)
        is_coco = may_be_coco and columns - COCO_CLASSES in (4, 5, DISTANCE_COLUMNS)
        if evidence.centre_unit == "cells":
            return False
        if evidence.is_rtdetr or (is_coco and columns != COCO_CLASSES + before_classes):
            return False
        per_cell = evidence.anchors_per_cell(count)
        return per_cell in anchors or (or_long and per_cell == 0 and count > MOST_QUERIES)

    return likely


def likely_cells(evidence: Evidence) -> bool:
    """Whatever the metadata say: people write the names of classes into any model."""
    if evidence.centre_unit is not None:
        return evidence.centre_unit == "cells"
    return likely_rows(5, 1)(evidence)


def likely_distances(evidence: Evidence) -> bool:
    """COCO's classes, those that are named, or just one; and the classes come first, from 0 to 1."""
    _, columns = evidence.only_list or (0, 0)
    is_usual = columns - DISTANCE_COLUMNS in (1, COCO_CLASSES)
    return (evidence.class_count is not None or is_usual) and evidence.centre_unit != "px"


def never(_: Evidence) -> bool:
    """Only where it is named."""
    return False


def likely_columns(evidence: Evidence) -> bool:
    columns, count = evidence.only_list or (0, 0)
    return columns < count and not evidence.is_rtdetr


def likely_joined_queries(evidence: Evidence) -> bool:
    """Six columns are taken for corners, score and class unless metadata say otherwise."""
    count, columns = evidence.only_list or (0, 0)
    if evidence.is_rtdetr:
        return True
    is_coco_with_objectness = evidence.class_count is None and columns == COCO_CLASSES + 5
    return columns < count and columns != 6 and not is_coco_with_objectness and evidence.may_be_queries(count)


def likely_suppressed_rows(evidence: Evidence) -> bool:
    """With too few rows for a grid, or as the metadata say."""
    count, columns = evidence.only_list or (0, 0)
    if evidence.metadata.get("end2end", "").lower() == "true":
        return True
    if evidence.class_count not in (None, columns - 4, columns - 5):
        return count <= MOST_QUERIES
    return evidence.may_be_queries(count) and not evidence.is_rtdetr


def likely_yolov4(evidence: Evidence) -> bool:
    sizes = [output.sizes for output in evidence.outputs]
    return any(len(s) == 4 or evidence.anchors_per_cell(s[1]) == 3 for s in sizes)


def likely_queries(words: Sequence[str], others: Sequence[str]) -> Likely:
    """Few boxes, and an output whose name holds one of `words`, or none of `others` either."""

    def likely(evidence: Evidence) -> bool:
        names = " ".join(output.name.lower() for output in evidence.outputs)
        says_so = any(word in names for word in words)
        says_otherwise = any(word in names for word in others)
        count = evidence.outputs[0].sizes[1]
        short = count <= MOST_QUERIES and evidence.anchors_per_cell(count) != 3
        flat = all(len(output.sizes) == 3 for output in evidence.outputs)
        return short and flat and (says_so or not says_otherwise) and not likely_ids(evidence)

    return likely


def likely_ids(evidence: Evidence) -> bool:
    """Its outputs are called as RF-DETR's, or it numbers classes as COCO's categories."""
    names = {output.name for output in evidence.outputs}
    return {"dets", "labels"} <= names or any(output.sizes[-1:] == (COCO_IDS,) for output in evidence.outputs)


def likely_stride_16(evidence: Evidence) -> bool:
    height, width = evidence.outputs[0].sizes[2:]
    return (width, height) == tuple(-(-side // 16) for side in evidence.input_px)
