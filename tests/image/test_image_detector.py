"""The detector as a whole: a real network on photographs, and outputs that are not as they should be."""

import json
from collections.abc import Sequence
from pathlib import Path

import constant_models as encode
import numpy as np
import pytest
from constant_models import Thing, write_model
from data_sets import data_set
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from semap_ingest.image.class_names import COCO
from semap_ingest.image.decoding import decode
from semap_ingest.image.detector import ImageDetector
from semap_ingest.sensing.image import CompressedImage, Image

from semap.errors import InvalidInput

SCENE = [Thing((10, 60, 110, 200), 0, 0.9), Thing((150, 60, 250, 200), 2, 0.8)]


def black(width: int = 320, height: int = 320) -> Image:
    return Image(0, "camera_optical", np.zeros((height, width, 3), dtype=np.uint8))


def ious(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    low = np.maximum(one[:, None, :2], other[None, :, :2])
    high = np.minimum(one[:, None, 2:], other[None, :, 2:])
    common = np.prod(np.clip(high - low, 0, None), axis=2)
    areas = [np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) for boxes in (one, other)]
    return np.asarray(common / (areas[0][:, None] + areas[1][None] - common))


def test_persons_in_photographs() -> None:
    """FastestDet finds 13 of the 14 persons at an IoU of 0.5, with at most 3 boxes that are none of them."""
    folder = data_set("detector")
    detector = ImageDetector.open(folder / "FastestDet.onnx")
    assert detector.layout.name == "fastestdet"
    images = json.loads((folder / "coco" / "person_boxes.json").read_text())["images"]
    persons = hits = others = 0
    for name, labels in images.items():
        image = decode(CompressedImage(0, "camera", (folder / "coco" / name).read_bytes()))
        assert isinstance(image, Image)
        found = detector.detect(image)
        truth = np.array(labels)
        overlaps = ious(np.hstack([truth[:, :2], truth[:, :2] + truth[:, 2:]]), found.corners_px)
        pairs = linear_sum_assignment(overlaps >= 0.5, maximize=True)
        matched = int((overlaps[pairs] >= 0.5).sum())
        persons, hits, others = persons + len(truth), hits + matched, others + len(found) - matched
    assert persons == 14
    assert hits >= 13
    assert others <= 3


def test_coco_names_are_those_of_the_data() -> None:
    """Whose file has the older names of some classes."""
    listed = (data_set("detector") / "coco.names").read_text().splitlines()
    others = {(old, new) for old, new in zip(listed, COCO, strict=True) if old != new}
    assert others == {
        ("aeroplane", "airplane"),
        ("motorbike", "motorcycle"),
        ("sofa", "couch"),
        ("pottedplant", "potted plant"),
        ("diningtable", "dining table"),
        ("tvmonitor", "tv"),
    }


def test_two_threads_find_the_same() -> None:
    folder = data_set("detector")
    image = decode(CompressedImage(0, "camera", (folder / "coco" / "000000197388.jpg").read_bytes()))
    assert isinstance(image, Image)
    one, two = (
        ImageDetector.open(folder / "FastestDet.onnx", threads=threads).detect(image) for threads in (1, 2)
    )
    np.testing.assert_allclose(one.corners_px, two.corners_px, atol=0.05)


@pytest.mark.parametrize(
    ("class_names", "wanted", "labels"),
    [
        (None, ("person",), ("person",)),
        (None, "person", ("person",)),
        (None, ("car", "person"), ("person", "car")),
        (None, None, ("person", "car")),
        (None, (), ()),
        (["a", "b", "c", *"x" * 77], ("c",), ("c",)),
    ],
)
def test_only_what_is_wanted(
    tmp_path: Path, class_names: Sequence[str] | None, wanted: Sequence[str] | None, labels: tuple[str, ...]
) -> None:
    path = write_model(tmp_path / "model.onnx", encode.class_columns(SCENE))
    detector = ImageDetector.open(path, class_names=class_names, wanted=wanted)
    boxes = detector.detect(black())
    assert boxes.label == labels
    assert len(boxes) == len(boxes.score) == len(boxes.track) == len(labels)


def test_a_place_belongs_to_its_best_class(tmp_path: Path) -> None:
    arrays = encode.class_columns([Thing((10, 60, 110, 200), 16, 0.9)])
    arrays["output0"][0, 4, 0] = 0.6
    path = write_model(tmp_path / "model.onnx", arrays)
    assert ImageDetector.open(path).detect(black()).label == ()
    assert ImageDetector.open(path, wanted=("person", "dog")).detect(black()).label == ("dog",)


def test_names_from_a_file_from_metadata_and_none(tmp_path: Path) -> None:
    arrays = encode.class_columns(SCENE, classes=3)
    path = write_model(tmp_path / "model.onnx", arrays)
    with pytest.raises(InvalidInput, match="its classes have no names") as caught:
        ImageDetector.open(path)
    assert "--camera-classes" in caught.value.remedy
    assert ImageDetector.open(path, wanted=("2",)).detect(black()).label == ("2",)
    with pytest.raises(InvalidInput, match="no class 3"):
        ImageDetector.open(path, wanted=("3",))

    listed = tmp_path / "names.txt"
    listed.write_text("person\n\nbicycle \ncar\n")
    detector = ImageDetector.open(path, class_names=listed, wanted=None)
    assert detector.detect(black()).label == ("person", "car")
    with pytest.raises(InvalidInput, match="no class 'dog'") as caught:
        ImageDetector.open(path, class_names=str(listed), wanted=("dog",))
    assert caught.value.remedy == "The classes are: person, bicycle, car."

    for names in ("{0: 'person', 1: 'bicycle', 2: 'car'}", '["person", "bicycle", "car"]'):
        path = write_model(tmp_path / "model.onnx", arrays, metadata={"names": names})
        assert ImageDetector.open(path, wanted=None).detect(black()).label == ("person", "car")


