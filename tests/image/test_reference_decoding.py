"""Real models on photographs: the boxes are those of a decoder that was written for this test alone, in numpy.

It goes by what each model's own project does with its outputs, cell by cell, and shares nothing with semap's.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import onnx
import onnxruntime
import pytest
from data_sets import data_set
from numpy.typing import NDArray
from semap_ingest.image.decoding import decode
from semap_ingest.image.detector import ImageDetector
from semap_ingest.sensing.image import CompressedImage, Image

LEAST = 0.4


def photographs() -> list[Path]:
    folder = data_set("detector") / "coco"
    return [folder / name for name in json.loads((folder / "person_boxes.json").read_text())["images"]]


def outputs_of(model: Path, tensor: NDArray[np.float32]) -> NDArray[np.float32]:
    session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
    return np.asarray(session.run(None, {session.get_inputs()[0].name: tensor[None]})[0][0])


def yolox(model: Path, bgr: NDArray[np.uint8]) -> Iterator[tuple[float, tuple[float, ...]]]:
    """Megvii's: as large as fits into the upper left corner, 114 around it, colours from 0 to 255."""
    height, width = bgr.shape[:2]
    ratio = min(416 / height, 416 / width)
    filled = np.full((416, 416, 3), 114, np.uint8)
    inner = round(width * ratio), round(height * ratio)
    filled[: inner[1], : inner[0]] = cv2.resize(bgr, inner, interpolation=cv2.INTER_LINEAR)
    rows = iter(outputs_of(model, filled.transpose(2, 0, 1).astype(np.float32)))
    for stride in (8, 16, 32):
        for line in range(416 // stride):
            for column in range(416 // stride):
                x, y, w, h, there, *classes = (float(number) for number in next(rows))
                if max(range(80), key=classes.__getitem__) == 0 and there * classes[0] >= LEAST:
                    x, y = (x + column) * stride, (y + line) * stride
                    w, h = math.exp(w) * stride, math.exp(h) * stride
                    corners = x - w / 2, y - h / 2, x + w / 2, y + h / 2
                    scale = width / inner[0], height / inner[1]
                    yield there * classes[0], tuple(c * scale[i % 2] for i, c in enumerate(corners))


def fastestdet(model: Path, bgr: NDArray[np.uint8]) -> Iterator[tuple[float, tuple[float, ...]]]:
    """Its test.py: stretched over the whole input, from 0 to 1."""
    height, width = bgr.shape[:2]
    stretched = cv2.resize(bgr, (352, 352), interpolation=cv2.INTER_LINEAR)
    maps = outputs_of(model, stretched.transpose(2, 0, 1).astype(np.float32) / 255)
    for line in range(22):
        for column in range(22):
            there, x, y, w, h, *classes = (float(number) for number in maps[:, line, column])
            score = there**0.6 * classes[0] ** 0.4
            if max(range(80), key=classes.__getitem__) == 0 and score >= LEAST:
                x, y = (column + math.tanh(x)) / 22, (line + math.tanh(y)) / 22
                w, h = 1 / (1 + math.exp(-w)), 1 / (1 + math.exp(-h))
                yield (
                    score,
                    ((x - w / 2) * width, (y - h / 2) * height, (x + w / 2) * width, (y + h / 2) * height),
                )


def suppressed(
    found: Iterator[tuple[float, tuple[float, ...]]], most: float = 0.45
) -> list[tuple[float, ...]]:
    """Best first, without those that overlap a better one; corners, then the score."""
    kept: list[tuple[float, ...]] = []
    for score, box in sorted(found, reverse=True):
        if all(overlap(box, other) <= most for other in kept):
            kept.append((*box, score))
    return kept


def overlap(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    across = min(one[2], other[2]) - max(one[0], other[0])
    down = min(one[3], other[3]) - max(one[1], other[1])
    common = max(across, 0) * max(down, 0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (one, other)]
    return common / (sum(areas) - common)


@pytest.mark.parametrize(
    ("file", "layout", "reference"),
    [("yolox_nano.onnx", "yolox", yolox), ("FastestDet.onnx", "fastestdet", fastestdet)],
)
def test_boxes_are_those_of_the_reference(file: str, layout: str, reference: object) -> None:
    """And nobody has to say which layout it is."""
    model = data_set("detector") / file
    detector = ImageDetector.open(model, min_score=LEAST)
    assert detector.layout.name == layout
    persons = 0
    for path in photographs():
        image = decode(CompressedImage(0, "camera", path.read_bytes()))
        assert isinstance(image, Image)
        height, width = image.pixels.shape[:2]
        boxes = detector.detect(image)
        wanted = np.array(suppressed(reference(model, np.ascontiguousarray(image.pixels[..., ::-1]))))  # type: ignore[operator]
        wanted[:, :4] = np.clip(wanted[:, :4], 0, [width, height, width, height])
        np.testing.assert_allclose(boxes.corners_px, wanted[:, :4], atol=0.05)
        np.testing.assert_allclose(boxes.score, wanted[:, 4], atol=1e-4)
        persons += len(boxes)
    assert persons >= 11


def test_class_names_in_its_metadata_do_not_make_it_another_model(tmp_path: Path) -> None:
    model = onnx.load(data_set("detector") / "yolox_nano.onnx")
    names = {0: "person", **{number: f"thing {number}" for number in range(1, 80)}}
    onnx.helper.set_model_props(model, {"names": str(names), "stride": "32"})
    onnx.save(model, tmp_path / "named.onnx")
    detector = ImageDetector.open(tmp_path / "named.onnx")
    image = decode(CompressedImage(0, "camera", photographs()[-1].read_bytes()))
    assert isinstance(image, Image)
    assert detector.layout.name == "yolox"
    assert detector.detect(image).label.count("person") == 4
