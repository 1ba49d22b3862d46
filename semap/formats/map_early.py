"""What can be told of a large map before it is built: outlines that are none, and names that nothing has.

All outlines are looked at together, as arrays. Those that cannot be right are then read as they are when a
map is built, which says what is wrong with each. What is not seen here is told when the map is built.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semap.errors import InvalidInput
from semap.formats.map_draft import ROOT, Draft
from semap.formats.map_shape import read_area
from semap.formats.yaml_node import Node, UnreadLists

READ_AT_MOST = 1000
NUMBER = re.compile(r"[-+.0-9eE]+")
SHORT = ("storeys", "rooms", "doors", "things")
GIVEN = {
    **dict.fromkeys(SHORT, ("instance", "frame")),
    "frames": ("frame",),
    "instances": ("instance",),
    "blueprints": ("description",),
    "descriptions": ("description",),
}
"""By section: of which kinds a thing is that is given there."""

BESIDES = (("between", "instance"), ("joins", "instance"), ("storey", "instance"))
STANDS_ON, IN_STOREY, MADE_AS = ("on", "frame"), ("storey", "frame"), ("blueprint", "description")
NAMED = {
    "frames": (("parent", "frame"),),
    "instances": (
        ("frame", "frame"),
        ("description", "description"),
        ("storey", "instance"),
        ("joins", "instance"),
    ),
    **dict.fromkeys(SHORT, (*BESIDES, STANDS_ON, MADE_AS)),
}
"""By section: the keys by which a thing is named, and its kind, in the order in which a map is read."""


def refuse_early(root: Node, lists: UnreadLists) -> None:
    """raises  InvalidInput for outlines that are none, else for names that are used and not given

    root   a map whose keys and plain values are right
    lists  of numbers, which stand in it as words
    """
    draft = Draft(Path())
    outlines = list(_outlines(root))
    for place in _wrong(_values(outlines, lists))[:READ_AT_MOST]:
        with draft.wrong.of_part(outlines[place].mark.index):
            read_area(lists.read(outlines[place]))
    draft.places["frame", ROOT] = ""
    for section, kinds in GIVEN.items():
        for name in _entries(root, section):
            draft.places.update(dict.fromkeys(((kind, name) for kind in kinds), ""))
    for section, keys in NAMED.items():
        for entry in _entries(root, section).values():
            _note_names(entry, keys, lists, draft)
    draft.check(root.file)


def _entries(root: Node, section: str) -> dict[str, Node]:
    node = root.mapping().get(section)
    return {} if node is None else dict(node.mapping())


def _note_names(entry: Node, keys: Sequence[tuple[str, str]], lists: UnreadLists, draft: Draft) -> None:
    fields = {key: node for key, node in entry.mapping().items() if not node.is_missing}
    for named in keys:
        key, kind = IN_STOREY if named == STANDS_ON and "on" not in fields else named
        if key not in fields:
            continue
        node = fields[key]
        if (text := lists.text(node)) is not None:  # names that are numbers
            for found in re.finditer(r"[^][, ]+", text):
                draft.uses.append((kind, found[0], node.where_of(found.start())))
            continue
        for each in node.value if isinstance(node.value, tuple) else (node,):
            if each.source:
                draft.named(kind, each)


def _outlines(root: Node) -> Iterator[Node]:
    for section in ("blueprints", "descriptions", "rooms", "doors", "things"):
        for entry in _entries(root, section).values():
            fields = entry.mapping()
            if "footprint" in fields and not fields["footprint"].is_missing:
                yield fields["footprint"]
            if "geometries" in fields and isinstance(fields["geometries"].value, dict):
                for geometry in fields["geometries"].value.values():
                    said = geometry.value if isinstance(geometry.value, dict) else {}
                    if "polygon" in said and "type" in said and said["type"].source == "POLYGON2D":
                        yield said["polygon"]


def _values(nodes: Sequence[Node], lists: UnreadLists) -> list[object]:
    """What outlines say, as JSON has it; None of one that cannot be right."""
    texts = [lists.text(node) for node in nodes]
    try:
        values: list[object] = json.loads(f"[{','.join(text or 'null' for text in texts)}]")
    except (ValueError, RecursionError):
        values = [None] * len(nodes)
    for place, (node, text) in enumerate(zip(nodes, texts, strict=True)):
        if values[place] is None:
            with suppress(InvalidInput, ValueError, RecursionError):
                values[place] = node.json() if text is None else json.loads(NUMBER.sub(_of_json, text))
    return values


def _of_json(number: re.Match[str]) -> str:
    """A number as JSON has it, such as 0.5 for .5"""
    return repr(float(number[0]))


def _wrong(values: Sequence[object]) -> list[int]:
    """Which outlines cannot be right."""
    rings: dict[int, NDArray[np.float64]] = {}
    areas: dict[int, Polygon | MultiPolygon] = {}
    for place, value in enumerate(values):
        try:
            points = np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            points = np.empty(0)
        if points.ndim == 2:
            if points.shape[1] == 2 and len(points) - (points[0] == points[-1]).all() >= 3:
                rings[place] = points
        elif (area := _with_parts(value)) is not None:
            areas[place] = area
    if rings:
        sizes = [len(points) for points in rings.values()]
        within = np.repeat(np.arange(len(rings)), sizes)
        corners = np.concatenate(list(rings.values()))
        is_finite = np.bincount(within, ~np.isfinite(corners).all(axis=1)) == 0
        corners[~np.isfinite(corners)] = 0
        drawn = shapely.polygons(shapely.linearrings(corners, indices=within))
        areas |= {place: area for place, area, fits in zip(rings, drawn, is_finite, strict=True) if fits}
    shapes = np.array(list(areas.values()), dtype=object)
    fine = shapely.is_valid(shapes) & (shapely.area(shapes) > 0)
    right = {place for place, is_fine in zip(areas, fine, strict=True) if is_fine}
    return [place for place in range(len(values)) if place not in right]


def _with_parts(value: Any) -> Polygon | MultiPolygon | None:
    """An area with holes or of several parts; None where it is none."""
    try:
        parts = [value] if isinstance(value[0][0][0], int | float) else value
        for ring in (ring for part in parts for ring in part):
            if len({(x, y) for x, y in ring}) < 3:
                return None
        return MultiPolygon([Polygon(outside, holes) for outside, *holes in parts])
    except (TypeError, ValueError, IndexError, OverflowError, shapely.GEOSException):
        return None
