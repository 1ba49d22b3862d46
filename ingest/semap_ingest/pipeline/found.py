"""What the pipeline makes of one record."""

from __future__ import annotations

from dataclasses import dataclass

from semap_ingest.sensing.lines import Lines
from semap_ingest.sensing.track_states import TrackStates


@dataclass(frozen=True, eq=False)
class PersonsAt:
    """sent_us  when the last of the records was sent that made these states [us, clock of the recording]"""

    states: TrackStates
    sent_us: int


@dataclass(frozen=True, eq=False)
class LinesAt:
    """z_m  the height of the laser over the map's origin"""

    lines: Lines
    z_m: float
    sent_us: int


@dataclass(frozen=True, eq=False)
class Found:
    """Results in the order of their stamps, and up to where there are no more to come.

    *_watermark_us  no result with a stamp at or before it comes after this; None: nothing is known yet
    """

    persons: tuple[PersonsAt, ...] = ()
    lines: tuple[LinesAt, ...] = ()
    persons_watermark_us: int | None = None
    lines_watermark_us: int | None = None
