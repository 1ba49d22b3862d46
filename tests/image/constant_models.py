"""Small ONNX models that give the same outputs whatever they see, and the outputs of each layout for known boxes.

The encoders are the inverse of what each layout's own project does with its outputs, one box at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

SIDE = 320
CLASSES = 80
Arrays = dict[str, NDArray[np.generic]]
FLOAT = np.float32


@dataclass(frozen=True)
class Thing:
    """corners_px  x_min, y_min, x_max, y_max [px of the input]"""

    corners_px: tuple[float, float, float, float]
    number: int
    score: float

    @property
    def centre_size(self) -> tuple[float, float, float, float]:
        left, top, right, bottom = self.corners_px
        return (left + right) / 2, (top + bottom) / 2, right - left, bottom - top


def write_model(
    path: Path,
    outputs: Mapping[str, NDArray[np.generic]],
    *,
    input_shape: Sequence[int | str | None] = (1, 3, SIDE, SIDE),
    input_type: int = TensorProto.FLOAT,
    more_inputs: Sequence[onnx.ValueInfoProto] = (),
    nodes: Sequence[onnx.NodeProto] = (),
    more_outputs: Sequence[onnx.ValueInfoProto] = (),
    metadata: Mapping[str, str] | None = None,
    opset: int = 17,
    ir_version: int = 8,
) -> Path:
    """A model with an input `images` that it does not look at, unless `nodes` do."""
    constants = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(array, name))
        for name, array in outputs.items()
    ]
    values = [
        helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(array.dtype), array.shape)
        for name, array in outputs.items()
    ]
    image = helper.make_tensor_value_info("images", input_type, input_shape)
    graph = helper.make_graph(
        [*constants, *nodes], "constant", [image, *more_inputs], [*values, *more_outputs]
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=ir_version)
    helper.set_model_props(model, dict(metadata or {}))
    onnx.save(model, path)
    return path


def objectness_rows(things: Sequence[Thing], count: int = 3 * 2100, classes: int = CLASSES) -> Arrays:
    rows = np.zeros((1, count, 5 + classes), dtype=FLOAT)
    for i, thing in enumerate(things):
        row = rows[0, (i * 997) % count]
        row[:4] = thing.centre_size
        row[4] = math.sqrt(thing.score)
        row[5 + thing.number] = math.sqrt(thing.score)
    return {"output": rows}


def class_columns(
    things: Sequence[Thing], count: int = 2100, classes: int = CLASSES, more: int = 0
) -> Arrays:
    columns = np.zeros((1, 4 + classes + more, count), dtype=FLOAT)
    for i, thing in enumerate(things):
        column = columns[0, :, (i * 997) % count]
        column[:4] = thing.centre_size
        column[4 + thing.number] = thing.score
        column[4 + classes :] = 0.99
    return {"output0": columns}


def class_rows(things: Sequence[Thing]) -> Arrays:
    return {"output0": np.ascontiguousarray(class_columns(things)["output0"].transpose(0, 2, 1))}


def cell_rows(things: Sequence[Thing]) -> Arrays:
    """YOLOX: thing i sits in the cell of its centre, of the grid of stride 8, 16 or 32 in turn."""
    rows = np.zeros((1, 2100, 5 + CLASSES), dtype=FLOAT)
    starts = {8: 0, 16: 40 * 40, 32: 40 * 40 + 20 * 20}
    for i, thing in enumerate(things):
        stride = (8, 16, 32)[i % 3]
        x, y, width, height = (value / stride for value in thing.centre_size)
        row = rows[0, starts[stride] + int(y) * (SIDE // stride) + int(x)]
        row[:4] = x - int(x), y - int(y), math.log(width), math.log(height)
        row[4] = row[5 + thing.number] = math.sqrt(thing.score)
    return {"output": rows}


def distances(offset: float, strides: Sequence[int]) -> Callable[..., Arrays]:
    """NanoDet: thing i is told by the cell before its centre, of each stride in turn that reaches its sides.

    All of the weight of a side lies on the two whole distances around it, as a softmax can say it.
    """

    def encode(things: Sequence[Thing]) -> Arrays:
        cells = [math.ceil(SIDE / stride) for stride in strides]
        starts = np.cumsum([0, *(count * count for count in cells)])
        rows = np.zeros((1, starts[-1], CLASSES + 32), dtype=FLOAT)
        for thing in things:
            x, y, width, height = thing.centre_size
            level = next(n for n, s in enumerate(strides) if max(width, height) / 2 < 6 * s)
            stride = strides[level]
            column, line = int(x / stride), int(y / stride)
            row = rows[0, starts[level] + line * cells[level] + column]
            row[thing.number] = thing.score
            left, top, right, bottom = thing.corners_px
            at_x, at_y = (column + offset) * stride, (line + offset) * stride
            for side, distance_px in enumerate((at_x - left, at_y - top, right - at_x, bottom - at_y)):
                whole, part = divmod(distance_px / stride, 1)
                weights = np.full(8, 1e-9)
                weights[int(whole)], weights[int(whole) + 1] = 1 - part + 1e-9, part + 1e-9
                row[CLASSES + 8 * side : CLASSES + 8 * side + 8] = np.log(weights)
        return {"output": rows}

    return encode


def boxes_and_confidences(things: Sequence[Thing]) -> Arrays:
    boxes, confidences = np.zeros((1, 1500, 1, 4), dtype=FLOAT), np.zeros((1, 1500, CLASSES), dtype=FLOAT)
    for i, thing in enumerate(things):
        boxes[0, i * 97, 0] = np.array(thing.corners_px) / SIDE
        confidences[0, i * 97, thing.number] = thing.score
    return {"boxes": boxes, "confs": confidences}


def darknet_maps(scale: float, masks: Mapping[int, Sequence[tuple[int, int]]]) -> Callable[..., Arrays]:
    """scale: scale_x_y; masks: stride to the anchors of its head [px]; thing i has head and anchor in turn."""

    def encode(things: Sequence[Thing]) -> Arrays:
        maps = {
            stride: np.full((1, 3, 5 + CLASSES, SIDE // stride, SIDE // stride), -20.0, dtype=FLOAT)
            for stride in masks
        }
        for i, thing in enumerate(things):
            stride, anchor = list(masks)[i % 2], i % 3
            x, y, width, height = thing.centre_size
            column, line = int(x / stride), int(y / stride)
            cell = maps[stride][0, anchor, :, line, column]
            across = [value / stride - int(value / stride) for value in (x, y)]
            cell[:2] = [_logit((part + (scale - 1) / 2) / scale) for part in across]
            cell[2:4] = [
                math.log(size / own) for size, own in zip((width, height), masks[stride][anchor], strict=True)
            ]
            cell[4] = cell[5 + thing.number] = _logit(math.sqrt(thing.score))
        return {f"map{s}": m.reshape(1, -1, *m.shape[3:]) for s, m in maps.items()}

    return encode


def fastestdet_map(things: Sequence[Thing]) -> Arrays:
    maps = np.zeros((1, 5 + CLASSES, SIDE // 16, SIDE // 16), dtype=FLOAT)
    for thing in things:
        x, y, width, height = thing.centre_size
        cell = maps[0, :, int(y / 16), int(x / 16)]
        cell[0] = cell[5 + thing.number] = thing.score
        cell[1:3] = math.atanh(x / 16 - int(x / 16)), math.atanh(y / 16 - int(y / 16))
        cell[3:5] = _logit(width / SIDE), _logit(height / SIDE)
    return {"758": maps}


def queries(things: Sequence[Thing]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Boxes (1, 300, 4), scores (1, 300, 80)."""
    boxes, scores = np.zeros((1, 300, 4), dtype=FLOAT), np.zeros((1, 300, CLASSES), dtype=FLOAT)
    for i, thing in enumerate(things):
        boxes[0, i * 31] = np.array(thing.centre_size) / SIDE
        scores[0, i * 31, thing.number] = thing.score
    return boxes, scores


