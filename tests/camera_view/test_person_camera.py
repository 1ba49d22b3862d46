"""The shipped person detector finds on images of seeds that it was not trained on what its card says."""

import itertools
import re

import numpy as np
import onnx
import pytest
from semap_ingest.image.detector import ImageDetector
from semap_ingest.sensing.image import Image

from ingest.training.person_figures import MODEL, average_precision, matches, measure, overlaps
from ingest.training.person_scenes import HELD_OUT_SEEDS, TRAINING_SEEDS, views


def stated(row):
    """A figure of the model card's table."""
    card = MODEL.with_suffix(".md").read_text(encoding="utf-8")
    found = re.search(rf"^\| {re.escape(row)} \| (-?[\d.]+)", card, re.MULTILINE)
    assert found, row
    return float(found[1])


def test_it_finds_what_its_card_says():
    assert not set(HELD_OUT_SEEDS) & set(TRAINING_SEEDS)
    seen = list(itertools.chain.from_iterable(views(seed) for seed in HELD_OUT_SEEDS[:5]))
    figures = measure(seen, ImageDetector.open(MODEL, min_score=0.02))
    assert figures.images == 30
    assert figures.recall >= stated("recall") - 0.06
    assert figures.false_positives_per_image <= stated("false positives per image") + 0.1
    assert figures.average_precision_50 >= stated("average precision, IoU 0.5") - 0.05
    # three standard errors of some forty persons
    assert abs(figures.bottom_bias_px - stated("lower edge, bias [px]")) <= 3.0
    assert figures.bottom_std_px <= stated("lower edge, standard deviation [px]") + 2.0
    assert figures.middle_std_px <= stated("middle, standard deviation [px]") + 1.0


def test_it_finds_nobody_on_a_grey_image():
    grey = Image(0, "camera", np.full((480, 640, 3), 114, np.uint8))
    assert len(ImageDetector.open(MODEL).detect(grey)) == 0


def test_it_is_small_and_says_what_it_is():
    assert MODEL.stat().st_size <= 2_000_000
    model = onnx.load(MODEL)
    assert model.opset_import[0].version <= 17
    about = {entry.key: entry.value for entry in model.metadata_props}
    assert about["names"] == "{0: 'person'}"
    shapes = [
        [axis.dim_value for axis in value.type.tensor_type.shape.dim]
        for value in (*model.graph.input, *model.graph.output)
    ]
    assert shapes == [[1, 3, 240, 320], [1, 5, 1500]]


def test_each_person_is_matched_once_and_the_hardly_seen_do_not_count():
    true = np.array([[0, 0, 10, 20], [20, 0, 30, 20], [50, 0, 60, 20]], float)
    found = np.array([[0, 0, 10, 21], [0, 0, 10, 19], [50, 0, 60, 20], [80, 0, 90, 9]], float)
    overlap = overlaps(found, true)
    assert overlap[0, 0] == pytest.approx(20 / 21)
    person = matches(overlap, np.array([True, True, False]), 0.5)
    assert person.tolist() == [0, -1, -2, -1]
    # by falling score: a hit, a miss, one that does not count, a miss; one of two persons is found
    assert average_precision(np.array([0.9, 0.8, 0.7, 0.6]), person, 2) == pytest.approx(0.5)
    assert average_precision(np.array([0.6, 0.8, 0.7, 0.9]), person, 2) == pytest.approx(0.5 / 3)
