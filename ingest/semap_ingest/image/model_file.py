"""An ONNX file, opened: what it takes and gives, and how it is run. Nothing else here calls onnxruntime."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.image.tensor import NUMPY_TYPES, ImageInput, Tensor

CPU = "CPUExecutionProvider"
SIZES_INPUT = "orig_target_sizes"
USUAL_SIDE_PX = 640
IMAGE_TYPES = ("float", "float16", "uint8")

WEIGHTS_REMEDY = "Put the file with its weights (.onnx.data or .bin) beside it, under its own name."
VENDOR_REMEDY = (
    "Export it in 32 bit floats and without operators of one vendor, such as TensorRT's suppression, "
    "or choose a provider that has them."
)
# What onnxruntime says, in lower case, and what can be done about it; the first that fits.
REMEDIES = (
    ("external data", WEIGHTS_REMEDY),
    ("external initializer", WEIGHTS_REMEDY),
    ("no op registered", VENDOR_REMEDY),
    ("no opset import for domain", VENDOR_REMEDY),
    ("is not a registered function", VENDOR_REMEDY),
    ("could not find an implementation", VENDOR_REMEDY),
    ("ir version", "Export it with an older onnx, or update onnxruntime."),
    ("opset", "Export it with an older opset (17 is safe), or update onnxruntime."),
    ("protobuf", "Give a whole ONNX file, and not a pointer to one; export other formats to ONNX."),
)
OTHER_REMEDY = "Export it again, and try it in onnxruntime."


@dataclass(frozen=True, eq=False)
class ModelFile:
    """A session with a model.

    where  the file's name, for errors
    """

    where: str
    session: onnxruntime.InferenceSession
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    metadata: Mapping[str, str]

    @classmethod
    def open(cls, path: Path, providers: Sequence[str] = (CPU,), threads: int = 1) -> ModelFile:
        """Load a model.

        threads  for one operator; nothing else runs in parallel
        raises   InvalidInput where there is no such file or provider, or onnxruntime cannot run the model
        """
        if not path.is_file():
            raise InvalidInput(
                f"there is no file {path}", "Check the path; those that were added: semap detector list"
            )
        if threads < 1:
            raise InvalidInput(f"{threads} threads cannot work", "Give at least 1.")
        _require_known(providers)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 4  # what it would log as an error is raised too
        try:
            session = onnxruntime.InferenceSession(str(path), options, providers=list(providers))
        except Exception as error:  # onnxruntime's own errors have no common class
            raise _explained(error, "it cannot be loaded", path.name) from error
        _require_used(providers, session.get_providers(), path.name)
        return cls(
            path.name,
            session,
            tuple(_tensor(each) for each in session.get_inputs()),
            tuple(_tensor(each) for each in session.get_outputs()),
            dict(session.get_modelmeta().custom_metadata_map),
        )

    def run(self, feeds: Mapping[str, NDArray[Any]]) -> list[NDArray[Any]]:
        """All outputs.

        raises  InvalidInput where the model fails
        """
        try:
            outputs: list[NDArray[Any]] = self.session.run(None, dict(feeds))
        except Exception as error:
            raise _explained(error, f"it cannot be run; it has {self.described()}", self.where) from error
        return outputs

    def described(self, outputs: Sequence[Tensor] = ()) -> str:
        """Inputs and outputs, as an error tells them."""
        inputs = ", ".join(str(each) for each in self.inputs)
        return f"inputs {inputs or '(none)'}; outputs {', '.join(str(o) for o in outputs or self.outputs)}"

    def measured(self, arrays: Sequence[NDArray[Any]]) -> tuple[Tensor, ...]:
        """The outputs with the shapes that they have in a run."""
        return tuple(
            Tensor(each.name, each.type, np.shape(array))
            for each, array in zip(self.outputs, arrays, strict=True)
        )

    def image_input(self, size_px: tuple[int, int] | None = None) -> ImageInput:
        """Where the image goes in.

        size_px  width and height for a model that leaves them open; None: as its metadata say, or 640 x 640
        raises   InvalidInput where it takes anything but one image of three colours
        """
        images = [each for each in self.inputs if len(each.shape) == 4]
        others = [each for each in self.inputs if len(each.shape) != 4]
        sizes = [each for each in others if each.name == SIZES_INPUT and each.type in NUMPY_TYPES]
        if len(images) != 1 or len(sizes) != len(others) or len(sizes) > 1:
            raise self._unfit("it does not take one image and nothing else", "Give a detector of images.")
        image = images[0]
        if image.type not in IMAGE_TYPES:
            raise self._unfit(f"its image is of {image.type}", f"Export it with {', '.join(IMAGE_TYPES)}.")
        batch, *sides = image.sizes
        if batch not in (1, -1):
            raise self._unfit(f"it takes {batch} images at once", "Export it with a batch of 1.")
        if sides[0] != 3 and sides[2] != 3:
            raise self._unfit(
                "its input has no dimension of three colours", "Export it with a fixed channel count."
            )
        is_channels_first = sides[0] == 3
        height, width = sides[1:] if is_channels_first else sides[:2]
        return ImageInput(
            image.name,
            NUMPY_TYPES[image.type],
            self._size((width, height), size_px),
            is_channels_first,
            sizes[0] if sizes else None,
        )

    def _size(self, own_px: tuple[int, int], wanted_px: tuple[int, int] | None) -> tuple[int, int]:
        usual = wanted_px or _size_in(self.metadata) or (USUAL_SIDE_PX, USUAL_SIDE_PX)
        if min(usual) < 1:
            raise InvalidInput(f"an input of {usual[0]} x {usual[1]} px", "Give a size above zero.")
        size = tuple(own if own > 0 else other for own, other in zip(own_px, usual, strict=True))
        if wanted_px and size != tuple(wanted_px):
            raise self._unfit(
                f"its input is not {wanted_px[0]} x {wanted_px[1]} px",
                "Leave size_px out: the model's size is fixed.",
            )
        return size[0], size[1]

    def _unfit(self, message: str, remedy: str) -> InvalidInput:
        return InvalidInput(f"{message}; it has {self.described()}", remedy, self.where)


def _require_known(providers: Sequence[str]) -> None:
    available = onnxruntime.get_available_providers()
    absent = [each for each in providers if each not in available]
    if absent or not providers:
        asked = absent[0] if absent else "no provider"
        raise InvalidInput(
            f"this onnxruntime does not have {asked}; it has {', '.join(available)}", _remedy_for(asked)
        )


def _require_used(asked: Sequence[str], used: Sequence[str], where: str) -> None:
    """onnxruntime goes on with the CPU where a device cannot be had; who asked for the device should know."""
    idle = [each for each in asked if each not in used]
    if idle:
        raise InvalidInput(
            f"{idle[0]} found no device that it can use, only {', '.join(used)}",
            _remedy_for(idle[0]),
            where,
        )


def _remedy_for(provider: str) -> str:
    if "CUDA" in provider or "Tensorrt" in provider:
        return (
            "Install onnxruntime-gpu in place of onnxruntime, with the CUDA and cuDNN that it asks for, on a "
            f"machine with a device that nvidia-smi lists; or use {CPU}."
        )
    return f"Install the onnxruntime that has it, or use {CPU}."


def _tensor(argument: onnxruntime.NodeArg) -> Tensor:
    return Tensor(
        argument.name, argument.type.removeprefix("tensor(").removesuffix(")"), tuple(argument.shape)
    )


def _size_in(metadata: Mapping[str, str]) -> tuple[int, int] | None:
    """Width and height from the `imgsz` of YOLO exports, which is [height, width]."""
    try:
        height, width = ast.literal_eval(metadata.get("imgsz", ""))
    except (ValueError, SyntaxError, TypeError):
        return None
    return (width, height) if isinstance(width, int) and isinstance(height, int) else None


def _explained(error: Exception, message: str, where: str) -> InvalidInput:
    said = str(error)
    remedy = next((text for words, text in REMEDIES if words in said.lower()), OTHER_REMEDY)
    return InvalidInput(f"{message}: {said.splitlines()[0] if said else type(error).__name__}", remedy, where)
