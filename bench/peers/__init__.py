"""Other ways to answer what semap's triggers answer: in which rooms each track begins and ends to be.

Each module of this folder is a peer and is measured because it is there (bench/side_by_side.py). It offers

    begin(dsn: str, crowd: Crowd, frames: int) -> AbstractContextManager[Peer]

which gets ready for the crowd, takes in the first round, of so many frames, to warm up, and cleans up at the
end. `dsn` is a migrated database of semap's, for peers that want PostGIS: they make a schema of their own,
commit each frame durably, and drop the schema at the end. What a peer needs and does not find is a
PeerMissing, which becomes a row of the table.

The rounds are fed in order, each once and of as many frames. A frame is one batch. Making the batches,
starting up and compiling are no part of the seconds that a peer tells; everything from the first state handed
over to the last change found is. The changes are read after that.

A room holds a place as ST_Contains says: its boundary is outside.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bench.crowd import Crowd

Changes = NDArray[np.int64]
"""(n, 4), ascending: id of the track, number of the room, 1 for began or 0 for ended, stamp [us]."""


class PeerMissing(Exception):
    """What a peer needs is not here; the message says what."""


@dataclass(frozen=True)
class Fed:
    """What came of some frames.

    seconds  from the first state handed over to the last change found
    """

    seconds: float
    changes: Changes


@dataclass(frozen=True)
class Named:
    """What a peer is called in the table.

    slower  ways that were tried and not taken: states/s in half of a round, or why it does not work
    """

    title: str
    slower: Mapping[str, float | str] = field(default_factory=dict)


class Peer(Protocol):
    """A peer at work."""

    @property
    def named(self) -> Named: ...

    @property
    def begun(self) -> Changes:
        """What was found in the first round."""
        ...

    def feed(self, first: int, count: int) -> Fed:
        """Take in a round: the frames from number `first` on."""
        ...


class Module(Protocol):
    def begin(self, dsn: str, crowd: Crowd, frames: int) -> AbstractContextManager[Peer]: ...


def peers() -> dict[str, Module]:
    """All peers by the names of their files."""
    found = sorted(module.name for module in pkgutil.iter_modules(__path__))
    return {name: importlib.import_module(f"{__name__}.{name}") for name in found}


def ordered(rows: Sequence[Sequence[int]] | NDArray[np.int64]) -> Changes:
    """Changes in any order, made ascending."""
    changes = np.asarray(rows, dtype=np.int64).reshape(-1, 4)
    return changes[np.lexsort(changes.T[::-1])]
