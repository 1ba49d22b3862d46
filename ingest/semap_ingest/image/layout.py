"""The layouts that outputs of detectors have: how each is recognised, what goes in, how it is decoded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from semap_ingest.image import arrangement as shape
from semap_ingest.image import dense, heads, queries, suppressed
from semap_ingest.image.arrangement import Arrange, Likely, always
from semap_ingest.image.candidates import Candidates, Choice, Outputs
from semap_ingest.image.heads import DarknetDecoder, DarknetHead
from semap_ingest.image.input_form import IMAGENET_MEAN, IMAGENET_STD, InputForm

Decode = Callable[[Outputs, Choice], Candidates]

CENTRED = InputForm()
STRETCHED = InputForm(fit="stretch")
STRETCHED_BGR = InputForm(fit="stretch", colours="bgr")
MEGVII = InputForm(fit="corner", colours="bgr", full_scale=1.0)
IMAGENET = InputForm(fit="stretch", mean=IMAGENET_MEAN, std=IMAGENET_STD)
IMAGENET_BGR = replace(IMAGENET, colours="bgr")
IMAGENET_CORNER = replace(IMAGENET, fit="corner")
RAW = InputForm(fit="stretch", full_scale=1.0)

LOGITS = ("logit",)
SCORES = ("score", "conf", "prob")


@dataclass(frozen=True)
class Layout:
    """One way in which detectors say what they found.

    form         what its networks were trained on
    overlapping  its boxes still need suppression
    """

    name: str
    form: InputForm
    arrange: Arrange
    likely: Likely
    decode: Decode
    overlapping: bool = True


def darknet_layout(name: str, own: tuple[DarknetHead, ...]) -> Layout:
    """Raw darknet heads with anchors of your own."""
    return Layout(name, STRETCHED, shape.darknet_maps(own), always, DarknetDecoder(own))


ROWS = (
    Layout(
        "yolov5",  # and v7, v6
        CENTRED,
        shape.rows_with(5),
        shape.likely_rows(5, 1, 3, or_long=True),
        dense.decode_objectness_rows,
    ),
    Layout(
        "yolov8",  # and v9, v11
        CENTRED,
        shape.class_columns,
        shape.likely_columns,
        dense.decode_class_columns,
    ),
    Layout(
        "yolov8-transposed",
        CENTRED,
        shape.rows_with(4),
        shape.likely_rows(4, 1, or_long=True),
        dense.decode_class_rows,
    ),
    Layout("yolox", MEGVII, shape.cell_rows_with(5), shape.likely_cells, dense.decode_cell_rows),
    Layout(
        "yolox-decoded", MEGVII, shape.rows_with(5), shape.likely_rows(5, 1), dense.decode_objectness_rows
    ),
    Layout(
        "nanodet-plus",
        IMAGENET_BGR,
        shape.distance_rows((8, 16, 32, 64)),
        shape.likely_distances,
        dense.decode_distances((8, 16, 32, 64), 0.0),
    ),
    Layout(
        "nanodet",  # before "plus"
        replace(IMAGENET_BGR, fit="centre", padding=0),
        shape.distance_rows((8, 16, 32)),
        shape.likely_distances,
        dense.decode_distances((8, 16, 32), 0.5),
    ),
    Layout(
        "yolov4",  # and yolov4-tiny, with boxes and confidences
        STRETCHED,
        shape.boxes_and_classes,
        shape.likely_yolov4,
        dense.decode_boxes_and_confidences,
    ),
    darknet_layout("yolov4-tiny-heads", heads.YOLOV4_TINY),
    darknet_layout("yolov3-tiny-heads", heads.YOLOV3_TINY),
    Layout("fastestdet", STRETCHED_BGR, shape.one_map, shape.likely_stride_16, heads.decode_fastestdet),
    Layout(
        "rtdetr-logits",
        STRETCHED,
        shape.boxes_and_classes,
        shape.likely_queries(LOGITS, SCORES),
        queries.decode_boxes_and_logits,
        overlapping=False,
    ),
    Layout(
        "rtdetr-scores",
        STRETCHED,
        shape.boxes_and_classes,
        shape.likely_queries(SCORES, LOGITS),
        queries.decode_boxes_and_scores,
        overlapping=False,
    ),
    Layout(
        "rtdetr-joined",
        STRETCHED,
        shape.rows_with(4),
        shape.likely_joined_queries,
        queries.decode_joined,
        overlapping=False,
    ),
    Layout(
        "rf-detr",
        IMAGENET,
        shape.boxes_and_ids,
        shape.likely_ids,
        queries.decode_boxes_and_logits,
        overlapping=False,
    ),
    Layout(
        "rtdetr",  # with labels, boxes and scores, and an input for the image's size
        STRETCHED,
        shape.named(("box",), SCORES, ("label", "class"), asks_for_sizes=True),
        always,
        suppressed.decode_boxes_scores_classes,
        overlapping=False,
    ),
    Layout(
        "boxes-scores-labels",
        STRETCHED,
        shape.named(("box",), SCORES, ("label", "class")),
        always,
        suppressed.decode_boxes_scores_classes,
        overlapping=False,
    ),
    Layout(
        "tf-ssd",  # and all of TensorFlow's object detection
        RAW,
        shape.tensorflow_lists,
        always,
        suppressed.decode_tensorflow,
        overlapping=False,
    ),
    *(
        Layout(
            name,
            form,
            shape.corners_score_and_labels,
            always if name == "mmdet" else shape.never,
            suppressed.decode_corners_score_labels,
            overlapping=False,
        )
        for name, form in (
            ("mmdet", IMAGENET_CORNER),
            ("mmdet-rtmdet", replace(IMAGENET_CORNER, colours="bgr")),
            ("mmdet-yolox", MEGVII),
        )
    ),
    Layout(
        "counted",
        CENTRED,
        shape.named(("num",), ("box",), SCORES, ("label", "class")),
        always,
        suppressed.decode_counted,
        overlapping=False,
    ),
    Layout(
        "yolov10",
        CENTRED,
        shape.row_of(6),
        shape.likely_suppressed_rows,
        suppressed.decode_score_class_rows,
        overlapping=False,
    ),
    Layout(
        "yolov7-end2end",
        CENTRED,
        shape.flat_rows_of(7),
        always,
        suppressed.decode_batch_class_score_rows,
        overlapping=False,
    ),
    *(
        Layout(
            f"selected-{order}",
            CENTRED,
            shape.boxes_scores_selected,
            always,
            suppressed.decode_selected(order),
            overlapping=False,
        )
        for order in suppressed.CORNERS
    ),
)

LAYOUTS: Mapping[str, Layout] = {layout.name: layout for layout in ROWS}
