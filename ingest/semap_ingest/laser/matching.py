"""The pairs of a graph that are together worth most, no end in two of them (maximum weight matching).

Dynamic programming over the ends, one after the other: each stays alone or takes one that is still to come.
A state is which of those to come are taken, and of the ways that lead to it the worthiest is kept. In the
order of Cuthill and McKee (1969) neighbours come soon after one another, so that there are few states at a
time, and but one where nothing leads from one group of ends to the next. Beyond MOST_STATES the worthiest go
on: up to that the result is exact, and the time is in proportion to the number of pairs in any case.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

Indices = NDArray[np.int64]
Chain = tuple[int, "Chain"] | None
"""The pairs that were taken, the last first."""

MOST_STATES = 64


def worthiest_matching(pairs: Indices, worth: NDArray[np.float64]) -> Indices:
    """Which rows of pairs (k, 2) are chosen, ascending.

    worth  (k,) above zero; what is not is never chosen
    """
    if not len(pairs):
        return np.empty(0, np.int64)
    # what a taken end could have been worth at most, so that states are compared fairly
    taken_worth = float(worth.max()) / 2
    states: dict[int, tuple[float, Chain]] = {0: (0.0, None)}
    for options in _options(pairs, worth):
        following: dict[int, tuple[float, Chain]] = {}
        for taken, (total, chain) in states.items():
            rest = taken >> 1
            ways = [(rest, total, chain)]
            if not taken & 1:
                ways += [
                    (rest | other, total + gain, (row, chain))
                    for other, gain, row in options
                    if not rest & other
                ]
            for state, value, way in ways:
                if state not in following or following[state][0] < value:
                    following[state] = (value, way)
        if len(following) > MOST_STATES:
            fairly = sorted(
                following, key=lambda state: following[state][0] - taken_worth * state.bit_count()
            )
            following = {state: following[state] for state in fairly[-MOST_STATES:]}
        states = following
    _, chain = states[0]
    return _rows(chain)


def _options(pairs: Indices, worth: NDArray[np.float64]) -> list[list[tuple[int, float, int]]]:
    """For each end in its turn, with whom of those to come it may pair: the other's bit, counted from the
    next end on, what that is worth, and the row of the pair.
    """
    ends, of_pair = np.unique(pairs, return_inverse=True)
    of_pair = of_pair.reshape(-1, 2)
    rows, columns = np.vstack([of_pair, of_pair[:, ::-1]]).T
    meets = csr_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(len(ends), len(ends)))
    turn = np.empty(len(ends), np.int64)
    turn[reverse_cuthill_mckee(meets, symmetric_mode=True)] = np.arange(len(ends))
    options: list[list[tuple[int, float, int]]] = [[] for _ in ends]
    for row, (first, second) in enumerate(np.sort(turn[of_pair], axis=1).tolist()):
        if worth[row] > 0:
            options[first].append((1 << (second - first - 1), float(worth[row]), row))
    return options


def _rows(chain: Chain) -> Indices:
    rows = []
    while chain is not None:
        row, chain = chain
        rows.append(row)
    return np.sort(np.array(rows, np.int64))
