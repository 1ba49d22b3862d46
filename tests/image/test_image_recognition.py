"""Shapes, names and metadata of models that exist, and what is made of them."""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import pytest
from semap_ingest.image.arrangement import Evidence
from semap_ingest.image.recognition import recognise
from semap_ingest.image.tensor import Tensor

from semap.errors import InvalidInput

ULTRALYTICS = {"names": "{}", "stride": "32", "task": "detect"}
Shapes = Mapping[str, Sequence[int]]


@dataclass(frozen=True)
class Known:
    """Some model that people have, and the layouts that it may be."""

    name: str
    outputs: Shapes
    layouts: str
    input_px: tuple[int, int] = (640, 640)
    class_count: int | None = None
    metadata: Mapping[str, str] = field(default_factory=dict)
    integers: tuple[str, ...] = ()

    @property
    def evidence(self) -> Evidence:
        outputs = tuple(
            Tensor(name, "int64" if name in self.integers else "float", tuple(shape))
            for name, shape in self.outputs.items()
        )
        return Evidence(outputs, self.input_px, self.class_count, self.metadata)


KNOWN = [
    Known("yolov5s", {"output0": (1, 25200, 85)}, "yolov5", class_count=80, metadata=ULTRALYTICS),
    Known("yolov5s, old", {"output": (1, 25200, 85)}, "yolov5"),
    Known("yolov5s6", {"output0": (1, 102000, 85)}, "yolov5", (1280, 1280)),
    Known("yolov7-tiny", {"output": (1, 25200, 85)}, "yolov5"),
    Known("yolov7 of one class", {"output": (1, 25200, 6)}, "yolov5"),
    Known("yolov5 of 320 x 192", {"output": (1, 3780, 85)}, "yolov5", (320, 192)),
    Known("yolov6s", {"outputs": (1, 8400, 85)}, "yolov5 yolox yolox-decoded"),
    Known("yolox_s", {"output": (1, 8400, 85)}, "yolov5 yolox yolox-decoded"),
    Known("yolox_tiny", {"output": (1, 3549, 85)}, "yolov5 yolox yolox-decoded", (416, 416)),
    Known("yolov8n", {"output0": (1, 84, 8400)}, "yolov8"),
    Known("yolov8n, names", {"output0": (1, 84, 8400)}, "yolov8", class_count=80, metadata=ULTRALYTICS),
    Known("yolov8n of one class", {"output0": (1, 5, 8400)}, "yolov8"),
    Known("yolov8n-p2", {"output0": (1, 84, 34000)}, "yolov8"),
    Known("yolov8 transposed", {"output0": (1, 8400, 84)}, "yolov8-transposed"),
    Known("yolov8 transposed, one class", {"output0": (1, 8400, 5)}, "yolov8-transposed"),
    Known(
        "two classes or one with objectness",
        {"output0": (1, 8400, 6)},
        "yolov5 yolov8-transposed yolox yolox-decoded",
    ),
    Known("two classes, named", {"output0": (1, 8400, 6)}, "yolov8-transposed", class_count=2),
    Known("one class, named", {"output0": (1, 8400, 6)}, "yolov5 yolox yolox-decoded", class_count=1),
    Known(
        "yolov8n-pose",
        {"output0": (1, 56, 8400)},
        "yolov8",
        class_count=1,
        metadata={**ULTRALYTICS, "task": "pose"},
    ),
    Known("yolov10n", {"output0": (1, 300, 6)}, "yolov10"),
    Known("yolo26n", {"output0": (1, 300, 6)}, "yolov10", class_count=80, metadata={"end2end": "True"}),
    Known("yolov10 of 240 x 320", {"output0": (1, 300, 6)}, "yolov10", (320, 240), class_count=80),
    Known(
        "six columns for what may be a grid",
        {"output0": (1, 300, 6)},
        "yolov5 yolov8-transposed yolox yolox-decoded",
        (320, 240),
    ),
    Known("rtdetr-l, Ultralytics", {"output0": (1, 300, 84)}, "rtdetr-joined"),
    Known(
        "rtdetr of two classes",
        {"output0": (1, 300, 6)},
        "rtdetr-joined",
        class_count=2,
        metadata={"description": "Ultralytics rtdetr-l model"},
    ),
    Known("rtdetr_r50vd", {"logits": (1, 300, 80), "pred_boxes": (1, 300, 4)}, "rtdetr-logits"),
    Known("queries unnamed", {"a": (1, 300, 80), "b": (1, 300, 4)}, "rtdetr-logits rtdetr-scores"),
    Known("yolov4", {"boxes": (1, 22743, 1, 4), "confs": (1, 22743, 80)}, "yolov4", (608, 608)),
    Known("yolov4-tiny", {"confs": (1, 2535, 80), "boxes": (1, 2535, 1, 4)}, "yolov4", (416, 416)),
    Known("yolov4-tiny squeezed", {"boxes": (1, 2535, 4), "confs": (1, 2535, 80)}, "yolov4", (416, 416)),
    Known(
        "yolov4-tiny raw",
        {"a": (1, 255, 26, 26), "b": (1, 255, 13, 13)},
        "yolov4-tiny-heads yolov3-tiny-heads",
        (416, 416),
    ),
    Known("four classes", {"scores": (1, 300, 4), "boxes": (1, 300, 4)}, "rtdetr-scores"),
    Known("fastestdet", {"758": (1, 85, 22, 22)}, "fastestdet", (352, 352)),
    Known(
        "ssd of TensorFlow",
        {
            "detection_boxes:0": (1, 100, 4),
            "detection_classes:0": (1, 100),
            "detection_scores:0": (1, 100),
            "num_detections:0": (1,),
        },
        "tf-ssd",
    ),
    Known("rf-detr-nano", {"dets": (1, 300, 4), "labels": (1, 300, 91)}, "rf-detr", (384, 384)),
    Known(
        "rf-detr of masks",
        {"dets": (1, 200, 4), "labels": (1, 200, 91), "masks": (1, 200, 78, 78)},
        "rf-detr",
        (312, 312),
    ),
    Known("rf-detr of one class", {"dets": (1, 300, 4), "labels": (1, 300, 2)}, "rf-detr", class_count=1),
    Known("nanodet-plus-m_416", {"output": (1, 3598, 112)}, "nanodet-plus", (416, 416)),
    Known("nanodet-plus-m_320", {"output": (1, 2125, 112)}, "nanodet-plus", (320, 320), class_count=80),
    Known(
        "nanodet-plus of one class",
        {"output": (1, 2125, 33)},
        "yolov5 yolov8-transposed yolox yolox-decoded nanodet-plus",
        (320, 320),
    ),
    Known("nanodet-plus of persons", {"output": (1, 2125, 33)}, "nanodet-plus", (320, 320), class_count=1),
    Known("nanodet-m", {"output": (1, 2100, 112)}, "nanodet", (320, 320)),
    Known("faster rcnn", {"dets": (1, 100, 5), "labels": (1, 100)}, "mmdet", integers=("labels",)),
    Known("nothing found", {"dets": (1, 0, 5), "labels": (1, 0)}, "mmdet", integers=("labels",)),
    Known(
        "mask rcnn",
        {"dets": (1, 7, 5), "labels": (1, 7), "masks": (1, 7, 28, 28)},
        "mmdet",
        integers=("labels",),
    ),
    Known("yolov7 end to end", {"output": (0, 7)}, "yolov7-end2end"),
    Known(
        "torchvision",
        {"boxes": (0, 4), "labels": (0,), "scores": (0,)},
        "boxes-scores-labels",
        integers=("labels",),
    ),
    Known(
        "efficient nms",
        {"num_dets": (1, 1), "det_boxes": (1, 100, 4), "det_scores": (1, 100), "det_classes": (1, 100)},
        "counted",
    ),
]