def query_scores(things: Sequence[Thing]) -> Arrays:
    boxes, scores = queries(things)
    return {"scores": scores, "pred_boxes": boxes}


def query_logits(things: Sequence[Thing]) -> Arrays:
    boxes, scores = queries(things)
    clipped = np.clip(scores, 1e-9, 1 - 1e-6)
    return {"logits": np.log(clipped / (1 - clipped)), "pred_boxes": boxes}


def query_ids(things: Sequence[Thing]) -> Arrays:
    """RF-DETR: boxes `dets`, and logits `labels` of COCO's ids, of which 1 is a person and 18 a dog."""
    boxes, scores = queries(things)
    ids = np.full((1, 300, 91), 1e-9, dtype=FLOAT)
    for number, coco in ((0, 1), (16, 18)):
        ids[..., coco] = np.clip(scores[..., number], 1e-9, 1 - 1e-6)
    return {"dets": boxes, "labels": np.log(ids / (1 - ids))}


def tensorflow_lists(things: Sequence[Thing]) -> Arrays:
    """y before x, from 0 to 1, classes as COCO's ids and as floats; the raw lists beside."""
    boxes, scores, classes = listed(things)
    ids = np.select([classes == 0, classes == 16], [FLOAT(1), FLOAT(18)], FLOAT(1))
    return {
        "detection_anchor_indices": np.zeros((1, 100), FLOAT),
        "detection_boxes": np.ascontiguousarray(boxes[..., [1, 0, 3, 2]] / SIDE),
        "detection_classes": ids,
        "detection_scores": np.maximum(scores, 0),
        "num_detections": np.array([len(things)], FLOAT),
        "raw_detection_boxes": np.zeros((1, 1917, 4), FLOAT),
        "raw_detection_scores": np.zeros((1, 1917, 91), FLOAT),
    }


