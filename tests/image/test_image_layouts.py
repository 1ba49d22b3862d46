"""Known boxes come back from models of every layout, through the letterbox and onto the image."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import constant_models as encode
import numpy as np
import pytest
from constant_models import SIDE, Arrays, Thing, write_model
from onnx import TensorProto, helper, numpy_helper
from semap_ingest.image.detector import ImageDetector
from semap_ingest.image.heads import DarknetHead
from semap_ingest.image.input_form import prepare
from semap_ingest.image.layout import LAYOUTS, darknet_layout
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import Image

from semap.errors import InvalidInput

WIDTH, HEIGHT = 640, 480
PERSONS = ((100.0, 50.0, 203.0, 301.0), (402.0, 203.0, 461.0, 352.0))
SCENE = (
    (PERSONS[0], 0, 0.9),
    ((110.0, 130.0, 190.0, 300.0), 16, 0.95),
    (PERSONS[1], 0, 0.8),
    ((500.0, 100.0, 560.0, 300.0), 0, 0.2),
)
AGAIN = ((112.0, 60.0, 215.0, 310.0), 0, 0.7)
YOLOV4_MASKS = {32: ((81, 82), (135, 169), (344, 319)), 16: ((23, 27), (37, 58), (81, 82))}
YOLOV3_MASKS = {32: ((81, 82), (135, 169), (344, 319)), 16: ((10, 14), (23, 27), (37, 58))}
SIZES = helper.make_tensor_value_info("orig_target_sizes", TensorProto.INT64, [1, 2])
COCO_METADATA = {"names": str({i: f"thing {i}" if i else "person" for i in range(80)}), "stride": "32"}

# The layout; its outputs; whether it must be named; how an image lies in its input; whether it needs suppression.
CASES = [
    ("yolov5", encode.objectness_rows, False, "centre", True),
    ("yolov8", encode.class_columns, False, "centre", True),
    ("yolov8-transposed", encode.class_rows, False, "centre", True),
    ("yolox", encode.cell_rows, True, "corner", True),
    ("yolox-decoded", lambda things: encode.objectness_rows(things, 2100), True, "corner", True),
    ("nanodet-plus", encode.distances(0.0, (8, 16, 32, 64)), False, "stretch", True),
    ("nanodet", encode.distances(0.5, (8, 16, 32)), False, "centre", True),
    ("yolov4", encode.boxes_and_confidences, False, "stretch", True),
    ("yolov4-tiny-heads", encode.darknet_maps(1.05, YOLOV4_MASKS), True, "stretch", True),
    ("yolov3-tiny-heads", encode.darknet_maps(1.0, YOLOV3_MASKS), True, "stretch", True),
    ("fastestdet", encode.fastestdet_map, False, "stretch", True),
    ("rtdetr-logits", encode.query_logits, False, "stretch", False),
    ("rtdetr-scores", encode.query_scores, False, "stretch", False),
    ("rf-detr", encode.query_ids, False, "stretch", False),
    ("tf-ssd", encode.tensorflow_lists, False, "stretch", False),
    ("mmdet", encode.corners_score_and_labels, False, "corner", False),
    ("rtdetr-joined", encode.joined_queries, False, "stretch", False),
    ("boxes-scores-labels", encode.labels_boxes_scores_flat, False, "stretch", False),
    ("counted", encode.counted, False, "centre", False),
    ("yolov10", encode.score_class_rows, False, "centre", False),
    ("yolov7-end2end", encode.batch_class_score_rows, False, "centre", False),
]
NUMBERED_AS_COCO = ("rf-detr", "tf-ssd")
"""Their classes have the ids of COCO's categories, and so names of their own."""


def to_input(corners: tuple[float, ...], fit: str) -> tuple[float, float, float, float]:
    """From the image of 640 x 480 to the input of 320 x 320, worked out by hand."""
    left, top, right, bottom = corners
    if fit == "stretch":
        return left / 2, top * SIDE / HEIGHT, right / 2, bottom * SIDE / HEIGHT
    shift = 40 if fit == "centre" else 0
    return left / 2, top / 2 + shift, right / 2, bottom / 2 + shift


def things_for(fit: str, *, again: bool) -> list[Thing]:
    seen = (*SCENE, AGAIN) if again else SCENE
    return [Thing(to_input(corners, fit), number, score) for corners, number, score in seen]


def grey() -> Image:
    return Image(7, "camera_optical", np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8))


def assert_persons(boxes: Boxes, tolerance_px: float = 1.0) -> None:
    assert (boxes.stamp_us, boxes.frame) == (7, "camera_optical")
    np.testing.assert_allclose(boxes.corners_px, PERSONS, atol=tolerance_px)
    np.testing.assert_allclose(boxes.score, [0.9, 0.8], atol=2e-3)
    assert boxes.label == ("person", "person")
    assert boxes.track.tolist() == [-1, -1]


