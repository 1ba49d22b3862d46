"""What a model calls its classes."""

from __future__ import annotations

import ast
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput

# The 80 of the COCO detection task in the order of their ids (Lin et al. 2014), which has become usual.
COCO_TEXT = """
person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, stop sign,
parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, backpack, umbrella,
handbag, tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball bat, baseball glove, skateboard,
surfboard, tennis racket, bottle, wine glass, cup, fork, knife, spoon, bowl, banana, apple, sandwich, orange,
broccoli, carrot, hot dog, pizza, donut, cake, chair, couch, potted plant, bed, dining table, toilet, tv,
laptop, mouse, remote, keyboard, cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase,
scissors, teddy bear, hair drier, toothbrush
"""
COCO = tuple(name.strip() for name in COCO_TEXT.split(","))
COCO_GAPS = frozenset((12, 26, 29, 30, 45, 66, 68, 69, 71, 83))
"""Ids of categories of COCO that were never used; the 80 have the others up to 90."""


def _by_id() -> tuple[str, ...]:
    """91 names: that of each id, and the id itself where there is none."""
    ids = [number for number in range(1, 91) if number not in COCO_GAPS]
    named = dict(zip(ids, COCO, strict=True))
    return tuple(named.get(number, str(number)) for number in range(91))


USUAL = {len(names): names for names in (COCO, _by_id(), _by_id()[1:])}
"""By how many classes a model has: COCO's 80, its ids, and its ids from 1."""


@dataclass(frozen=True)
class ClassNames:
    """names  of the classes in the order of their numbers; None: they have no names but their numbers"""

    names: tuple[str, ...] | None

    def numbers(self, wanted: Collection[str], where: str = "") -> NDArray[np.int64]:
        """Those classes that are wanted, ascending; raises InvalidInput for one that there is not."""
        if self.names is None:
            named = sorted(name for name in wanted if not name.isdecimal())
            if named:
                raise InvalidInput(
                    f"its classes have no names, so that there is no {named[0]!r}",
                    "Name them in a file, one in each line: --camera-classes FILE.",
                    where,
                )
            return np.array(sorted({int(name) for name in wanted}), dtype=np.int64)
        absent = sorted(set(wanted) - set(self.names))
        if absent:
            raise InvalidInput(
                f"there is no class {absent[0]!r}", f"The classes are: {', '.join(self.names)}.", where
            )
        return np.array([i for i, name in enumerate(self.names) if name in wanted], dtype=np.int64)

    def labels(self, numbers: NDArray[np.int64]) -> tuple[str, ...]:
        """The names of classes; of a number beyond the names, the number."""
        names = self.names or ()
        return tuple(names[i] if 0 <= i < len(names) else str(i) for i in numbers.tolist())


def given_names(names: str | Path | Sequence[str] | None) -> tuple[str, ...] | None:
    """The names from a list, or from a file with one in each line.

    raises InvalidInput where the file cannot be read or holds none
    """
    if names is None:
        return None
    if not isinstance(names, str | Path):
        listed = tuple(names)
    else:
        try:
            lines = Path(names).read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidInput(
                f"the class names cannot be read: {error}", "Give a text file with one name in a line."
            ) from error
        listed = tuple(line.strip() for line in lines if line.strip())
    if not listed:
        raise InvalidInput("there is no class name", "Give at least one, or leave --camera-classes out.")
    return listed


def names_in(metadata: Mapping[str, str]) -> tuple[str, ...] | None:
    """The names that YOLO exports carry: `{0: 'person', 1: ...}` or a list; None where none can be read."""
    try:
        value = ast.literal_eval(metadata.get("names", ""))
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None
    if isinstance(value, dict) and sorted(value, key=str) == sorted(range(len(value)), key=str):
        value = [value[i] for i in range(len(value))]
    if isinstance(value, list | tuple) and value and all(isinstance(name, str) for name in value):
        return tuple(value)
    return None
