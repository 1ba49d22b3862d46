"""The way of a track in pieces, cut and measured. Between two states it is on a line, at one speed.

A piece has at most `LONGEST_PIECE` states, ends where the track was lost, and shares its last state with the
next one. It is known by the stamp of its first state, so that each state begins a piece of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import accumulate, pairwise
from typing import Literal, TypeAlias

from semap.model.track_state import TrackState

LONGEST_PIECE = 1000

Piece: TypeAlias = tuple[TrackState, ...]
Quantity: TypeAlias = Literal["distance", "velocity", "acceleration"]

UNITS: dict[Quantity, str] = {"distance": "MTR", "velocity": "MTS", "acceleration": "MSK"}
"""By UN/CEFACT's recommendation 20."""


@dataclass(frozen=True)
class Values:
    """A quantity at each of the stamps; `Step` holds until the next one."""

    stamps: tuple[datetime, ...]
    values: tuple[float, ...]
    interpolation: Literal["Linear", "Step"]


def pieces(states: Sequence[TrackState]) -> Iterator[Piece]:
    """States in their order, in pieces."""
    piece: list[TrackState] = []
    for each in states:
        if piece and piece[-1].is_last:
            yield tuple(piece)
            piece = []
        elif len(piece) == LONGEST_PIECE:
            yield tuple(piece)
            piece = piece[-1:]
        piece.append(each)
    if piece:
        yield tuple(piece)


def between(before: TrackState, after: TrackState | None, stamp: datetime) -> TrackState | None:
    """Where a track was at a time; None where it was lost, or has not been seen since."""
    if before.stamp == stamp:
        return before
    if before.is_last or after is None:
        return None
    part = (stamp - before.stamp) / (after.stamp - before.stamp)
    has_heights = before.z_m is not None and after.z_m is not None
    return replace(
        before,
        stamp=stamp,
        x_m=before.x_m + part * (after.x_m - before.x_m),
        y_m=before.y_m + part * (after.y_m - before.y_m),
        z_m=_middle(before.z_m, after.z_m, part) if has_heights else None,
        speed_mps=_middle(before.speed_mps, after.speed_mps, part),
        is_last=False,
    )


def cut(states: Sequence[TrackState], start: datetime, end: datetime) -> tuple[TrackState, ...]:
    """The way from `start` to `end`, which may lie between two states each."""
    found: dict[datetime, TrackState] = {}
    for before, after in pairwise(states):
        for stamp in (start, end):
            if before.stamp <= stamp <= after.stamp and (at := between(before, after, stamp)) is not None:
                found[stamp] = at
    found |= {each.stamp: each for each in states if start <= each.stamp <= end}
    return tuple(found[stamp] for stamp in sorted(found))


def measured(piece: Piece, quantity: Quantity) -> Values:
    """How far [m] a track came since the piece began, how fast [m/s], or how much faster [m/s2]."""
    stamps = tuple(each.stamp for each in piece)
    lengths_m = [_distance_m(a, b) for a, b in pairwise(piece)]
    if quantity == "distance":
        return Values(stamps, tuple(accumulate(lengths_m, initial=0.0)), "Linear")
    durations_s = [(b.stamp - a.stamp).total_seconds() for a, b in pairwise(piece)]
    speeds_mps = _held([length / time for length, time in zip(lengths_m, durations_s, strict=True)])
    if quantity == "velocity":
        return Values(stamps, tuple(speeds_mps), "Step")
    gains = [(b - a) / time for (a, b), time in zip(pairwise(speeds_mps), durations_s, strict=True)]
    return Values(stamps, tuple(_held(gains)), "Step")


def _held(values: list[float]) -> list[float]:
    """Of each stretch, and once more for the end of the last one."""
    return [*values, values[-1] if values else 0.0]


def _distance_m(a: TrackState, b: TrackState) -> float:
    rise_m = 0.0 if a.z_m is None or b.z_m is None else b.z_m - a.z_m
    return math.hypot(b.x_m - a.x_m, b.y_m - a.y_m, rise_m)


def _middle(a: float | None, b: float | None, part: float) -> float | None:
    return None if a is None or b is None else a + part * (b - a)
