"""A map as a folder that a person can write and keep in git: `map.yaml`, and meshes and grids beside it.

There are two forms, which may be mixed. The short one (`rooms`, `doors`, `storeys`, `things`) is for
people; see `semap.formats.map_short`. The full one says everything and is what an export writes: reading
it gives the same document again, meshes bit by bit. docs/map-format.md teaches both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TypeAlias

from semap.errors import NotFound
from semap.formats import map_sections as sections_of
from semap.formats import map_short
from semap.formats.map_draft import ROOT, Draft
from semap.formats.map_early import refuse_early
from semap.formats.map_folder import replace_file
from semap.formats.map_writing import MARK, map_files
from semap.formats.source import read_bytes
from semap.formats.uncollected import uncollected
from semap.formats.yaml_node import ANY_KEY, Node, Shape, parse_yaml
from semap.model.map_document import FrameEntry, MapDocument, QueryEntry, RuleEntry

FILE = "map.yaml"
VERSION = 1
ReadEntry: TypeAlias = Callable[[str, Node, Draft], None]
FULL: dict[str, ReadEntry] = {
    "concepts": sections_of.read_concept,
    "frames": sections_of.read_frame,
    "blueprints": partial(sections_of.read_description, is_shared=True),
    "descriptions": partial(sections_of.read_description, is_shared=False),
    "instances": sections_of.read_instance,
    "queries": sections_of.read_query,
    "rules": sections_of.read_rule,
    "grids": sections_of.read_grid_of_map,
}
SHORT: dict[str, ReadEntry] = {
    "storeys": map_short.read_storey,
    "rooms": map_short.read_room,
    "doors": map_short.read_door,
    "things": map_short.read_thing,
}
HEAD = ("semap_map", "map", "cell_m", "anchor")


def _version(node: Node) -> None:
    if node.whole() != VERSION:
        raise node.wrong(f"the format is of version {node.source}", f"This semap reads version {VERSION}.")


VALUES: dict[str, Callable[[Node], object]] = {
    "semap_map": _version,
    "cell_m": Node.positive,
    "anchor": sections_of.read_anchor,
    "elevation_m": Node.number,
    "height_m": Node.positive,
    "width_m": Node.positive,
    "yaw_deg": Node.number,
    **dict.fromkeys(("map", "concept", "alias", "storey", "on", "blueprint", "mesh"), Node.text),
    **dict.fromkeys(("frame", "parent", "description"), Node.text),
    "uid": Node.uid,
}
"""What is read one way wherever it stands."""


def _fields(keys: Iterable[str]) -> Shape:
    return {key: VALUES.get(key) for key in keys}


SHAPE: Shape = _fields(HEAD) | {
    "concepts": {ANY_KEY: _fields(sections_of.CONCEPT_FIELDS)},
    "blueprints": {ANY_KEY: _fields(sections_of.LOOK_FIELDS)},
    "descriptions": {ANY_KEY: _fields(sections_of.LOOK_FIELDS)},
    "queries": {ANY_KEY: _fields(sections_of.QUERY_FIELDS)},
    "rules": {ANY_KEY: _fields(sections_of.RULE_FIELDS)},
    "grids": {ANY_KEY: Node.text},
    "storeys": {ANY_KEY: _fields(map_short.STOREY_FIELDS)},
    "rooms": {ANY_KEY: _fields(map_short.THING_FIELDS)},
    "doors": {ANY_KEY: _fields(map_short.DOOR_FIELDS)},
    "things": {ANY_KEY: _fields(map_short.THING_FIELDS)},
    "frames": {ANY_KEY: _fields(sections_of.FRAME_FIELDS)},
    "instances": {ANY_KEY: _fields(sections_of.INSTANCE_FIELDS)},
}

DEFAULT_QUERY = QueryEntry("track_in_room", "contains", "Room")
DEFAULT_RULE = RuleEntry(
    "room_visits",
    (DEFAULT_QUERY.name,),
    {"input": DEFAULT_QUERY.name, "emit": {"began": "entered", "ended": "left"}},
)
"""What every new map starts with, also one from a file that speaks of neither queries nor rules."""


@uncollected()
def read_map(path: Path) -> MapDocument:
    """Read a map from its folder, or from its YAML file.

    raises  NotFound if there is no such file; TooLarge; InvalidInput, naming file, lines and columns, for
            what the format does not know, a name that is used but not given or given twice, a path that
            leaves the folder
    """
    file = path / FILE if path.is_dir() else path
    if not file.is_file():
        raise NotFound("map", path, f"Give a folder with a {FILE}, or a .yaml file.")
    root = parse_yaml(read_bytes(file), str(file), SHAPE, {"map": "Write `map: NAME` first."}, refuse_early)
    fields = root.fields(SHAPE)
    draft = Draft(file.parent, fields["rules"].mapping().keys() if "rules" in fields else ())
    for key in filter(fields.__contains__, FULL):
        draft.read(fields[key], FULL[key])
    if ("frame", ROOT) not in draft.places:
        draft.given("frame", ROOT, root)
        draft.frames.insert(0, FrameEntry(ROOT, None))
    for key in filter(fields.__contains__, SHORT):
        draft.read(fields[key], SHORT[key])
    if not {"queries", "rules"} & root.mapping().keys():
        draft.queries.append(DEFAULT_QUERY)
        draft.rules.append(DEFAULT_RULE)
    draft.check(str(file))
    draft.inherit_storeys()
    return MapDocument(
        name=fields["map"].text(),
        cell_m=fields["cell_m"].positive() if "cell_m" in fields else 4.0,
        anchor=sections_of.read_anchor(fields["anchor"]) if "anchor" in fields else None,
        concepts=tuple(draft.concepts),
        frames=tuple(draft.frames),
        descriptions=tuple(draft.descriptions),
        instances=tuple(draft.instances),
        queries=tuple(draft.queries),
        rules=tuple(draft.rules),
        grids=tuple(draft.grids),
    )


def write_map(document: MapDocument, folder: Path) -> Path:
    """Write a map in its full form into a folder, which is made; returns the path of its YAML file.

    What an earlier export left there is replaced; other files stay. `read_map` gives the same document,
    except that blueprints come before descriptions of one instance.
    """
    files = map_files(document)
    for name, content in files.items():
        if name != FILE:
            replace_file(folder / name, content)
    # Last, so that it never names a mesh that is not there yet.
    replace_file(folder / FILE, files[FILE])
    for left in (*folder.glob("meshes/*.ply"), *folder.glob("grids/*.pgm"), *folder.glob("grids/*.yaml")):
        if left.relative_to(folder).as_posix() not in files and _is_own(left):
            left.unlink()
    return folder / FILE


def _is_own(path: Path) -> bool:
    with path.open("rb") as file:
        return MARK in file.read(256)