@pytest.mark.parametrize(("name", "outputs", "named", "fit", "overlapping"), CASES, ids=[c[0] for c in CASES])
def test_known_boxes_come_back(
    tmp_path: Path,
    name: str,
    outputs: Callable[..., Arrays],
    named: bool,
    fit: str,
    overlapping: bool,
) -> None:
    path = write_model(tmp_path / "model.onnx", outputs(things_for(fit, again=overlapping)))
    if named:
        with pytest.raises(InvalidInput, match="have an ambiguous layout") as caught:
            ImageDetector.open(path)
        assert name in str(caught.value)
        assert "--camera-layout" in caught.value.remedy
    knows_names = LAYOUTS[name].overlapping or name in NUMBERED_AS_COCO
    names = None if knows_names else ["person", *"x" * 79]
    detector = ImageDetector.open(path, layout=name if named else None, class_names=names)
    assert detector.layout.name == name
    assert_persons(detector.detect(grey()))


EMPTY = [case for case in CASES if not case[2]]


@pytest.mark.parametrize(("name", "outputs"), [case[:2] for case in EMPTY], ids=[case[0] for case in EMPTY])
def test_nothing_is_found_where_nothing_is(tmp_path: Path, name: str, outputs: Callable[..., Arrays]) -> None:
    names = None if name in NUMBERED_AS_COCO else ["person", *"x" * 79]
    detector = ImageDetector.open(
        write_model(tmp_path / "model.onnx", outputs([])), class_names=names, wanted=None
    )
    assert detector.layout.name == name
    boxes = detector.detect(grey())
    assert (boxes.corners_px.shape, boxes.score.shape, boxes.label) == ((0, 4), (0,), ())
    assert (boxes.track.shape, boxes.track.dtype) == ((0,), np.int64)


def test_the_table_covers_every_layout() -> None:
    others = {"rtdetr", "mmdet-rtmdet", "mmdet-yolox", "selected-xyxy", "selected-yxyx", "selected-cxcywh"}
    assert {case[0] for case in CASES} | others == set(LAYOUTS)


def test_a_model_that_asks_for_the_size_is_told_that_of_its_input(tmp_path: Path) -> None:
    """The boxes are 0 to 1 inside, and multiplied with the sizes as the export does it."""
    arrays = encode.labels_boxes_scores(things_for("stretch", again=False))
    arrays["unit"] = arrays.pop("boxes") / np.float32(SIDE)
    nodes = [
        helper.make_node("Cast", ["orig_target_sizes"], ["size"], to=TensorProto.FLOAT),
        helper.make_node("Concat", ["size", "size"], ["sizes"], axis=1),
        helper.make_node("Mul", ["unit", "sizes"], ["boxes"]),
        helper.make_node("Constant", [], ["unit"], value=numpy_helper.from_array(arrays.pop("unit"))),
    ]
    path = write_model(
        tmp_path / "rtdetr.onnx",
        arrays,
        more_inputs=[SIZES],
        nodes=[nodes[3], *nodes[:3]],
        more_outputs=[helper.make_tensor_value_info("boxes", TensorProto.FLOAT, [1, 300, 4])],
    )
    detector = ImageDetector.open(path, class_names=["person", *"x" * 79])
    assert detector.layout.name == "rtdetr"
    assert_persons(detector.detect(grey()))


@pytest.mark.parametrize("layout", ["mmdet", "mmdet-rtmdet", "mmdet-yolox"])
def test_models_of_one_kind_are_fed_as_each_is_trained(tmp_path: Path, layout: str) -> None:
    """The model gives its input back as a score: of one green and bluish colour, by red, green or blue."""
    nodes = [
        helper.make_node("Slice", ["images", "from", "to", "axes"], ["corner"]),
        helper.make_node("Reshape", ["corner", "shape"], ["score"]),
        helper.make_node("Concat", ["corners", "score"], ["dets"], axis=2),
    ]
    constants = {
        "from": np.array([0, 0, 0, 0]), "to": np.array([1, 3, 1, 1]), "axes": np.arange(4),
        "shape": np.array([1, 3, 1]), "corners": np.tile(np.float32([10, 20, 60, 160]), (1, 3, 1)),
    }  # fmt: skip
    made = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(array))
        for name, array in constants.items()
    ]
    path = write_model(
        tmp_path / "model.onnx",
        {"labels": np.zeros((1, 3), np.int64)},
        nodes=[*made, *nodes],
        more_outputs=[helper.make_tensor_value_info("dets", TensorProto.FLOAT, [1, 3, 5])],
    )
    colour = np.array([140, 200, 250], np.uint8)
    detector = ImageDetector.open(path, layout=layout, class_names=["person"], min_score=1e-6)
    seen = detector.model.run(
        {"images": prepare(np.full((HEIGHT, WIDTH, 3), colour), detector.form, detector.input)[0]}
    )
    scores = np.asarray(seen[1])[0, :, 4]
    normal = (colour - np.array([123.675, 116.28, 103.53])) / np.array([58.395, 57.12, 57.375])
    wanted = {"mmdet": normal, "mmdet-rtmdet": normal[::-1], "mmdet-yolox": colour[::-1]}[layout]
    np.testing.assert_allclose(scores, wanted, rtol=1e-5)


