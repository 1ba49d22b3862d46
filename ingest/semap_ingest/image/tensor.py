"""What a model takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

NUMPY_TYPES: dict[str, type[np.generic]] = {
    "float": np.float32,
    "float16": np.float16,
    "double": np.float64,
    "uint8": np.uint8,
    "int32": np.int32,
    "int64": np.int64,
}


@dataclass(frozen=True)
class Tensor:
    """An input or output.

    type   ONNX's word for it, such as float or int64
    shape  with a name or None for what varies
    """

    name: str
    type: str
    shape: tuple[int | str | None, ...]

    def __str__(self) -> str:
        return f"{self.name} {self.type}[{', '.join('?' if d is None else str(d) for d in self.shape)}]"

    @property
    def sizes(self) -> tuple[int, ...]:
        """The shape, -1 for what varies."""
        return tuple(d if isinstance(d, int) else -1 for d in self.shape)


@dataclass(frozen=True)
class ImageInput:
    """Where the image goes in.

    size_px      width and height
    sizes_input  asks for the image's width and height, in models that scale boxes by themselves
    """

    name: str
    dtype: type[np.generic]
    size_px: tuple[int, int]
    is_channels_first: bool
    sizes_input: Tensor | None = None

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Without the batch."""
        width, height = self.size_px
        return (3, height, width) if self.is_channels_first else (height, width, 3)

    @cached_property
    def constant_feeds(self) -> dict[str, Any]:
        """What goes into the other inputs: the size of the input itself, so that boxes are in px of that."""
        if self.sizes_input is None:
            return {}
        return {self.sizes_input.name: np.array([self.size_px], dtype=NUMPY_TYPES[self.sizes_input.type])}
