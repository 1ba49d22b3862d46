"""The plan of a map from above: rooms by how many are in them, doors by how they stand, and who is where.

Metres, x to the right and y up, as in the frame of the map.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from semap.errors import InvalidInput
from semap.model.plan import Kind, Person, Thing, Way
from semap.picture.figure import FAINT, INK, color_of, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path as Outline

LONG_SIDE_IN = 11.0
SHORTEST_IN = 3.0
FRAME_IN = 0.9
"""Room for the title and the numbers at the edges."""

EMPTY, FULL = "#f6f8fa", "#9ec9f5"
CLOSED, AJAR, UNSEEN = "#1f2328", "#bf8700", "#8c959f"
DOOR_COLORS = {"open": "#1a7f37", "opening": AJAR, "closing": AJAR, "closed": CLOSED}
ARROW_M = 0.7
MOST_THINGS = 20_000
"""More cannot be told apart, and take minutes."""

MOST_NAMES = 60
MOST_IN_LEGEND = 24


def draw_plan(
    things: Sequence[Thing],
    persons: Sequence[Person],
    occupants: Mapping[int, int],
    doors: Mapping[int, str],
    title: str,
    path: Path,
) -> None:
    """Draw a map at a moment into an SVG, PNG or PDF file.

    occupants  how many are in an instance, by its id
    doors      how a door stands, by its id
    raises     InvalidInput for another format, without matplotlib, or for more than fits a picture
    """
    axes = _ground(things, [np.array([[each.x_m, each.y_m]]) for each in persons], title, path)
    most = max(occupants.values(), default=0)
    for thing in things:
        inside = occupants.get(thing.instance_id, 0)
        _draw_thing(axes, thing, inside / most if most else 0.0, doors.get(thing.instance_id))
    _name_rooms(axes, things, occupants)
    for person in persons:
        _draw_person(axes, person)
    _explain_doors(axes, {doors.get(each.instance_id) for each in things if each.kind is Kind.DOOR})
    save(axes.get_figure(), path)  # type: ignore[arg-type]  # made by `new_figure`


def draw_trajectories(things: Sequence[Thing], ways: Sequence[Way], title: str, path: Path) -> None:
    """Draw where tracks went, over the plan, each from a ring to an arrowhead.

    raises  InvalidInput for another format, or without matplotlib
    """
    axes = _ground(things, [way.points_m for way in ways], title, path)
    for thing in things:
        _draw_thing(axes, thing, 0.0, None)
    _name_rooms(axes, things, {})
    named: set[str] = set()
    for way in ways:
        color = color_of(way.name)
        x, y = way.points_m.T
        is_new = way.name not in named and len(named) < MOST_IN_LEGEND
        named.add(way.name)
        axes.plot(x, y, color=color, linewidth=1.3, alpha=0.85, label=way.name if is_new else None, zorder=4)
        axes.plot(x[0], y[0], marker="o", markersize=5, markerfacecolor="white", color=color, zorder=5)
        _draw_head(axes, way, color)
    if named:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
    save(axes.get_figure(), path)  # type: ignore[arg-type]  # made by `new_figure`


def _ground(things: Sequence[Thing], more: Iterable[np.ndarray], title: str, path: Path) -> Axes:
    """Axes with one scale that hold everything.

    raises  InvalidInput for more than fits a picture
    """
    if len(things) > MOST_THINGS:
        raise InvalidInput(
            f"{len(things)} things; at most {MOST_THINGS} fit a picture", "Ask for one storey.", path.name
        )
    bounds = [each.shape.bounds for each in things if not each.shape.is_empty]
    bounds += [(*points.min(axis=0), *points.max(axis=0)) for points in more if len(points)]
    if bounds:
        low_x, low_y = np.min([each[:2] for each in bounds], axis=0)
        high_x, high_y = np.max([each[2:] for each in bounds], axis=0)
    else:
        low_x = low_y = 0.0
        high_x = high_y = 1.0
    margin = 0.04 * max(high_x - low_x, high_y - low_y, 1.0)
    width, height = high_x - low_x + 2 * margin, high_y - low_y + 2 * margin
    scale = LONG_SIDE_IN / max(width, height)
    size = [max(side * scale, SHORTEST_IN) + FRAME_IN for side in (width, height)]
    axes = new_figure(size[0], size[1], path).add_subplot()
    axes.set_xlim(low_x - margin, high_x + margin)
    axes.set_ylim(low_y - margin, high_y + margin)
    axes.set_aspect("equal")
    axes.set_title(title, loc="left", fontsize=12, color=INK, pad=10)
    axes.tick_params(colors=INK, labelsize=8, length=0)
    axes.grid(color=FAINT, linewidth=0.4)
    axes.set_axisbelow(True)
    axes.spines[:].set_visible(False)
    axes.set_xlabel("x [m]", fontsize=8, color=INK)
    axes.set_ylabel("y [m]", fontsize=8, color=INK)
    return axes


def _draw_thing(axes: Axes, thing: Thing, fullness: float, door: str | None) -> None:
    if thing.kind is Kind.DOOR:
        color = DOOR_COLORS.get(door or "", UNSEEN)
        for line in _lines(thing.shape):
            axes.plot(*line.T, color=color, linewidth=3.2, solid_capstyle="butt", zorder=3)
        return
    if thing.shape.geom_type == "Point":
        axes.plot(thing.shape.x, thing.shape.y, marker="s", markersize=3, color=UNSEEN, zorder=2)
        return
    from matplotlib.patches import PathPatch  # noqa: PLC0415

    is_room = thing.kind is Kind.ROOM
    axes.add_patch(
        PathPatch(
            _outline(thing.shape),
            facecolor=_mixed(EMPTY, FULL, fullness) if is_room else "#eaeef2",
            edgecolor="#57606a" if is_room else UNSEEN,
            linewidth=1.2 if is_room else 0.7,
            zorder=1 if is_room else 2,
        )
    )


def _name_rooms(axes: Axes, things: Sequence[Thing], occupants: Mapping[int, int]) -> None:
    rooms = [each for each in things if each.kind is Kind.ROOM and not each.shape.is_empty]
    if len(rooms) > MOST_NAMES:
        return
    for room in rooms:
        spot = room.shape.representative_point()
        inside = occupants.get(room.instance_id)
        text = room.name if inside is None else f"{room.name}\n{inside} inside"
        axes.text(spot.x, spot.y, text, ha="center", va="center", fontsize=8, color="#57606a", zorder=2.5)


def _explain_doors(axes: Axes, states: set[str | None]) -> None:
    """A line for each state in which a door is; nothing where no door was ever seen."""
    for state in (each for each in DOOR_COLORS if each in states):
        axes.plot([], [], color=DOOR_COLORS[state], linewidth=3.2, label=f"door {state}")
    if states & set(DOOR_COLORS):
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)


def _draw_person(axes: Axes, person: Person) -> None:
    from matplotlib.patches import Ellipse  # noqa: PLC0415

    color = color_of(person.name)
    if person.trail:
        x, y = zip(*person.trail, strict=True)
        axes.plot(x, y, color=color, linewidth=1.2, alpha=0.5, zorder=4)
    if person.std_m is not None and person.std_m > 0:
        # Two standard deviations to either side: where it is with 86 %, if the error is normal.
        across_m = person.std_m if person.std_across_m is None else person.std_across_m
        spot = Ellipse(
            (person.x_m, person.y_m),
            4 * person.std_m,
            4 * across_m,
            angle=math.degrees(person.std_yaw_rad or 0.0),
            color=color,
            alpha=0.15,
            linewidth=0,
            zorder=4,
        )
        axes.add_patch(spot)
    axes.plot(
        person.x_m, person.y_m, marker="o", markersize=8, color=color, markeredgecolor="white", zorder=6
    )
    if person.heading_rad is not None:
        tip = (
            person.x_m + ARROW_M * math.cos(person.heading_rad),
            person.y_m + ARROW_M * math.sin(person.heading_rad),
        )
        arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.4, "shrinkA": 3, "shrinkB": 0}
        axes.annotate("", tip, (person.x_m, person.y_m), arrowprops=arrow, zorder=5)
    axes.annotate(
        person.name,
        (person.x_m, person.y_m),
        (7, 6),
        textcoords="offset points",
        fontsize=8,
        color=color,
        zorder=6,
    )


def _draw_head(axes: Axes, way: Way, color: str) -> None:
    """An arrowhead at the end, along the last stretch that has a length."""
    last = way.points_m[-1]
    apart = np.hypot(*(way.points_m - last).T) > 0.05
    if not apart.any():
        return
    before = way.points_m[np.flatnonzero(apart)[-1]]
    arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.3, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(last), tuple(before), arrowprops=arrow, zorder=5)


def _outline(area: shapely.Geometry) -> Outline:
    """The rings of an area; holes turn the other way and so stay empty."""
    from matplotlib.path import Path as Outline  # noqa: PLC0415

    rings = [
        np.asarray(ring.coords)[:, :2]
        for part in shapely.get_parts(area)
        if part.geom_type == "Polygon"
        for oriented in [shapely.geometry.polygon.orient(part)]
        for ring in (oriented.exterior, *oriented.interiors)
    ]
    return Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))


def _lines(shape: shapely.Geometry) -> list[np.ndarray]:
    """What of a door is drawn: its line, or the longer middle line of its outline."""
    if shape.geom_type == "LineString":
        return [np.asarray(shape.coords)[:, :2]]
    if shape.geom_type == "Point":
        return []
    corners = np.asarray(shapely.minimum_rotated_rectangle(shape).exterior.coords)[:4, :2]
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    across = [middles[[0, 2]], middles[[1, 3]]]
    return [max(across, key=lambda line: float(np.hypot(*(line[1] - line[0]))))]


def _mixed(low: str, high: str, share: float) -> str:
    parts = [[int(color[n : n + 2], 16) for n in (1, 3, 5)] for color in (low, high)]
    return "#" + "".join(f"{round(a + (b - a) * share):02x}" for a, b in zip(*parts, strict=True))
