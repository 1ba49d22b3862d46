"""The tree of frames over time: where any frame was in any other, as ROS's tf2 answers it.

Each frame has one parent at a time, and its poses in it are stamped; a static one holds always. An answer
goes from the child up to the nearest ancestor that both frames have, and from there down to the parent, with
every pose interpolated at the very stamp (linear and slerp). Nothing is extrapolated: where a pose on the way
does not cover the stamp, the answer is why.

Transforms may come in any order: those of the last `keep_us` of each frame are kept, sorted by stamp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.timeline.stamp import to_datetime
from semap_ingest.frames.edge import Edge, Missing, Placed
from semap_ingest.frames.rigid import inverse
from semap_ingest.sensing.transform import Transform

__all__ = ["Missing", "TransformBuffer"]

KEEP_US = 10_000_000
"""As in tf2."""


@dataclass(frozen=True)
class Chain:
    """The edges from two frames up to their nearest common ancestor."""

    of_parent: tuple[Edge, ...]
    of_child: tuple[Edge, ...]


class TransformBuffer:
    """Mutable: transforms go in, matrices come out.

    keep_us    how far back from its newest transform each frame's place is remembered
    needed_us  a stamp from which on it is remembered in any case
    """

    def __init__(self, keep_us: int = KEEP_US) -> None:
        self._keep_us = keep_us
        self.needed_us: int | None = None
        self._edges: dict[str, Edge] = {}
        self._frames: set[str] = set()
        self._reparented: set[str] = set()
        self._chains: dict[tuple[str, str], Chain | None] = {}

    def add(self, transform: Transform) -> bool:
        """Whether it was kept: not one that is too old, nor a stamped one of a frame that is static.

        raises  InvalidInput for a frame in itself, one without a name, and for a pose that is none
        """
        parent, child = transform.parent, transform.child
        placed = _placed(transform)
        edge = self._edges.get(child)
        if edge is None:
            edge = self._edges[child] = Edge(self._keep_us)
        before = edge.parents.keys() | set()
        if transform.is_static:
            edge.fix(placed)
            is_kept = True
        else:
            is_kept = edge.insert(transform.stamp_us, placed, self.needed_us)
        if edge.parents.keys() != before:
            self._frames.update((parent, child))
            self._chains.clear()
            (self._reparented.add if len(edge.parents) > 1 else self._reparented.discard)(child)
        return is_kept

    def lookup(self, parent: str, child: str, stamp_us: int) -> NDArray[np.float64] | Missing:
        """(4, 4) parent_T_child at the stamp, or why it is not known.

        Where transforms are missing on both sides of the stamp, it is TOO_EARLY: only a late one can help.
        """
        if parent == child:
            return np.eye(4)
        if parent not in self._frames or child not in self._frames:
            return Missing.UNKNOWN_FRAME
        chain = self._chain(parent, child, stamp_us)
        if chain is None:
            return Missing.NOT_CONNECTED
        ancestor_T_child = _product(chain.of_child, stamp_us)
        ancestor_T_parent = _product(chain.of_parent, stamp_us)
        if isinstance(ancestor_T_child, Missing):
            return Missing.TOO_EARLY if ancestor_T_parent is Missing.TOO_EARLY else ancestor_T_child
        if isinstance(ancestor_T_parent, Missing):
            return ancestor_T_parent
        return inverse(ancestor_T_parent) @ ancestor_T_child if chain.of_parent else ancestor_T_child

    def top_below(self, frame: str, end: str, stamp_us: int) -> str:
        """The last on the way up from a frame, or the one before `end` where that is on it."""
        way = self._ancestors(frame, stamp_us)
        return way[way.index(end) - 1] if end in way[1:] else way[-1]

    def why_missing(self, parent: str, child: str, stamp_us: int) -> str:
        """Why `lookup` gives no matrix, for people."""
        if not child:
            return "its messages name no frame (their header's frame_id is empty)"
        for frame in (child, parent):
            if frame not in self._frames:
                return f"no transform names the frame {frame!r}"
        ways = self._ancestors(child, stamp_us), self._ancestors(parent, stamp_us)
        common = next((frame for frame in ways[0] if frame in ways[1]), None)
        if common is None:
            tops = ways[0][-1], ways[1][-1]
            return f"transforms lead from {child!r} up to {tops[0]!r}, and from {parent!r} up to {tops[1]!r}"
        for way in ways:
            for frame in way[: way.index(common)]:
                edge = self._edges[frame]
                span_us = edge.span_us()
                if span_us is not None and isinstance(edge.at(stamp_us), Missing):
                    return _outside(edge.parent_at(stamp_us), frame, span_us)
        return "transforms came too late"

    def _chain(self, parent: str, child: str, stamp_us: int) -> Chain | None:
        """Remembered as long as no frame has changed its parent within what is kept."""
        if self._reparented:
            return self._walk(parent, child, stamp_us)
        if (parent, child) not in self._chains:
            self._chains[parent, child] = self._walk(parent, child, stamp_us)
        return self._chains[parent, child]

    def _walk(self, parent: str, child: str, stamp_us: int) -> Chain | None:
        from_parent, from_child = self._ancestors(parent, stamp_us), self._ancestors(child, stamp_us)
        common = next((frame for frame in from_child if frame in from_parent), None)
        if common is None:
            return None
        return Chain(
            *(
                tuple(self._edges[frame] for frame in way[: way.index(common)])
                for way in (from_parent, from_child)
            )
        )

    def _ancestors(self, frame: str, stamp_us: int) -> list[str]:
        """The frame, its parent, and so on; it ends where a frame would come again."""
        way = [frame]
        while (edge := self._edges.get(way[-1])) and (above := edge.parent_at(stamp_us)) not in way:
            way.append(above)
        return way


def _outside(parent: str, child: str, span_us: tuple[int, int]) -> str:
    first, last = (to_datetime(each).isoformat() for each in span_us)
    if first == last:
        return (
            f"the transform from {parent!r} to {child!r} was sent once, for {first}, and holds at no other"
            " time; one that always holds belongs on /tf_static"
        )
    return f"the transform from {parent!r} to {child!r} is known from {first} to {last} only"


def _placed(transform: Transform) -> Placed:
    x, y, z = (float(part) for part in transform.translation_m)
    qx, qy, qz, qw = (float(part) for part in transform.quaternion)
    length = math.hypot(qx, qy, qz, qw)
    where = f"transform from {transform.child!r} to {transform.parent!r}"
    if not transform.parent or not transform.child or transform.parent == transform.child:
        raise InvalidInput("a frame needs a parent other than itself", "Name both frames.", where)
    if not (math.isfinite(x + y + z) and 0 < length < math.inf):
        raise InvalidInput(
            f"translation {(x, y, z)}, quaternion {(qx, qy, qz, qw)}",
            "Give finite metres and a quaternion of length 1.",
            where,
        )
    return Placed(transform.parent, (x, y, z), (qx / length, qy / length, qz / length, qw / length))


def _product(edges: tuple[Edge, ...], stamp_us: int) -> NDArray[np.float64] | Missing:
    """(4, 4) ancestor_T_frame; of several edges without a pose, one that is too early counts."""
    ancestor_T_frame: NDArray[np.float64] | None = None
    missing: Missing | None = None
    for edge in edges:
        pose = edge.at(stamp_us)
        if isinstance(pose, Missing):
            missing = pose if missing is not Missing.TOO_EARLY else missing
        elif missing is None:
            ancestor_T_frame = pose if ancestor_T_frame is None else pose @ ancestor_T_frame
    if missing is not None:
        return missing
    return np.eye(4) if ancestor_T_frame is None else ancestor_T_frame
