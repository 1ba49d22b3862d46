"""The pictures of an evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from semap_service.evaluation.matching import Occurrence, Scores

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LABEL, FOUND, WRONG = "#9aa5b1", "#1f77b4", "#d62728"
MARKS = {
    "person_entered": ">", "person_left": "<",
    "door_opening": "2", "door_opened": "^", "door_closing": "1", "door_closed": "v",
    "opened_then_entered": "P", "opened_then_left": "X", "entered_then_closed": "D", "left_then_closed": "s",
}  # fmt: skip


def timeline(scores: Scores, first_us: int, title: str) -> Figure:
    """Labels over what was found of them, by room: what is not blue over grey is wrong."""
    figure, axes = _figure(11, 6)
    places = sorted(
        {each.place for pair in scores.matched for each in pair}
        | {each.place for each in (*scores.missed, *scores.made_up)}
    )
    rows = {place: i for i, place in enumerate(places)}

    def draw(each: Occurrence, lift: float, colour: str) -> None:
        axes.plot((each.stamp_us - first_us) / 1e6, rows[each.place] + lift, MARKS.get(each.kind, "o"),
                  color=colour, markersize=7)  # fmt: skip

    for label, found in scores.matched:
        draw(label, 0.18, LABEL)
        draw(found, -0.18, FOUND)
    for each in scores.missed:
        draw(each, 0.18, WRONG)
    for each in scores.made_up:
        draw(each, -0.18, WRONG)
    axes.set_yticks(range(len(places)), places)
    axes.set_xlabel("time [s]")
    axes.set_title(title)
    kinds = sorted({each.kind for pair in scores.matched for each in pair})
    axes.legend(
        [axes.plot([], [], MARKS.get(kind, "o"), color=FOUND)[0] for kind in kinds], kinds,
        loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=5, frameon=False, fontsize=8,
    )  # fmt: skip
    axes.grid(axis="x", alpha=0.3)
    return figure


def boxes(groups: Mapping[str, Sequence[float]], title: str, unit: str, limit: tuple[float, str]) -> Figure:
    """Box plots with a line at a limit and what it is."""
    figure, axes = _figure(8, 5)
    names = [f"{name}\n(n = {len(values)})" for name, values in groups.items()]
    axes.boxplot(
        [list(values) for values in groups.values()],
        tick_labels=names,
        whis=(1, 99),
        flierprops={"markersize": 2},
    )
    value, what = limit
    axes.axhline(value, color=WRONG, linestyle="--", linewidth=1)
    axes.annotate(what, (0.02, value), xycoords=("axes fraction", "data"), color=WRONG, va="bottom")
    axes.set_ylabel(unit)
    axes.set_ylim(bottom=0)
    axes.set_title(title)
    return figure


def shares(by_name: Mapping[str, Mapping[str, float]], title: str, unit: str) -> Figure:
    """Stacked bars: what each is made of."""
    figure, axes = _figure(9, 5)
    parts = list(dict.fromkeys(part for each in by_name.values() for part in each))
    bottom = np.zeros(len(by_name))
    for part in parts:
        heights = np.array([each.get(part, 0.0) for each in by_name.values()])
        axes.bar(list(by_name), heights, bottom=bottom, label=part)
        bottom += heights
    axes.set_ylabel(unit)
    axes.set_title(title)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure


def histogram(values: Sequence[float], title: str, unit: str) -> Figure:
    """How values are distributed."""
    figure, axes = _figure(8, 4)
    axes.hist(values, bins=40, color=FOUND)
    axes.axvline(float(np.median(values)) if len(values) else 0.0, color="black", linewidth=1)
    axes.set_xlabel(unit)
    axes.set_title(title)
    return figure


def plan(
    seen: Sequence[NDArray[np.float64]], tracks: Mapping[str, NDArray[np.float64]], title: str
) -> Figure:
    """Tracks as lines over what a laser saw as points, each (n, 2) [m]."""
    figure, axes = _figure(8, 8)
    for points in seen:
        axes.plot(*points.T, ".", color="black", markersize=0.6)
    for name, way in tracks.items():
        axes.plot(*way.T, linewidth=1.2)
        axes.annotate(name, way[0], fontsize=6)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(title)
    return figure


def lines(
    series: Mapping[str, tuple[Sequence[float], Sequence[float]]], title: str, x: str, y: str
) -> Figure:
    """Curves with their points."""
    figure, axes = _figure(8, 5)
    for name, (across, up) in series.items():
        axes.plot(across, up, "o-", label=name)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_ylim(bottom=0)
    axes.set_title(title)
    axes.legend(frameon=False)
    return figure


def _figure(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots()
