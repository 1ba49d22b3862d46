"""What a decoder makes of a network's outputs, before boxes of the same thing are made one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.floating[Any]]
Outputs = Sequence[NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Choice:
    """What the detector is asked for.

    classes      (k,) numbers of the wanted classes; None: all
    class_count  of the model; None where it does not tell
    input_px     width and height of the model's input
    """

    classes: NDArray[np.int64] | None
    class_count: int | None
    min_score: float
    input_px: tuple[int, int]

    def allows(self, classes: NDArray[np.int64], score: Numbers) -> NDArray[np.bool_]:
        """(n,), which are wanted and good enough; NaN never is."""
        good: NDArray[np.bool_] = score >= self.min_score
        return good if self.classes is None else good & np.isin(classes, self.classes)


@dataclass(frozen=True, eq=False)
class Candidates:
    """corners_px (n, 4) x_min, y_min, x_max, y_max [px of the input], score (n,), class_number (n,)"""

    corners_px: NDArray[np.float64]
    score: NDArray[np.float64]
    class_number: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.score)

    def __getitem__(self, rows: NDArray[Any]) -> Candidates:
        return Candidates(self.corners_px[rows], self.score[rows], self.class_number[rows])


@dataclass(frozen=True, eq=False)
class Best:
    """Those places of a network whose best class is wanted and scores enough.

    rows          (n,) which places
    score         (n,)
    class_number  (n,)
    """

    rows: NDArray[np.int64]
    score: NDArray[np.float64]
    class_number: NDArray[np.int64]

    def boxed(self, corners_px: Numbers) -> Candidates:
        """corners_px  (n, 4) [px of the input]"""
        return Candidates(corners_px.astype(np.float64), self.score, self.class_number)


def best_classes(scores: Numbers, choice: Choice) -> Best:
    """The best class of each place, where that one is wanted.

    scores  (classes, places)
    """
    wanted = scores if choice.classes is None else scores[choice.classes]
    rows = np.flatnonzero((wanted >= choice.min_score).any(axis=0))
    few = scores[:, rows]
    number = few.argmax(axis=0)
    score = few[number, np.arange(len(rows))]
    kept = choice.allows(number, score)
    return Best(rows[kept], score[kept].astype(np.float64), number[kept])


def best_of_present(presence: Numbers, classes: Numbers, choice: Choice) -> Best:
    """The same, where a score is that of anything being there times that of what it is.

    presence  (places,) 0 to 1
    classes   (places, classes) 0 to 1
    """
    there = np.flatnonzero(presence >= choice.min_score)
    best = best_classes((presence[there, None] * classes[there]).T, choice)
    return Best(there[best.rows], best.score, best.class_number)


def corners_around(centre_size: Numbers) -> Numbers:
    """(n, 4) centre x, y, width, height  ->  (n, 4) x_min, y_min, x_max, y_max"""
    centre, half = centre_size[:, :2], centre_size[:, 2:4] / 2
    return np.concatenate([centre - half, centre + half], axis=1)


def corners_of_input(choice: Choice) -> NDArray[np.float64]:
    """(4,) width, height, width, height of the input: what normalised corners are multiplied with"""
    return np.tile(np.array(choice.input_px, dtype=np.float64), 2)