def corners_score_and_labels(things: Sequence[Thing]) -> Arrays:
    boxes, scores, classes = listed(things)
    return {"dets": np.concatenate([boxes, scores[..., None]], axis=2), "labels": classes.astype(np.int64)}


def joined_queries(things: Sequence[Thing]) -> Arrays:
    return {"output0": np.concatenate(queries(things), axis=2)}


def listed(things: Sequence[Thing], count: int = 100) -> tuple[NDArray[np.float32], ...]:
    """Corners (1, count, 4), scores (1, count), classes (1, count), best first; the rest is -1."""
    rows = np.full((count, 6), -1.0, dtype=FLOAT)
    for i, thing in enumerate(sorted(things, key=lambda each: -each.score)):
        rows[i] = (*thing.corners_px, thing.score, thing.number)
    return rows[None, :, :4], rows[None, :, 4], rows[None, :, 5]


def labels_boxes_scores(things: Sequence[Thing]) -> Arrays:
    boxes, scores, labels = listed(things, 300)
    return {"labels": labels.astype(np.int64), "boxes": boxes, "scores": scores}


def labels_boxes_scores_flat(things: Sequence[Thing]) -> Arrays:
    """As torchvision's: no batch, and no more rows than there are things."""
    return {name: array[0, : len(things)] for name, array in labels_boxes_scores(things).items()}


def counted(things: Sequence[Thing]) -> Arrays:
    boxes, scores, classes = listed(things)
    # What is beyond the count must not be looked at.
    scores, classes = np.where(scores < 0, FLOAT(0.9), scores), np.where(classes < 0, FLOAT(0), classes)
    return {
        "num_dets": np.array([[len(things)]], dtype=np.int32),
        "det_boxes": boxes,
        "det_scores": scores,
        "det_classes": classes.astype(np.int32),
    }


def score_class_rows(things: Sequence[Thing]) -> Arrays:
    boxes, scores, classes = listed(things, 300)
    return {"output0": np.concatenate([boxes, scores[..., None], classes[..., None]], axis=2)}


def batch_class_score_rows(things: Sequence[Thing]) -> Arrays:
    boxes, scores, classes = (array[0, : len(things)] for array in listed(things))
    batch = np.zeros((len(things), 1), dtype=FLOAT)
    return {"output": np.concatenate([batch, boxes, classes[:, None], scores[:, None]], axis=1)}


def _logit(probability: float) -> float:
    return math.log(probability / (1 - probability))
