"""The log as a picture: for each room and each door what held when, and the events above it.

Rooms show who was in them, one bar for each stay; doors when they were open. After Fig. 6 of the paper
"Detecting spatio-temporal Relations by Combining a Semantic Map with a Stream Processing Engine".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from semap.errors import InvalidInput
from semap.model.event_log import Lane, Mark, Stay
from semap.picture.figure import FAINT, INK, OPEN, color_of, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_LANES = 60
MOST_DRAWN = 5_000
"""Bars and events; more cannot be told apart, and take minutes."""

BAR, ROW, GAP, LABEL = 0.5, 0.58, 0.55, 0.62
"""Heights of a bar, of a row of bars, of the space between lanes, and of a line of events."""

WIDTH_PX = 1000
TO_THE_LEFT = 0.15
"""In this last share of a picture, what is written of an event stands before it."""


@dataclass(frozen=True)
class _Packed:
    """A lane with each stay and each mark in the lowest row where it covers no other."""

    lane: Lane
    stays: tuple[tuple[int, Stay], ...]
    marks: tuple[tuple[int, Mark], ...]
    stay_rows: int
    mark_rows: int

    @property
    def height(self) -> float:
        return max(1, self.stay_rows) * ROW + self.mark_rows * LABEL + GAP


def draw_timeline(lanes: Sequence[Lane], start: datetime, end: datetime, title: str, path: Path) -> None:
    """Draw what happened from `start` to `end` into an SVG, PNG or PDF file.

    raises InvalidInput for another format, without matplotlib, or for more than fits a picture
    """
    if len(lanes) > MOST_LANES:
        raise InvalidInput(
            f"{len(lanes)} rooms and doors; at most {MOST_LANES} fit a picture",
            "Ask for a shorter time, or for some of them.",
        )
    drawn = sum(len(lane.stays) + len(lane.marks) for lane in lanes)
    if drawn > MOST_DRAWN:
        raise InvalidInput(
            f"{drawn} bars and events; at most {MOST_DRAWN} fit a picture",
            "Ask for a shorter time, or for the events of one rule.",
        )
    first, last = _days(start), _days(end)
    day_px = WIDTH_PX / max(last - first, 1e-9)
    packed = [_pack(lane, last, day_px) for lane in lanes]
    height = sum(each.height for each in packed)
    figure = new_figure(13, 1.3 + 0.3 * height, path)
    axes = figure.add_subplot()
    top = height
    ticks = []
    for n, each in enumerate(packed):
        ticks.append(_draw_lane(axes, each, top, first, last, shaded=n % 2 == 0))
        top -= each.height
    _draw_frame(axes, ticks, packed, first, last, height)
    axes.set_title(title, loc="left", fontsize=12, color=INK, pad=10)
    save(figure, path)


def _pack(lane: Lane, last: float, day_px: float) -> _Packed:
    stays = sorted(lane.stays, key=lambda stay: (stay.start, stay.who))
    marks = sorted(lane.marks, key=lambda mark: (mark.stamp, mark.text))
    stay_rows = _rows([(_days(stay.start), _days(stay.end) if stay.end else last) for stay in stays])
    spans = [(_days(mark.stamp), _days(mark.stamp) + (len(mark.text) * 6 + 14) / day_px) for mark in marks]
    mark_rows = _rows(spans)
    return _Packed(
        lane,
        tuple(zip(stay_rows, stays, strict=True)),
        tuple(zip(mark_rows, marks, strict=True)),
        max(stay_rows, default=-1) + 1,
        max(mark_rows, default=-1) + 1,
    )


def _rows(spans: Sequence[tuple[float, float]]) -> list[int]:
    """The lowest free row for each span; the spans ascend."""
    ends: list[float] = []
    rows = []
    for start, end in spans:
        row = next((n for n, busy_until in enumerate(ends) if busy_until <= start), len(ends))
        ends[row : row + 1] = [end]
        rows.append(row)
    return rows


def _draw_lane(axes: Axes, packed: _Packed, top: float, first: float, last: float, shaded: bool) -> float:
    """Draw one lane below `top`; returns the height at which its name stands."""
    floor = top - packed.height
    if shaded:
        axes.axhspan(floor, top, color="#f6f8fa", zorder=0)
    base = floor + GAP / 2
    for row, stay in packed.stays:
        left, right = max(_days(stay.start), first), min(_days(stay.end) if stay.end else last, last)
        if right < left:
            continue
        color = OPEN if packed.lane.is_door else color_of(stay.who)
        y = base + row * ROW + BAR / 2
        axes.barh(y, right - left, BAR, left=left, color=color, alpha=0.3, edgecolor=color, linewidth=1)
        axes.text(left, y, f" {stay.who}", va="center", fontsize=7.5, color=INK, clip_on=True)
    above = base + max(1, packed.stay_rows) * ROW
    for row, mark in packed.marks:
        x, y = _days(mark.stamp), above + row * LABEL + LABEL / 2
        axes.plot([x, x], [base, y], color=INK, linewidth=0.7, alpha=0.55)
        axes.plot([x], [y], marker="o", markersize=4, color=INK)
        is_late = x > last - (last - first) * TO_THE_LEFT
        axes.annotate(
            mark.text,
            (x, y),
            (-5 if is_late else 5, 0),
            textcoords="offset points",
            ha="right" if is_late else "left",
            va="center",
            fontsize=7.5,
            color=INK,
            annotation_clip=True,
        )
    return base + max(1, packed.stay_rows) * ROW / 2


def _draw_frame(
    axes: Axes, ticks: Sequence[float], packed: Sequence[_Packed], first: float, last: float, height: float
) -> None:
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter  # noqa: PLC0415

    locator = AutoDateLocator(tz=UTC)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=UTC))  # type: ignore[no-untyped-call]
    axes.set_yticks(ticks, [each.lane.name for each in packed], fontsize=9, color=INK)
    axes.set_xlim(first, last)
    axes.set_ylim(0, max(height, 1))
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", colors=INK, labelsize=8)
    axes.grid(axis="x", color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(FAINT)
    axes.set_xlabel("UTC", fontsize=8, color=INK)


def _days(stamp: datetime) -> float:
    """Days since 1970, as matplotlib counts time."""
    return stamp.timestamp() / 86_400
