"""A map as a folder that a person can write and keep in git: `map.yaml`, and meshes and grids beside it.

There are two forms, which may be mixed. The short one (`rooms`, `doors`, `storeys`, `things`) is for
people; see `semap.formats.map_short`. The full one says everything and is what an export writes: reading
it gives the same document again, meshes bit by bit. docs/map-format.md teaches both.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from semap.errors import NotFound
from semap.formats import map_sections as sections_of
from semap.formats.map_draft import ROOT, Draft
from semap.formats.map_folder import replace_file
from semap.formats.map_short import DOOR_FIELDS, STOREY_FIELDS, THING_FIELDS, read_short_form
from semap.formats.map_writing import MARK, map_files
from semap.formats.source import read_bytes
from semap.formats.yaml_node import ANY_KEY, Node, Shape, parse_yaml
from semap.model.map_document import FrameEntry, MapDocument, QueryEntry, RuleEntry

FILE = "map.yaml"
VERSION = 1
SHORT = ("storeys", "rooms", "doors", "things")
FULL: dict[str, Callable[[Node, Draft], None]] = {
    "concepts": sections_of.read_concepts,
    "frames": sections_of.read_frames,
    "blueprints": lambda node, draft: sections_of.read_descriptions(node, draft, is_shared=True),
    "descriptions": lambda node, draft: sections_of.read_descriptions(node, draft, is_shared=False),
    "instances": sections_of.read_instances,
    "queries": sections_of.read_queries,
    "rules": sections_of.read_rules,
    "grids": sections_of.read_grids,
}
HEAD = ("semap_map", "map", "cell_m", "anchor")
SHAPE: Shape = (
    dict.fromkeys(HEAD)
    | {key: {ANY_KEY: None} for key in (*FULL, *SHORT)}
    | {
        "storeys": {ANY_KEY: dict.fromkeys(STOREY_FIELDS)},
        "rooms": {ANY_KEY: dict.fromkeys(THING_FIELDS)},
        "doors": {ANY_KEY: dict.fromkeys(DOOR_FIELDS)},
        "things": {ANY_KEY: dict.fromkeys(THING_FIELDS)},
        "frames": {ANY_KEY: dict.fromkeys(sections_of.FRAME_FIELDS)},
        "instances": {ANY_KEY: dict.fromkeys(sections_of.INSTANCE_FIELDS)},
    }
)

DEFAULT_QUERY = QueryEntry("track_in_room", "contains", "Room")
DEFAULT_RULE = RuleEntry(
    "room_visits",
    (DEFAULT_QUERY.name,),
    {"input": DEFAULT_QUERY.name, "emit": {"began": "entered", "ended": "left"}},
)
"""What every new map starts with, also one from a file that speaks of neither queries nor rules."""


def read_map(path: Path) -> MapDocument:
    """Read a map from its folder, or from its YAML file.

    raises  NotFound if there is no such file; TooLarge; InvalidInput, naming file, line and column, for what
            the format does not know, a name that is used but not given or given twice, a path that leaves
            the folder
    """
    file = path / FILE if path.is_dir() else path
    if not file.is_file():
        raise NotFound("map", path, f"Give a folder with a {FILE}, or a .yaml file.")
    root = parse_yaml(read_bytes(file), str(file), SHAPE)
    fields = root.fields((*HEAD, *FULL, *SHORT))
    if "semap_map" in fields and fields["semap_map"].whole() != VERSION:
        raise fields["semap_map"].wrong(
            f"the format is of version {fields['semap_map'].source}", f"This semap reads version {VERSION}."
        )
    if "map" not in fields:
        raise root.wrong("`map` is missing", "Write `map: NAME` first.")
    draft = Draft(file.parent)
    for key, read in FULL.items():
        if key in fields:
            read(fields[key], draft)
    if ("frame", ROOT) not in draft.places:
        draft.given("frame", ROOT, root)
        draft.frames.insert(0, FrameEntry(ROOT, None))
    standing_on = read_short_form(fields, draft)
    if not {"queries", "rules"} & root.mapping().keys():
        draft.queries.append(DEFAULT_QUERY)
        draft.rules.append(DEFAULT_RULE)
    draft.check()
    draft.inherit_storeys(standing_on)
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