UNKNOWN = [
    Known("classifier", {"prob": (1, 1000)}, "a classifier", (224, 224)),
    Known("old classifier", {"prob": (1, 1000, 1, 1)}, "a classifier", (224, 224)),
    Known(
        "yolov5 raw", {str(i): (1, 3, 80, 80, 85) for i in range(3)}, "no detector whose outputs are known"
    ),
    Known("two images", {"output": (2, 25200, 85)}, "no detector whose outputs are known"),
    Known("names for another", {"output0": (1, 84, 8400)}, "3 class names", class_count=3),
    Known("two classes in rows, three names", {"output": (1, 8400, 6)}, "may be yolov10", class_count=3),
    Known("a background among the names", {"output": (1, 8400, 85)}, "ambiguous layout", class_count=81),
    Known(
        "heads that are called so",
        {"boxes": (1, 900, 4), "scores": (1, 900, 80), "labels": (1, 5)},
        "no detector",
    ),
    Known("segmentation", {"out": (1, 21, 520, 520)}, "fastestdet", (520, 520)),
    Known("nothing", {}, "no detector whose outputs are known"),
]


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.name)
def test_models_that_exist(known: Known) -> None:
    layouts = known.layouts.split()
    if len(layouts) == 1:
        assert recognise(known.evidence, "", None, "m.onnx")[0].name == layouts[0]
        return
    with pytest.raises(InvalidInput, match=r"have an ambiguous layout") as caught:
        recognise(known.evidence, "", None, "m.onnx")
    assert re.findall(r"may be (.*);", str(caught.value)) == [", ".join(layouts)]
    for layout in layouts:
        assert recognise(known.evidence, "", layout, "m.onnx")[0].name == layout


@pytest.mark.parametrize("known", UNKNOWN, ids=lambda known: known.name)
def test_what_is_no_detector(known: Known) -> None:
    with pytest.raises(InvalidInput, match=known.layouts) as caught:
        recognise(known.evidence, "what was found", None, "m.onnx")
    assert "what was found" in str(caught.value)
    assert caught.value.remedy
    assert caught.value.where == "m.onnx"


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.name)
def test_the_order_of_outputs_does_not_matter(known: Known) -> None:
    for outputs in itertools.permutations(known.outputs.items()):
        layout = known.layouts.split()[0]
        evidence = replace(known, outputs=dict(outputs)).evidence
        _, arrangement = recognise(evidence, "", layout, "m.onnx")
        names = [list(dict(outputs))[i] for i in arrangement.order]
        first = recognise(known.evidence, "", layout, "m.onnx")[1].order
        assert names == [list(known.outputs)[i] for i in first]


def test_a_layout_that_there_is_not() -> None:
    with pytest.raises(InvalidInput, match="no layout 'yolo'") as caught:
        recognise(KNOWN[0].evidence, "", "yolo", "m.onnx")
    assert "yolov5" in caught.value.remedy


def test_a_layout_that_does_not_fit() -> None:
    with pytest.raises(InvalidInput, match=r"not of the layout 'yolov8'; it has (.*) and 80 class names"):
        recognise(KNOWN[0].evidence, "what was found", "yolov8", "m.onnx")
