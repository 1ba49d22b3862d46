"""The short form of a map's YAML: what a person writes. Frames and descriptions follow from it.

Each room, door, storey and thing gets a frame of its own name, which stands in the frame of what it is
`on`, else of its storey, else of the map. Shapes are in that own frame, so that a room without `at` is
drawn in the coordinates of its storey.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from uuid import uuid5

from semap.formats.door_leaf import read_leaf
from semap.formats.geojson import NAMESPACE
from semap.formats.map_draft import ROOT, Draft
from semap.formats.map_sections import LOOK_FIELDS, read_attributes, read_look
from semap.formats.map_shape import POSE_FIELDS, read_pose
from semap.formats.yaml_node import Node
from semap.geometry.pose import pose_from_yaw
from semap.model.map_document import ConceptEntry, DescriptionEntry, FrameEntry, InstanceEntry, StampedPose
from semap.model.pose import Pose

STOREY = "Storey"
OWN = "instance {}"
"""Names the description of one instance, as an export does."""

THING_FIELDS = (
    "concept", "alias", "storey", "on", "blueprint", "joins", "attributes", "uid", *LOOK_FIELDS, *POSE_FIELDS,
)  # fmt: skip
DOOR_FIELDS = ("between", "line", "width_m", "leaf", *(each for each in THING_FIELDS if each != "joins"))
SHAPES = ("geometries", "box", "mesh", "footprint", "blueprint")
STOREY_FIELDS = ("elevation_m", "alias", "attributes", "uid")


def read_room(name: str, node: Node, draft: Draft) -> None:
    """A room."""
    _read_thing(name, node, node.fields(THING_FIELDS), draft, "Room")


def read_thing(name: str, node: Node, draft: Draft) -> None:
    """A thing of the kind that it names."""
    _read_thing(name, node, node.fields(THING_FIELDS), draft, None)


def read_storey(name: str, node: Node, draft: Draft) -> None:
    """A storey, whose frame is at its elevation."""
    fields = node.fields(STOREY_FIELDS)
    elevation_m = fields["elevation_m"].number() if "elevation_m" in fields else 0.0
    _add(name, node, fields, draft, STOREY, ROOT, Pose(z_m=elevation_m))


def read_door(name: str, node: Node, draft: Draft) -> None:
    """A door, and the rooms that it joins."""
    fields = dict(node.fields(DOOR_FIELDS))
    joins = fields.pop("between", None)
    sides = () if joins is None else joins.sequence(1, 2)
    rooms = tuple(sorted(draft.named("instance", each) for each in sides))
    attributes: dict[str, object] = {}
    pose: Pose | None = None
    if "line" in fields:
        line = fields.pop("line")
        if {"at", "yaw_deg", "quaternion"} & fields.keys():
            raise line.wrong("both `line` and a pose", "Keep one.")
        (x0, y0), (x1, y1) = (point.numbers(2, 2) for point in line.sequence(2, 2))
        pose = pose_from_yaw((x0 + x1) / 2, (y0 + y1) / 2, 0.0, math.atan2(y1 - y0, x1 - x0))
        attributes["width_m"] = math.hypot(x1 - x0, y1 - y0)
    if "width_m" in fields:
        attributes["width_m"] = fields.pop("width_m").positive()
    if "height_m" in fields and "footprint" not in fields:
        attributes["height_m"] = fields.pop("height_m").positive()
    if "leaf" in fields:
        node_of_leaf = fields.pop("leaf")
        leaf = attributes["leaf"] = read_leaf(node_of_leaf)
        if "width_m" not in leaf | attributes and not set(SHAPES) & fields.keys():
            raise node_of_leaf.wrong(
                "a leaf without a width", "Give the door its `width_m`, a `line` or a shape."
            )
    _read_thing(name, node, fields, draft, "Door", rooms, attributes, pose)


def _read_thing(
    name: str,
    node: Node,
    fields: Mapping[str, Node],
    draft: Draft,
    concept: str | None,
    joins: tuple[str, ...] = (),
    attributes: Mapping[str, object] | None = None,
    pose: Pose | None = None,
) -> None:
    if "concept" in fields:
        concept = fields["concept"].text()
    if concept is None:
        raise node.wrong("`concept` is missing", "Say what it is, such as `concept: Table`.")
    if "joins" in fields:
        joins = tuple(draft.named("instance", each) for each in fields["joins"].sequence())
    storey = draft.named("instance", fields["storey"]) if "storey" in fields else None
    parent = storey or ROOT
    if "on" in fields:
        parent = draft.named("frame", fields["on"])
        draft.standing_on[name] = parent
    elif storey is not None:
        draft.named("frame", fields["storey"])
    description = _description(name, node, fields, draft)
    pose = pose or read_pose(fields)
    _add(name, node, fields, draft, concept, parent, pose, description, storey, joins, attributes or {})


def _description(name: str, node: Node, fields: Mapping[str, Node], draft: Draft) -> str | None:
    geometries = read_look(node, fields, draft)
    if "blueprint" in fields:
        if geometries:
            raise fields["blueprint"].wrong("both a blueprint and an own shape", "Keep one.")
        return draft.named("description", fields["blueprint"])
    if not geometries:
        return None
    key = OWN.format(name)
    draft.given("description", key, node)
    draft.descriptions.append(DescriptionEntry(key, geometries))
    return key


def _add(
    name: str,
    node: Node,
    fields: Mapping[str, Node],
    draft: Draft,
    concept: str,
    parent: str,
    pose: Pose,
    description: str | None = None,
    storey: str | None = None,
    joins: tuple[str, ...] = (),
    attributes: Mapping[str, object] | None = None,
) -> None:
    draft.given("instance", name, node)
    draft.given("frame", name, node)
    draft.frames.append(FrameEntry(name, parent, (StampedPose(pose),)))
    if ("concept", concept) not in draft.places:
        # Those that the database knows stay as they are there; new ones lie below Thing.
        draft.given("concept", concept, node)
        draft.concepts.append(ConceptEntry(concept))
    draft.instances.append(
        InstanceEntry(
            uid=fields["uid"].uid() if "uid" in fields else uuid5(NAMESPACE, name),
            name=name,
            concept=concept,
            frame=name,
            alias=fields["alias"].text() if "alias" in fields else None,
            description=description,
            storey=storey,
            joins=joins,
            attributes={**(attributes or {}), **read_attributes(fields)},
        )
    )
