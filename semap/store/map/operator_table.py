"""All operators as a table: what each answers, what it takes and gives, and what of SEMAP it stands for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

Kind = Literal[
    "number",
    "integer",
    "text",
    "boolean",
    "texts",
    "attributes",
    "area",
    "point",
    "pose",
    "stamp",
    "instance",
    "frame",
    "description",
]
Gives = Literal["instance", "id", "number", "integer", "text", "geometry"]


@dataclass(frozen=True)
class Parameter:
    """A named parameter.

    kind     `instance`, `frame` and `description` are given by name or by id
    sql      its name in the function
    default  None: what the function's own default is
    """

    name: str
    kind: Kind
    answers: str
    sql: str
    default: object = None
    required: bool = False
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Column:
    """What a row says; one that gives an instance is beside its name."""

    name: str
    gives: Gives = "instance"


@dataclass(frozen=True)
class Operator:
    """An operator: one SQL function, which REST serves.

    references  the function's parameter for the instances that are asked about, if it has one
    targets     the function's parameter for those that are looked for; without a selection all on the map
    key         columns by which rows are unique, and in whose order they come
    edits       whether it changes the map
    semap       ROS services of SEMAP in whose place it stands
    """

    name: str
    answers: str
    columns: tuple[Column, ...]
    key: tuple[str, ...]
    references: str | None = None
    targets: str | None = None
    map_id: str | None = None
    parameters: tuple[Parameter, ...] = ()
    edits: bool = False
    semap: tuple[str, ...] = ()
    function: str = field(default="")

    @property
    def sql(self) -> str:
        return f"semap.{self.function or self.name}"


def _pairs(
    name: str,
    answers: str,
    *parameters: Parameter,
    more: tuple[Column, ...] = (),
    key: tuple[str, ...] = ("reference_id", "target_id"),
    semap: tuple[str, ...] = (),
) -> Operator:
    """An operator from references to targets."""
    return Operator(
        name,
        answers,
        (Column("reference_id"), Column("target_id"), *more),
        key,
        "p_reference_ids",
        "p_target_ids",
        parameters=parameters,
        semap=semap,
    )


FLAT = ("Footprint", "FootprintHull", "FootprintBox", "AxisAligned2D", "Position2D")
ABSTRACTIONS = (*FLAT, "Position3D", "AxisAligned3D", "BoundingBox", "BoundingHull")
REGIONS = tuple(
    f"{side}{kind}"
    for kind in ("Projection", "Halfspace")
    for side in ("Front", "Back", "Left", "Right", "Top", "Bot")
)
MODE = Parameter("mode", "text", "footprints and heights, or bodies", "p_mode", "2d", choices=("2d", "3d"))
STRICT = Parameter("strict", "boolean", "completely, or with some of it", "p_strict", False)
ABSTRACTION = Parameter("abstraction", "text", "of both", "p_abstraction", "Footprint", choices=ABSTRACTIONS)
OF_EITHER = (
    ABSTRACTION,
    Parameter(
        "reference_abstraction", "text", "of references", "p_reference_abstraction", choices=ABSTRACTIONS
    ),
    Parameter("target_abstraction", "text", "of targets", "p_target_abstraction", choices=ABSTRACTIONS),
)
FRAME = Parameter(
    "frame", "text", "whose axes count", "p_frame", "object", choices=("object", "map", "viewer")
)
VIEWER = Parameter("viewer", "pose", "map_T_viewer, for frame viewer", "p_viewer")
REACH = Parameter("reach_m", "number", "how far the region reaches", "p_reach_m", 10.0)
DIRECTED = (
    FRAME,
    VIEWER,
    Parameter(
        "kind",
        "text",
        "beside, or anywhere beyond",
        "p_kind",
        "projection",
        choices=("projection", "halfspace"),
    ),
    STRICT,
    REACH,
)
GAP = Column("gap_m", "number")
DISTANCE = Column("distance_m", "number")
MEASURES = (Column("reference_measure", "number"), Column("target_measure", "number"))
MEASURED = (
    Parameter(
        "measure", "text", "what is compared", "p_measure", "area", choices=("area", "volume", "height")
    ),
    Parameter("factor", "number", "times the reference's", "p_factor", 1.0),
)
CLOSED = Parameter("closed", "attributes", "attributes of doors that are not passed", "p_closed")
AREA = Parameter("area", "area", "a polygon in the map frame", "p_area", required=True)
DIRECTION_SERVICES = ("get_directional_relations2d", "get_directional_relations3d")
OUTCOME = (Column("target_id"), Column("reference_id"), Column("outcome", "text"))

TOPOLOGICAL = (
    Operator(
        "in_area",
        "What is within an area, seen from above.",
        (Column("target_id"),),
        ("target_id",),
        targets="p_target_ids",
        map_id="p_map_id",
        parameters=(
            AREA,
            STRICT,
            Parameter("abstraction", "text", "of targets", "p_abstraction", "Footprint", choices=FLAT),
        ),
        semap=("get_objects_within_area",),
    ),
    Operator(
        "in_volume",
        "What is within a volume: an area between two heights.",
        (Column("target_id"),),
        ("target_id",),
        targets="p_target_ids",
        map_id="p_map_id",
        parameters=(
            Parameter("area", "area", "a polygon in the map frame", "p_volume", required=True),
            Parameter("z_min_m", "number", "from this height", "p_z_min_m"),
            Parameter("z_max_m", "number", "up to this height", "p_z_max_m"),
            STRICT,
        ),
        semap=("get_objects_within_volume",),
    ),
    _pairs(
        "in_objects",
        "What is in the references: completely within, or with some of it.",
        MODE,
        STRICT,
        semap=("get_objects_in_objects", "evaluate_containment", "test_containment_relations3d"),
    ),
    _pairs(
        "on_objects",
        "What rests on the references.",
        Parameter("tolerance_m", "number", "so far from the surface", "p_tolerance_m", 0.05),
        more=(GAP,),
        semap=("get_objects_on_objects",),
    ),
    _pairs(
        "intersecting_objects",
        "What shares a point with the references; touching counts.",
        MODE,
        semap=("get_objects_intersect_objects", "evaluate_intersection", "binary_relation_test"),
    ),
    _pairs(
        "topology",
        "Pairs whose footprints are in a relation of DE-9IM by name.",
        Parameter(
            "predicate",
            "text",
            "of the reference to the target",
            "p_predicate",
            required=True,
            choices=(
                "equals",
                "disjoint",
                "touches",
                "contains",
                "covers",
                "covered_by",
                "within",
                "intersects",
                "overlaps",
                "crosses",
            ),
        ),
    ),
    _pairs(
        "relate",
        "The DE-9IM matrices of footprints.",
        Parameter("pattern", "text", "of matrices, such as T*F**FFF*", "p_pattern"),
        more=(Column("matrix", "text"),),
    ),
    _pairs(
        "rcc8_relations",
        "The relations of footprints in the region connection calculus.",
        Parameter("relations", "texts", "only these, such as EC and TPP", "p_relations"),
        more=(Column("relation", "text"),),
    ),
)

METRIC = (
    _pairs(
        "distances",
        "The least or greatest distance between abstractions, with the two points.",
        Parameter("mode", "text", "least or greatest", "p_mode", "min", choices=("min", "max")),
        *OF_EITHER,
        more=(DISTANCE, Column("reference_point", "geometry"), Column("target_point", "geometry")),
        semap=("get_distance_between_objects",),
    ),
    _pairs(
        "within_range",
        "What is at least and at most so far from the references.",
        Parameter("min_m", "number", "at least", "p_min_m", 0.0),
        Parameter("max_m", "number", "at most", "p_max_m", 5.0),
        Parameter("fully", "boolean", "with all of it", "p_fully", False),
        *OF_EITHER,
        more=(DISTANCE,),
        semap=("get_objects_within_range",),
    ),
    _pairs(
        "nearest",
        "What is nearest to each reference.",
        Parameter("count", "integer", "so many for each", "p_count", 1),
        *OF_EITHER,
        more=(DISTANCE, Column("rank", "integer")),
        key=("reference_id", "rank"),
    ),
    Operator(
        "nearest_to",
        "What is nearest to a point.",
        (Column("target_id"), DISTANCE, Column("rank", "integer")),
        ("rank",),
        targets="p_target_ids",
        map_id="p_map_id",
        parameters=(
            Parameter("point", "point", "in the map frame", "p_point", required=True),
            Parameter("count", "integer", "so many", "p_count", 1),
            ABSTRACTION,
        ),
    ),
)

DIRECTIONAL = (
    *(
        _pairs(name, answers, *DIRECTED, more=(GAP,), semap=DIRECTION_SERVICES)
        for name, answers in (
            ("above", "What is above the references."),
            ("below", "What is below the references."),
            ("left_of", "What is to the left of the references."),
            ("right_of", "What is to the right of the references."),
            ("in_front_of", "What is in front of the references."),
            ("behind", "What is behind the references."),
        )
    ),
    Operator(
        "region_of",
        "The region to one side of an instance, as the faces of a solid.",
        (Column("region", "geometry"),),
        (),
        parameters=(
            Parameter("instance", "instance", "beside which", "p_instance_id", required=True),
            Parameter("region", "text", "which one", "p_region", required=True, choices=REGIONS),
            REACH,
            FRAME,
            VIEWER,
        ),
        semap=("unary_relation_test",),
    ),
)

SIZE = (
    Operator(
        "sizes",
        "Areas, perimeters, extents, heights and volumes.",
        (
            Column("instance_id"),
            *(
                Column(name, "number")
                for name in (
                    "area_m2",
                    "perimeter_m",
                    "length_m",
                    "width_m",
                    "extent_x_m",
                    "extent_y_m",
                    "height_m",
                    "volume_m3",
                )
            ),
            Column("volume_of", "text"),
        ),
        ("instance_id",),
        "p_ids",
        semap=("get_geometry_model_bb",),
    ),
    _pairs("larger_than", "What is larger than the references.", *MEASURED, more=MEASURES),
    _pairs("smaller_than", "What is smaller than the references.", *MEASURED, more=MEASURES),
    Operator(
        "padded",
        "The footprints grown by a distance, for navigation.",
        (Column("instance_id"), Column("footprint", "geometry")),
        ("instance_id",),
        "p_ids",
        parameters=(
            Parameter(
                "distance_m", "number", "so far; below zero they shrink", "p_distance_m", required=True
            ),
            Parameter("join", "text", "of corners", "p_join", "round", choices=("round", "mitre", "bevel")),
        ),
        semap=("get_absolute_footprint_polygons",),
    ),
    Operator(
        "extruded",
        "A prism over an area, as the faces of a solid.",
        (Column("prism", "geometry"),),
        (),
        parameters=(
            AREA,
            Parameter("z_min_m", "number", "from this height", "p_z_min_m", required=True),
            Parameter("z_max_m", "number", "up to this height", "p_z_max_m", required=True),
        ),
        semap=("extrude_polygon", "get_object_extrusion"),
    ),
    Operator(
        "united", "The area that all footprints cover together.", (Column("area", "geometry"),), (), "p_ids"
    ),
    Operator(
        "intersected", "The area that is in every footprint.", (Column("area", "geometry"),), (), "p_ids"
    ),
    Operator(
        "subtracted",
        "What is left of the footprints of the references without those of the targets.",
        (Column("reference_id"), Column("footprint", "geometry")),
        ("reference_id",),
        "p_reference_ids",
        "p_target_ids",
    ),
)

AGGREGATE = (
    Operator(
        "contained_in",
        "What is in the references over all levels, each once.",
        (
            Column("container_id"),
            Column("target_id"),
            Column("level", "integer"),
            Column("via_id"),
            Column("link", "text"),
        ),
        ("container_id", "level", "target_id"),
        "p_container_ids",
        "p_target_ids",
        parameters=(Parameter("links", "texts", "of footprint, storey and frame", "p_links"),),
    ),
    Operator(
        "counted_in",
        "How many of the targets are in each reference, over all levels.",
        (Column("container_id"), Column("targets", "integer")),
        ("container_id",),
        "p_container_ids",
        "p_target_ids",
        parameters=(
            Parameter("at_least", "integer", "containers with so many", "p_at_least", 1),
            Parameter("at_most", "integer", "containers with no more", "p_at_most"),
        ),
    ),
    _pairs(
        "joined",
        "Which rooms doors join.",
        CLOSED,
        more=(Column("door_id"),),
        key=("reference_id", "target_id", "door_id"),
    ),
    Operator(
        "route",
        "The shortest way between two rooms, with its doors.",
        (
            Column("step", "integer"),
            Column("room_id", "id"),
            Column("room", "text"),
            Column("door_id", "id"),
            Column("door", "text"),
            Column("length_m", "number"),
            Column("total_m", "number"),
        ),
        ("step",),
        parameters=(
            Parameter("from", "instance", "the room in which it begins", "p_from", required=True),
            Parameter("to", "instance", "the room in which it ends", "p_to", required=True),
            CLOSED,
        ),
    ),
    Operator(
        "reachable",
        "The rooms that can be reached from a room, and how far each is.",
        (
            Column("room_id", "id"),
            Column("room", "text"),
            Column("doors", "integer"),
            Column("total_m", "number"),
        ),
        ("room_id",),
        parameters=(
            Parameter("from", "instance", "the room in which ways begin", "p_from", required=True),
            CLOSED,
        ),
    ),
)

POSE = tuple(Column(name, "number") for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"))

MAINTENANCE = (
    Operator(
        "structure_by_support",
        "Let what lies on a thing be carried by it; nothing moves.",
        OUTCOME,
        ("target_id",),
        "p_reference_ids",
        "p_ids",
        "p_map_id",
        edits=True,
        semap=("structure_by_support",),
    ),
    Operator(
        "structure_by_containment",
        "Let what is in a thing be carried by it; nothing moves.",
        OUTCOME,
        ("target_id",),
        "p_reference_ids",
        "p_ids",
        "p_map_id",
        edits=True,
        semap=("structure_by_containment",),
    ),
    Operator(
        "unstructure",
        "Let things stand on the root of the map again; nothing moves.",
        (Column("target_id"), Column("outcome", "text")),
        ("target_id",),
        targets="p_ids",
        edits=True,
        semap=("unstructure_by_containment",),
    ),
    Operator(
        "transform",
        "a_T_b between two frames, now or at a time: maps points of b to a.",
        POSE,
        (),
        parameters=(
            Parameter("a", "frame", "to this frame", "p_a_id", required=True),
            Parameter("b", "frame", "from this frame", "p_b_id", required=True),
            Parameter("at", "stamp", "then; now without it", "p_at"),
        ),
        semap=("get_transform",),
    ),
    Operator(
        "set_transform",
        "Set where a frame is in its parent, always or from a time on.",
        (),
        (),
        parameters=(
            Parameter("frame", "frame", "which one", "p_frame_id", required=True),
            Parameter("pose", "pose", "parent_T_frame", "p_pose", required=True),
            Parameter("stamp", "stamp", "from then on", "p_stamp"),
        ),
        edits=True,
        semap=("set_transform", "update_transform"),
    ),
    Operator(
        "change_frame",
        "Put a frame below another one.",
        (),
        (),
        parameters=(
            Parameter("frame", "frame", "which one", "p_frame_id", required=True),
            Parameter("parent", "frame", "below which one", "p_parent_id", required=True),
            Parameter("keep_world", "boolean", "it stays where it is in the map", "p_keep_world", True),
        ),
        edits=True,
        semap=("change_frame",),
    ),
    Operator(
        "copy_instance",
        "A copy of an instance under another name.",
        (Column("instance_id"),),
        (),
        parameters=(
            Parameter("instance", "instance", "of which one", "p_instance_id", required=True),
            Parameter("name", "text", "of the copy", "p_name", required=True),
        ),
        edits=True,
        semap=("copy_object_instances",),
    ),
    Operator(
        "delete_instance",
        "Delete an instance; what it carries stays where it is, or goes too.",
        (),
        (),
        parameters=(
            Parameter("instance", "instance", "which one", "p_instance_id", required=True),
            Parameter("with_carried", "boolean", "what it carries goes too", "p_with_carried", False),
        ),
        edits=True,
        semap=("delete_object_instances",),
    ),
    Operator(
        "delete_description",
        "Delete a blueprint; its instances look like another one from then on, or like nothing.",
        (),
        (),
        parameters=(
            Parameter("description", "description", "which one", "p_description_id", required=True),
            Parameter("replacement", "description", "what its instances look like then", "p_replacement_id"),
        ),
        edits=True,
        semap=("delete_object_descriptions",),
    ),
)

OPERATORS: dict[str, Operator] = {
    each.name: each for each in (*TOPOLOGICAL, *METRIC, *DIRECTIONAL, *SIZE, *AGGREGATE, *MAINTENANCE)
}
"""By name, in the order in which they are listed."""

GROUPS: dict[str, tuple[Operator, ...]] = {
    "Topological": TOPOLOGICAL,
    "Metric": METRIC,
    "Directional": DIRECTIONAL,
    "Size and shape": SIZE,
    "Aggregates and ways": AGGREGATE,
    "Structure and maintenance": MAINTENANCE,
}
