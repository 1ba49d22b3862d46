"""The full form of a map's YAML: one section for each kind of entry, nothing implied."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any
from uuid import uuid5

from shapely import Polygon

from semap.errors import InvalidInput
from semap.formats.geojson import NAMESPACE
from semap.formats.map_draft import Draft
from semap.formats.map_folder import inside
from semap.formats.map_shape import POSE_FIELDS, read_area, read_geometry, read_mesh_of, read_pose
from semap.formats.occupancy_grid import read_grid
from semap.formats.validation import require_short
from semap.formats.yaml_node import Node
from semap.geometry.prism import extrude
from semap.model.anchor import Anchor
from semap.model.building import HeightBand, Mesh
from semap.model.map_document import (
    ConceptEntry,
    DescriptionEntry,
    FrameEntry,
    InstanceEntry,
    QueryEntry,
    RuleEntry,
    StampedPose,
)
from semap.model.source_geometry import BODY, OUTLINE, SourceGeometry
from semap.timeline.stamp import parse_stamp, to_datetime

CONCEPT_FIELDS = ("parents", "iris", "comment", "schema")
FRAME_FIELDS = ("parent", "poses", *POSE_FIELDS)
INSTANCE_FIELDS = ("uid", "concept", "frame", "alias", "description", "storey", "joins", "attributes")
LOOK_FIELDS = ("geometries", "box", "mesh", "unit", "up", "footprint", "height_m")
UNITS = ("m", "cm", "mm", "inch", "foot")
AXES = ("x", "y", "z")

RULE_CLAUSES = (
    "input",
    "where",
    "partition_by",
    "pattern",
    "subset",
    "define",
    "measures",
    "rows_per_match",
    "within",
    "after_match",
    "about",
    "when",
    "formula",
    "emit",
    "confidence",
)
QUERY_OPTIONS = ("subject", "object", "distance_m", "abstraction", "dimensions", "debounce", "certainty",
                 "between_samples", "follows_amendments", "payload")  # fmt: skip
WHOLE_RULE = ("query", "queries", "declaration")
QUERY_FIELDS = ("predicate", "concept", "enabled", *QUERY_OPTIONS)
RULE_FIELDS = (*RULE_CLAUSES, *WHOLE_RULE, "enabled")


def read_anchor(node: Node) -> Anchor:
    """Where the map lies on the earth."""
    fields = node.fields(("epsg", *POSE_FIELDS))
    if "epsg" not in fields:
        raise node.wrong("`epsg` is missing", "Write the number of a metric system, such as 25832.")
    epsg = fields["epsg"].whole()
    if not 1024 <= epsg <= 32767:
        raise fields["epsg"].wrong(f"{epsg} is no EPSG code", "Write a number from 1024 to 32767.")
    return Anchor(epsg, read_pose(fields))


def read_concept(name: str, entry: Node, draft: Draft) -> None:
    """A kind of things; parents that are not listed are looked for in the database."""
    fields = entry.fields(CONCEPT_FIELDS)
    draft.given("concept", name, entry)
    draft.concepts.append(
        ConceptEntry(
            name,
            fields["parents"].texts() if "parents" in fields else (),
            fields["iris"].texts() if "iris" in fields else (),
            _text(fields, "comment"),
            _json_mapping(fields["schema"]) if "schema" in fields else None,
        )
    )


def read_frame(name: str, entry: Node, draft: Draft) -> None:
    """A frame with its poses in its parent."""
    fields = entry.fields(FRAME_FIELDS)
    draft.given("frame", name, entry)
    parent = draft.named("frame", fields["parent"]) if "parent" in fields else None
    if "poses" not in fields:
        poses: tuple[StampedPose, ...] = (StampedPose(read_pose(fields)),)
    elif set(POSE_FIELDS) & fields.keys():
        raise entry.wrong("both `poses` and a pose", "Put the pose into `poses`.")
    else:
        poses = tuple(_stamped(each) for each in fields["poses"].sequence())
    stamps = [each.stamp for each in poses]
    if len(set(stamps)) < len(stamps):
        raise entry.wrong("two poses at the same time", "Keep one for each stamp.")
    draft.frames.append(FrameEntry(name, parent, poses))


def read_description(key: str, entry: Node, draft: Draft, *, is_shared: bool) -> None:
    """A blueprint, or a description that belongs to one instance."""
    draft.given("description", key, entry)
    geometries = read_look(entry, entry.fields(LOOK_FIELDS), draft)
    draft.descriptions.append(DescriptionEntry(key, geometries, is_shared))


def read_look(node: Node, fields: Mapping[str, Node], draft: Draft) -> tuple[SourceGeometry, ...]:
    """The geometries that `geometries`, `box`, `mesh` or `footprint` give; none without them.

    raises  InvalidInput if two of them are there
    """
    kinds = sorted({"geometries", "box", "mesh", "footprint"} & fields.keys())
    if len(kinds) > 1:
        raise fields[kinds[1]].wrong(f"both `{kinds[0]}` and `{kinds[1]}`", "Keep one.")
    for option in {"unit", "up"} & fields.keys():
        if kinds != ["mesh"]:
            raise fields[option].wrong(f"`{option}` without `mesh`", "It says how a mesh file is meant.")
    if "height_m" in fields and kinds != ["footprint"]:
        raise fields["height_m"].wrong("`height_m` without `footprint`", "Give the outline, too.")
    if not kinds:
        return ()
    shape = fields[kinds[0]]
    if kinds == ["geometries"]:
        return tuple(
            read_geometry(name, each, draft.folder) for name, each in shape.mapping().items() if name
        )
    if kinds == ["box"]:
        return (SourceGeometry(BODY, "TRIANGLEMESH3D", _box(shape)),)
    if kinds == ["mesh"]:
        unit = fields["unit"].one_of(UNITS) if "unit" in fields else None
        up = fields["up"].one_of(AXES) if "up" in fields else None
        return (SourceGeometry(BODY, "TRIANGLEMESH3D", read_mesh_of(shape, draft.folder, unit, up)),)
    area = read_area(shape)
    if "height_m" not in fields:
        return (SourceGeometry(OUTLINE, "POLYGON2D", area),)
    height_m = fields["height_m"].positive()
    return (
        SourceGeometry(BODY, "TRIANGLEMESH3D", extrude(area, 0.0, height_m)),
        SourceGeometry(OUTLINE, "POLYGON2D", area, band=HeightBand(0.0, height_m)),
    )


def read_instance(name: str, entry: Node, draft: Draft) -> None:
    """An instance, in a frame that is given elsewhere."""
    fields = entry.fields(INSTANCE_FIELDS)
    for needed in ("concept", "frame"):
        if needed not in fields:
            raise entry.wrong(f"`{needed}` is missing", "Give it, or use `things:`, where less is needed.")
    draft.given("instance", name, entry)
    require_short("concept", fields["concept"].text(), fields["concept"].where)
    draft.instances.append(
        InstanceEntry(
            uid=fields["uid"].uid() if "uid" in fields else uuid5(NAMESPACE, name),
            name=name,
            concept=fields["concept"].text(),
            frame=draft.named("frame", fields["frame"]),
            alias=_text(fields, "alias"),
            description=draft.named("description", fields["description"])
            if "description" in fields
            else None,
            storey=draft.named("instance", fields["storey"]) if "storey" in fields else None,
            joins=tuple(draft.named("instance", each) for each in fields["joins"].sequence())
            if "joins" in fields
            else (),
            attributes=_json_mapping(fields["attributes"]) if "attributes" in fields else {},
        )
    )


def read_query(name: str, entry: Node, draft: Draft) -> None:
    """A continuous query."""
    fields = entry.fields(QUERY_FIELDS)
    if "concept" not in fields and "object" not in fields:
        raise entry.wrong("`concept` is missing", "Write the kind of thing that contains the tracks.")
    draft.given("query", name, entry)
    predicate = fields["predicate"].text() if "predicate" in fields else "contains"
    concept = fields["concept"].text() if "concept" in fields else None
    options = {option: fields[option].json() for option in QUERY_OPTIONS if option in fields}
    draft.queries.append(QueryEntry(name, predicate, concept, _enabled(fields), options))


def read_rule(name: str, entry: Node, draft: Draft) -> None:
    """A rule, as a file of rules says it (`input`, `emit`, ...) or with its whole declaration."""
    fields = entry.fields(RULE_FIELDS)
    draft.given("rule", name, entry)
    clauses = [clause for clause in RULE_CLAUSES if clause in fields]
    if "input" in fields and not fields.keys() & set(WHOLE_RULE):
        queries = _queries_read(fields["input"], draft)
        declaration: Mapping[str, object] = {
            "emit": {},
            **{clause: fields[clause].json() for clause in clauses},
        }
    elif "declaration" in fields and not clauses:
        queries = _queries_named(fields, draft)
        declaration = _json_mapping(fields["declaration"])
    else:
        raise entry.wrong("a rule needs `input` and `emit`", "For example: {input: q, emit: {began: e}}.")
    draft.rules.append(RuleEntry(name, queries, declaration, _enabled(fields)))


def _queries_read(node: Node, draft: Draft) -> tuple[str, ...]:
    """Of what a rule reads, the queries: one name alone is one, unless it is a rule's."""
    if not isinstance(node.value, tuple):
        one = node.mapping().get("query") if isinstance(node.value, Mapping) else node
        return () if one is None or one.text() in draft.rule_names else (draft.named("query", one),)
    found = []
    for each in node.sequence():
        if isinstance(each.value, Mapping):
            found += [draft.named("query", of) for key, of in each.mapping().items() if key == "query"]
        elif ("query", each.text()) in draft.places:
            found.append(each.text())
    return tuple(found)