@pytest.mark.parametrize(("names", "columns"), [(["person"], 2), (["person"], 1), (["robot", "person"], 3)])
def test_a_detr_of_ones_own_classes_may_have_a_place_more(
    tmp_path: Path, names: list[str], columns: int
) -> None:
    boxes, scores = encode.queries(things_for("stretch", again=False))
    logits = np.full((1, 300, columns), -20.0, np.float32)
    likely = np.clip(scores[..., 0], 1e-9, 1 - 1e-6)
    logits[..., names.index("person")] = np.log(likely / (1 - likely))
    path = write_model(tmp_path / "model.onnx", {"dets": boxes, "labels": logits})
    assert_persons(ImageDetector.open(path, class_names=names).detect(grey()))


@pytest.mark.parametrize("order", ["xyxy", "yxyx", "cxcywh"])
def test_the_operator_non_max_suppression(tmp_path: Path, order: str) -> None:
    things = things_for("centre", again=True)
    corners = np.array([thing.corners_px for thing in things], dtype=np.float32)
    boxes = {
        "xyxy": corners,
        "yxyx": corners[:, [3, 2, 1, 0]],
        "cxcywh": np.array([thing.centre_size for thing in things], dtype=np.float32),
    }[order]
    scores = np.zeros((1, 80, len(things)), dtype=np.float32)
    for i, thing in enumerate(things):
        scores[0, thing.number, i] = thing.score
    limits = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(value))
        for name, value in {
            "most": np.array([100]),
            "overlap": np.array([0.45], dtype=np.float32),
            "least": np.array([0.1], dtype=np.float32),
        }.items()
    ]
    selection = helper.make_node(
        "NonMaxSuppression",
        ["boxes", "scores", "most", "overlap", "least"],
        ["selected"],
        center_point_box=int(order == "cxcywh"),
    )
    path = write_model(
        tmp_path / "model.onnx",
        {"boxes": boxes[None], "scores": scores},
        nodes=[*limits, selection],
        more_outputs=[helper.make_tensor_value_info("selected", TensorProto.INT64, ["found", 3])],
    )
    with pytest.raises(InvalidInput, match="selected-xyxy, selected-yxyx, selected-cxcywh"):
        ImageDetector.open(path)
    assert_persons(ImageDetector.open(path, layout=f"selected-{order}").detect(grey()))


def test_the_projects_own_network_is_recognised(tmp_path: Path) -> None:
    """(1, 5, n), an input of 320 x 240 that half of a 640 x 480 image fills."""
    things = [Thing(tuple(side / 2 for side in c), 0, score) for c, _, score in (SCENE[0], SCENE[2], AGAIN)]
    for count in (1200, 300, 1500):
        path = write_model(
            tmp_path / "own.onnx",
            encode.class_columns(things, count, classes=1),
            input_shape=(1, 3, 240, 320),
            metadata={"names": "{0: 'person'}"},
        )
        detector = ImageDetector.open(path)
        assert (detector.layout.name, detector.input.size_px) == ("yolov8", (320, 240))
        assert_persons(detector.detect(grey()), tolerance_px=1e-3)


@pytest.mark.parametrize("task", ["segment", "pose"])
def test_masks_and_key_points_after_the_classes_are_left_out(tmp_path: Path, task: str) -> None:
    arrays = encode.class_columns(things_for("centre", again=True), more=32)
    if task == "segment":
        arrays["output1"] = np.zeros((1, 32, 80, 80), dtype=np.float32)
    path = write_model(tmp_path / "model.onnx", arrays, metadata={**COCO_METADATA, "task": task})
    assert_persons(ImageDetector.open(path).detect(grey()))


def test_anchors_of_ones_own(tmp_path: Path) -> None:
    masks = {32: ((60, 90), (80, 120), (100, 200)), 16: ((12, 30), (20, 50), (30, 80))}
    own = darknet_layout("ours", tuple(DarknetHead(stride, anchors) for stride, anchors in masks.items()))
    path = write_model(
        tmp_path / "model.onnx", encode.darknet_maps(1.0, masks)(things_for("stretch", again=True))
    )
    assert_persons(ImageDetector.open(path, layout=own).detect(grey()))


def test_a_layout_may_be_fed_otherwise(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.onnx", encode.class_columns(things_for("stretch", again=True)))
    form = replace(LAYOUTS["yolov8"].form, fit="stretch")
    assert_persons(ImageDetector.open(path, form=form).detect(grey()))


@pytest.mark.parametrize("kind", [np.float16, np.float64])
def test_outputs_of_other_precision(tmp_path: Path, kind: type[np.generic]) -> None:
    arrays = {
        name: array.astype(kind)
        for name, array in encode.class_columns(things_for("centre", again=True)).items()
    }
    path = write_model(tmp_path / "model.onnx", arrays)
    assert_persons(ImageDetector.open(path).detect(grey()), tolerance_px=1.5)
