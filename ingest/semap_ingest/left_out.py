"""Rows of a table that cannot be used: left out, counted, and told with file, line and remedy.

One policy holds for every table that comes row by row, CSV or Parquet, of tracks or of objects: a bad row
spoils no other row. A file without a usable row is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semap.errors import InvalidInput

TOLD = 20
MEND_IT = "Mend the row, or remove it."


@dataclass(frozen=True)
class LeftOut:
    """How many rows were left out, and a sentence about each of the first of them."""

    count: int = 0
    told: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """The sentences, and how many more there are."""
        more = self.count - len(self.told)
        return [*self.told, *([f"and {more} more"] if more else [])]


NOTHING = LeftOut()


class Flaws:
    """Mutable: what is wrong with which rows.

    places  the number of each row in its file, (n,)
    word    what that is a number of: line or row
    """

    def __init__(self, file: str, places: NDArray[np.int64], word: str) -> None:
        self._file = file
        self._places = places
        self._word = word
        self._found: list[tuple[NDArray[np.bool_], Callable[[int], str], str]] = []

    def add(self, is_bad: ArrayLike, why: Callable[[int], str], remedy: str = MEND_IT) -> None:
        """These rows cannot be used.

        is_bad  (n,) bool
        why     says it of one of them
        """
        bad = np.asarray(is_bad, dtype=np.bool_)
        if bad.any():
            self._found.append((bad, why, remedy))

    @property
    def is_usable(self) -> NDArray[np.bool_]:
        """(n,)"""
        usable = np.ones(len(self._places), dtype=np.bool_)
        for bad, _, _ in self._found:
            usable &= ~bad
        return usable

    def place(self, row: int) -> str:
        """Where a row is."""
        return f"{self._file}, {self._word} {self._places[row]}"

    def left_out(self) -> LeftOut:
        """raises InvalidInput where no row is left"""
        rows = np.flatnonzero(~self.is_usable)
        rows = rows[np.argsort(self._places[rows], kind="stable")]
        said = LeftOut(len(rows), tuple(self._sentence(int(row)) for row in rows[:TOLD]))
        if len(rows) == len(self._places):
            raise InvalidInput(
                "\n  ".join([f"none of its {len(rows)} rows can be used", *said.lines()]),
                "Correct the rows, or describe the file by options: see --help.",
                self._file,
            )
        return said

    def _sentence(self, row: int) -> str:
        why, remedy = next((why, remedy) for bad, why, remedy in self._found if bad[row])
        return f"{self.place(row)}: {why(row)}. {remedy}"