def _queries_named(fields: Mapping[str, Node], draft: Draft) -> tuple[str, ...]:
    if "query" in fields:  # as it was written before a rule could read several
        return (draft.named("query", fields["query"]),)
    return (
        tuple(draft.named("query", each) for each in fields["queries"].sequence())
        if "queries" in fields
        else ()
    )


def read_grid_of_map(name: str, entry: Node, draft: Draft) -> None:
    """An occupancy grid: the path of a YAML file of map_server."""
    draft.given("grid", name, entry)
    draft.grids.append(read_grid(inside(draft.folder, entry), name, draft.folder))


def read_attributes(fields: Mapping[str, Node]) -> dict[str, object]:
    """The attributes of an instance; none without the key."""
    return dict(_json_mapping(fields["attributes"])) if "attributes" in fields else {}


def _json_mapping(node: Node) -> Mapping[str, Any]:
    return {key: each.json() for key, each in node.mapping().items()}


def _text(fields: Mapping[str, Node], key: str) -> str | None:
    return fields[key].text() if key in fields else None


def _enabled(fields: Mapping[str, Node]) -> bool:
    return fields["enabled"].truth() if "enabled" in fields else True


def _stamped(node: Node) -> StampedPose:
    fields = node.fields(("stamp", *POSE_FIELDS))
    return StampedPose(read_pose(fields), _stamp(fields["stamp"]) if "stamp" in fields else None)


def _stamp(node: Node) -> datetime:
    try:
        return to_datetime(parse_stamp(node.text()))
    except (InvalidInput, OverflowError) as error:
        raise node.wrong(f"{node.source!r} is no stamp", "Write it as 2026-01-31T12:00:00Z.") from error


def _box(node: Node) -> Mesh:
    """A box that stands on its own frame, its bottom's middle at the origin."""
    length_m, width_m, height_m = (each.positive() for each in node.sequence(3, 3))
    half = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    return extrude(Polygon([(x * length_m / 2, y * width_m / 2) for x, y in half]), 0.0, height_m)
