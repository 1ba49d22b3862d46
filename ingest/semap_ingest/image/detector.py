"""Boxes of persons, or of whatever is wanted, in images, by an ONNX model of any usual layout."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.image.arrangement import Evidence
from semap_ingest.image.candidates import Candidates, Choice
from semap_ingest.image.class_names import USUAL, ClassNames, given_names, names_in
from semap_ingest.image.input_form import InputForm, prepare
from semap_ingest.image.layout import Layout
from semap_ingest.image.letterbox import Letterbox
from semap_ingest.image.model_file import CPU, ModelFile
from semap_ingest.image.recognition import fitting, recognise
from semap_ingest.image.suppression import suppress
from semap_ingest.image.tensor import ImageInput
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import Image

LEAST_REACH_PX = 2.0
"""All boxes of an image nearer to its corner are those of a model that counts from 0 to 1."""


@dataclass(frozen=True, eq=False)
class ImageDetector:
    """A model with all that is known of it; made by `open`.

    order    which outputs the layout's decoder takes
    fitting  names of all layouts that its outputs may have, be it likely or not
    """

    model: ModelFile
    input: ImageInput
    form: InputForm
    layout: Layout
    order: tuple[int, ...]
    names: ClassNames
    choice: Choice
    max_overlap: float
    fitting: tuple[str, ...] = ()

    @classmethod
    def open(
        cls,
        path: str | Path,
        *,
        layout: str | Layout | None = None,
        class_names: str | Path | Sequence[str] | None = None,
        wanted: Collection[str] | None = ("person",),
        min_score: float = 0.4,
        max_overlap: float = 0.45,
        providers: Sequence[str] = (CPU,),
        threads: int = 1,
        form: InputForm | None = None,
        size_px: tuple[int, int] | None = None,
    ) -> ImageDetector:
        """Load a model and find out how it is spoken to; it is run once on a grey image.

        layout       one of `LAYOUTS`, or one of your own; recognised where None
        class_names  a list, or a file with one name in a line; where None those in the model's metadata,
                     COCO's for 80, 90 and 91 classes, else the classes' numbers
        wanted       names of the classes to find; None: all
        max_overlap  of two boxes of one class that stay [IoU]
        form         of the input, where the model is not fed as others of its layout
        size_px      width and height of the input, of a model that leaves them open
        raises       InvalidInput where the file is no detector that can be used so, saying what was found
        """
        if not (0 < min_score <= 1 and 0 < max_overlap <= 1):
            raise InvalidInput(
                f"min_score {min_score} and max_overlap {max_overlap}", "Give numbers above 0 and up to 1."
            )
        providers = (providers,) if isinstance(providers, str) else providers
        model = ModelFile.open(Path(path), providers, threads)
        image_input = model.image_input(size_px)
        names = given_names(class_names) or names_in(model.metadata)
        arrays = _run_on_grey(model, image_input)
        outputs = model.measured(arrays)
        evidence = Evidence(
            outputs,
            image_input.size_px,
            len(names) if names else None,
            model.metadata,
            image_input.sizes_input is not None,
            arrays,
        )
        known, arrangement = recognise(evidence, model.described(outputs), layout, model.where)
        called = ClassNames(names or USUAL.get(arrangement.class_count or 0))
        numbers = None if wanted is None else _numbers(called, wanted, arrangement.class_count, model.where)
        return cls(
            model,
            image_input,
            form or known.form,
            known,
            arrangement.order,
            called,
            Choice(numbers, arrangement.class_count, min_score, image_input.size_px),
            max_overlap,
            fitting(evidence),
        )

    def detect(self, image: Image) -> Boxes:
        """The boxes in an image, best score first, cut off at its edges.

        raises  InvalidInput where the pixels are not (height, width, 3) uint8 with something in it
        """
        pixels = image.pixels
        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8 or not pixels.size:
            raise InvalidInput(
                f"an image of shape {pixels.shape} and type {pixels.dtype}",
                "Give (height, width, 3) uint8, red first.",
                image.frame,
            )
        tensor, letterbox = prepare(pixels, self.form, self.input)
        outputs = self.model.run({self.input.name: tensor, **self.input.constant_feeds})
        # A network may give any numbers; what comes of those that are none is left out below.
        with np.errstate(all="ignore"):
            candidates = self.layout.decode([outputs[i] for i in self.order], self.choice)
        if len(candidates.score) and np.abs(candidates.corners_px).max() <= LEAST_REACH_PX:
            raise InvalidInput(
                f"the boxes of {self.model.where} lie within {LEAST_REACH_PX:g} px of the image's corner,"
                " as if their unit were another one",
                "Name the layout that it was exported with: --camera-layout NAME.",
            )
        candidates = _in_reach(candidates, self.input.size_px)
        if self.layout.overlapping:
            candidates = suppress(candidates, self.max_overlap)
        return self._boxes(image, candidates, letterbox)

    def _boxes(self, image: Image, candidates: Candidates, letterbox: Letterbox) -> Boxes:
        corners = letterbox.to_image(candidates.corners_px)
        corners = np.clip(corners, 0.0, np.tile(letterbox.image_px, 2))
        inside = (corners[:, 2] > corners[:, 0]) & (corners[:, 3] > corners[:, 1])
        order = np.flatnonzero(inside)
        order = order[np.argsort(-candidates.score[order], kind="stable")]
        return Boxes(
            image.stamp_us,
            image.frame,
            corners[order],
            np.minimum(candidates.score[order], 1.0),
            self.names.labels(candidates.class_number[order]),
            np.full(len(order), -1, dtype=np.int64),
        )


def _run_on_grey(model: ModelFile, image_input: ImageInput) -> list[NDArray[np.generic]]:
    width, height = image_input.size_px
    grey = np.full((height, width, 3), 128, dtype=np.uint8)
    tensor, _ = prepare(grey, InputForm(fit="stretch"), image_input)
    return model.run({image_input.name: tensor, **image_input.constant_feeds})


def _numbers(
    names: ClassNames, wanted: Collection[str], class_count: int | None, where: str
) -> NDArray[np.int64]:
    numbers = names.numbers((wanted,) if isinstance(wanted, str) else wanted, where)
    if class_count is not None and len(numbers) and numbers[-1] >= class_count:
        raise InvalidInput(
            f"there is no class {numbers[-1]}", f"The model has {class_count}, numbered from 0.", where
        )
    return numbers


def _in_reach(candidates: Candidates, input_px: tuple[int, int]) -> Candidates:
    """Those with finite corners and an area, cut off where they reach further than one input beyond it."""
    size = np.tile(np.array(input_px, dtype=np.float64), 2)
    corners = np.clip(candidates.corners_px, -size, 2 * size)
    is_box = np.isfinite(candidates.corners_px).all(axis=1) & (corners[:, 2:] > corners[:, :2]).all(axis=1)
    return Candidates(corners, candidates.score, candidates.class_number)[np.flatnonzero(is_box)]