@pytest.mark.parametrize(
    "names", ["", "{1: 'a'}", "{'a': 0}", "[1, 2]", "{0: 'a'", "[]", "f()", "{0: 'a', 'b': 1}"]
)
def test_metadata_that_hold_no_names_are_passed_over(tmp_path: Path, names: str) -> None:
    path = write_model(tmp_path / "model.onnx", encode.class_columns(SCENE), metadata={"names": names})
    assert ImageDetector.open(path).detect(black()).label == ("person",)


def test_names_that_cannot_be_had(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.onnx", encode.class_columns(SCENE))
    with pytest.raises(InvalidInput, match="cannot be read"):
        ImageDetector.open(path, class_names=tmp_path / "none.txt")
    with pytest.raises(InvalidInput, match="no class name"):
        ImageDetector.open(path, class_names=[])
    with pytest.raises(InvalidInput, match="3 class names"):
        ImageDetector.open(path, class_names=["a", "b", "c"])


@pytest.mark.parametrize("limits", [{"min_score": 0.0}, {"min_score": 1.1}, {"max_overlap": float("nan")}])
def test_limits_that_are_none(tmp_path: Path, limits: dict[str, float]) -> None:
    with pytest.raises(InvalidInput, match="min_score"):
        ImageDetector.open(tmp_path / "model.onnx", **limits)  # type: ignore[arg-type]


def test_boxes_end_at_the_edges_of_the_image(tmp_path: Path) -> None:
    """An image of 640 x 320 lies in lines 80 to 240 of the input."""
    things = [
        Thing((-50, 100, 40, 300), 0, 0.9),
        Thing((300, 60, 400, 500), 0, 0.8),
        Thing((100, 10, 200, 70), 0, 0.7),
        Thing((400, 100, 500, 200), 0, 0.6),
    ]
    path = write_model(tmp_path / "model.onnx", encode.class_columns(things))
    boxes = ImageDetector.open(path).detect(black(640, 320))
    np.testing.assert_allclose(boxes.corners_px, [[0, 40, 80, 320], [600, 0, 640, 320]], atol=1e-3)
    assert boxes.score.tolist() == pytest.approx([0.9, 0.8])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -1e30])
@pytest.mark.parametrize("place", range(6))
@pytest.mark.parametrize("rows", [encode.objectness_rows, encode.score_class_rows])
def test_numbers_that_are_none_take_only_their_own_box_away(
    tmp_path: Path, rows: object, place: int, value: float
) -> None:
    arrays = rows([SCENE[0], Thing((150, 60, 250, 200), 0, 0.8)])  # type: ignore[operator]
    next(iter(arrays.values()))[0, 0, place] = value
    path = write_model(tmp_path / "model.onnx", arrays)
    boxes = ImageDetector.open(path, class_names=["person", *"x" * 79]).detect(black())
    assert np.isfinite(boxes.corners_px).all()
    assert ((boxes.score > 0) & (boxes.score <= 1)).all()
    assert [150, 60, 250, 200] in boxes.corners_px.round().tolist()


def test_all_places_at_once(tmp_path: Path) -> None:
    """A network gone wild: every place sees a person, all of them within the image."""
    rng = np.random.default_rng(3)
    columns = np.full((1, 84, 8400), 0.1, dtype=np.float32)
    columns[0, :2] = rng.uniform(100, 220, (2, 8400))
    columns[0, 2:4] = rng.uniform(10, 150, (2, 8400))
    columns[0, 4] = 0.9
    path = write_model(tmp_path / "model.onnx", {"output0": columns})
    boxes = ImageDetector.open(path).detect(black())
    assert 0 < len(boxes) <= 1000
    overlaps = ious(boxes.corners_px, boxes.corners_px)
    assert overlaps[np.triu_indices(len(boxes), 1)].max() <= 0.45 + 1e-6


@pytest.mark.parametrize("shape", [(1, 1), (1, 4000), (4000, 1), (3, 2)])
def test_images_of_any_shape(tmp_path: Path, shape: tuple[int, int]) -> None:
    path = write_model(tmp_path / "model.onnx", encode.class_columns(SCENE))
    boxes = ImageDetector.open(path).detect(black(*shape))
    assert (boxes.corners_px >= 0).all()
    assert (boxes.corners_px <= np.tile(shape, 2)).all()


def test_views_are_images_too(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.onnx", encode.class_columns(SCENE))
    detector = ImageDetector.open(path)
    mirrored = np.zeros((480, 640, 3), dtype=np.uint8)[::-1, ::-2, ::-1]
    assert len(detector.detect(Image(0, "camera_optical", mirrored))) == 1


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((480, 640), np.uint8),
        np.zeros((0, 5, 3), np.uint8),
        np.zeros((4, 4, 4), np.uint8),
        np.zeros((4, 4, 3)),
    ],
)
def test_what_is_no_image(tmp_path: Path, pixels: NDArray[np.uint8]) -> None:
    path = write_model(tmp_path / "model.onnx", encode.class_columns(SCENE))
    with pytest.raises(InvalidInput, match="an image of shape"):
        ImageDetector.open(path).detect(Image(0, "camera_optical", pixels))
