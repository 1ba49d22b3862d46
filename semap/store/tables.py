"""The tables of the schema as the migrations leave them, for statements that Python composes.

The migrations own the schema. What only the database itself uses (indexes, checks, defaults) is not
repeated here; a test compares the columns, keys and references with a migrated database.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from geoalchemy2 import Geometry
from sqlalchemy import (
    ARRAY,
    REAL,
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Double,
    FetchedValue,
    ForeignKey,
    Identity,
    Integer,
    LargeBinary,
    MetaData,
    SmallInteger,
    Table,
    Text,
    UniqueConstraint,
    Uuid,
    any_,
    literal,
)
from sqlalchemy.dialects.postgresql import ENUM, INTERVAL, JSONB, TIMESTAMP
from sqlalchemy.types import UserDefinedType

METADATA = MetaData(schema="semap")
VIEWS = MetaData(schema="semap")

STAMP = TIMESTAMP(timezone=True)
SIDES = ("track", "subject_instance", "instance", "object_track")
POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
CHANGE_KIND = ENUM("began", "ended", "crossed", name="change_kind", schema="semap", create_type=False)
CHANGE_CAUSE = ENUM(
    "moved", "appeared", "disappeared", "map", name="change_cause", schema="semap", create_type=False
)


class PgLsn(UserDefinedType[str]):
    """A place in the log of the server."""

    cache_ok = True

    def get_col_spec(self, **_: object) -> str:
        return "pg_lsn"


class RegRole(UserDefinedType[str]):
    """A role of the server, known by its number."""

    cache_ok = True

    def get_col_spec(self, **_: object) -> str:
        return "regrole"


def one_of(column: Column[Any], values: Iterable[object]) -> ColumnElement[bool]:
    """`column = any (values)`: one parameter, however many values there are."""
    return column == any_(literal(list(values), ARRAY(column.type)))


def _id(name: str, type_: type[Integer] = Integer) -> Column[int]:
    return Column(name, type_, Identity(always=True), primary_key=True)


def _ref(
    name: str,
    target: str,
    ondelete: str | None = "CASCADE",
    *,
    nullable: bool = False,
    unique: bool | None = None,
    primary_key: bool = False,
) -> Column[int]:
    key = ForeignKey(f"semap.{target}", ondelete=ondelete)
    return Column(name, key, nullable=nullable, unique=unique, primary_key=primary_key)


def _shape(name: str, *, nullable: bool = False) -> Column[object]:
    return Column(name, Geometry("GEOMETRY", srid=-1, spatial_index=False), nullable=nullable)


def _doubles(*names: str, nullable: bool = False) -> tuple[Column[float], ...]:
    return tuple(Column(name, Double, nullable=nullable) for name in names)


def _reals(*names: str, nullable: bool = False) -> tuple[Column[float], ...]:
    return tuple(Column(name, REAL, nullable=nullable) for name in names)


def _text(name: str, nullable: bool = False) -> Column[str]:
    return Column(name, Text, nullable=nullable)


def _sides() -> tuple[Column[Any], ...]:
    """What a relation is between: of the first two one is given, the subject, and of the others one."""
    return tuple(
        column
        for side in SIDES
        for column in (Column(f"{side}_id", BigInteger), _text(f"{side}_name", nullable=True))
    )


behaviour = Table("behaviour", METADATA, _text("checksum"), Column("applied_at", STAMP, nullable=False))

map_ = Table(
    "map",
    METADATA,
    _id("map_id"),
    Column("uid", Uuid, nullable=False, unique=True),
    Column("name", Text, nullable=False, unique=True),
    Column("cell_m", Double, nullable=False),
    Column("created_at", STAMP, nullable=False),
)

map_anchor = Table(
    "map_anchor",
    METADATA,
    _ref("map_id", "map.map_id", primary_key=True),
    Column("epsg", Integer, nullable=False),
    *_doubles(*POSE),
)

map_grid = Table(
    "map_grid",
    METADATA,
    _ref("map_id", "map.map_id", primary_key=True),
    Column("name", Text, primary_key=True),
    *_doubles("resolution_m", "origin_x_m", "origin_y_m", "origin_yaw_rad"),
    Column("negate", Boolean, nullable=False),
    *_doubles("occupied_thresh", "free_thresh"),
    _text("mode"),
    Column("width", Integer, nullable=False),
    Column("height", Integer, nullable=False),
    Column("pixels", LargeBinary, nullable=False),
)

concept = Table(
    "concept",
    METADATA,
    _id("concept_id"),
    Column("name", Text, nullable=False, unique=True),
    _text("comment", nullable=True),
    Column("attribute_schema", JSONB),
)

concept_parent = Table(
    "concept_parent",
    METADATA,
    _ref("concept_id", "concept.concept_id", primary_key=True),
    _ref("parent_id", "concept.concept_id", primary_key=True),
)

concept_iri = Table(
    "concept_iri",
    METADATA,
    _ref("concept_id", "concept.concept_id", primary_key=True),
    Column("iri", Text, primary_key=True),
)

frame = Table(
    "frame",
    METADATA,
    _id("frame_id", BigInteger),
    _ref("map_id", "map.map_id"),
    _text("name"),
    _ref("parent_id", "frame.frame_id", nullable=True),
    UniqueConstraint("map_id", "name"),
)

frame_pose = Table(
    "frame_pose",
    METADATA,
    _ref("frame_id", "frame.frame_id", primary_key=True),
    Column("stamp", STAMP, primary_key=True),
    *_doubles(*POSE),
)

description = Table(
    "description",
    METADATA,
    _id("description_id", BigInteger),
    _ref("map_id", "map.map_id"),
    _text("name", nullable=True),
    Column("is_absolute", Boolean, nullable=False),
    UniqueConstraint("map_id", "name"),
)

geometry = Table(
    "geometry",
    METADATA,
    _id("geometry_id", BigInteger),
    _ref("description_id", "description.description_id"),
    _text("name"),
    _text("type"),
    _shape("body"),
    *_doubles(*POSE),
    *_doubles("z_min_m", "z_max_m", nullable=True),
    UniqueConstraint("description_id", "name"),
)

abstraction = Table(
    "abstraction",
    METADATA,
    _id("abstraction_id", BigInteger),
    _ref("description_id", "description.description_id"),
    _ref("instance_id", "instance.instance_id", nullable=True),
    _text("type"),
    _shape("geometry"),
    *_doubles("z_min_m", "z_max_m", nullable=True),
    UniqueConstraint("description_id", "type"),
)

instance = Table(
    "instance",
    METADATA,
    _id("instance_id", BigInteger),
    Column("uid", Uuid, nullable=False),
    _ref("map_id", "map.map_id"),
    _text("name"),
    _text("alias", nullable=True),
    _ref("concept_id", "concept.concept_id", None),
    _ref("frame_id", "frame.frame_id", None),
    _ref("relative_description_id", "description.description_id", "SET NULL", nullable=True),
    _ref("absolute_description_id", "description.description_id", None, nullable=True, unique=True),
    _ref("storey_id", "instance.instance_id", "SET NULL", nullable=True),
    Column("attributes", JSONB, nullable=False),
    Column("created_at", STAMP, nullable=False),
    Column("updated_at", STAMP, nullable=False),
    UniqueConstraint("map_id", "name"),
    UniqueConstraint("map_id", "uid"),
)

change_set = Table(
    "change_set",
    METADATA,
    _id("change_set_id", BigInteger),
    Column("made_at", STAMP, nullable=False),
    _text("author"),
    _text("message", nullable=True),
    _ref("undoes_id", "change_set.change_set_id", None, nullable=True),
)

row_version = Table(
    "row_version",
    METADATA,
    _id("version_id", BigInteger),
    _ref("change_set_id", "change_set.change_set_id", None),
    Column("map_id", Integer),
    _text("table_name"),
    _text("row_key"),
    Column("content", JSONB),
    _shape("shape", nullable=True),
)

door_room = Table(
    "door_room",
    METADATA,
    _ref("door_id", "instance.instance_id", primary_key=True),
    _ref("room_id", "instance.instance_id", primary_key=True),
)

source = Table(
    "source",
    METADATA,
    _id("source_id"),
    _ref("map_id", "map.map_id"),
    _text("name"),
    Column("watermark", STAMP),
    Column("newest_stamp", STAMP),
    Column("newest_is_whole", Boolean, nullable=False),
    Column("late_states", BigInteger, nullable=False),
    Column("lateness", INTERVAL, nullable=False),
    Column("idle", Boolean, nullable=False),
    Column("ended", Boolean, nullable=False),
    *_doubles("jump_m", nullable=True),
    *_doubles("jump_mps"),
    Column("outliers", BigInteger, nullable=False),
    UniqueConstraint("map_id", "name"),
)

source_count = Table(
    "source_count",
    METADATA,
    _ref("source_id", "source.source_id", primary_key=True),
    Column("track_states", BigInteger, nullable=False),
    Column("lines", BigInteger, nullable=False),
    Column("object_states", BigInteger, nullable=False),
    Column("received_at", STAMP, nullable=False),
    *(Column(name, STAMP, nullable=False) for name in ("frame_stamp", "placed_stamp")),
    Column("frame_tracks", Integer),
    Column("frame_track_ids", ARRAY(BigInteger)),
)

recording = Table(
    "recording",
    METADATA,
    _id("recording_id"),
    _ref("source_id", "source.source_id"),
    _text("fingerprint"),
    _text("path"),
    Column("states_total", BigInteger),
    Column("states_done", BigInteger, nullable=False),
    Column("started_at", STAMP, nullable=False),
    Column("finished_at", STAMP),
    UniqueConstraint("source_id", "fingerprint"),
)

track = Table(
    "track",
    METADATA,
    _id("track_id", BigInteger),
    Column("uid", Uuid, nullable=False, unique=True),
    _ref("source_id", "source.source_id"),
    _ref("map_id", "map.map_id"),
    _text("name"),
    Column("ended_at", STAMP),
    _ref("concept_id", "concept.concept_id", None, nullable=True),
    Column("attributes", JSONB, nullable=False),
    UniqueConstraint("source_id", "name"),
)

track_state = Table(
    "track_state",
    METADATA,
    Column("track_id", BigInteger, nullable=False),
    Column("stamp", STAMP, nullable=False),
    *_doubles("x_m", "y_m"),
    *_doubles("z_m", nullable=True),
    Column("std_m", REAL),
    Column("is_last", Boolean, nullable=False),
    *_reals("heading_rad", "speed_mps", "length_m", "width_m", nullable=True),
    *_reals("std_across_m", "std_yaw_rad", nullable=True),
)

state_chunk = Table(
    "state_chunk",
    METADATA,
    Column("source_id", Integer, nullable=False),
    Column("track_id", BigInteger),
    Column("from_stamp", STAMP, nullable=False),
    Column("to_stamp", STAMP, nullable=False),
    Column("states", Integer, nullable=False),
    Column("track_ids", ARRAY(BigInteger)),
    Column("offsets_us", ARRAY(Integer)),
    *(
        Column(each.name, ARRAY(each.type), nullable=each.name not in ("x_m", "y_m"))
        for each in track_state.c
        if each.name not in ("track_id", "stamp")
    ),
)

track_now = Table(
    "track_now",
    METADATA,
    Column(
        "track_id",
        ForeignKey("semap.track.track_id", deferrable=True, initially="DEFERRED"),
        primary_key=True,
    ),
    Column("source_id", Integer, nullable=False),
    Column("map_id", Integer, nullable=False),
    *_doubles("cell_m"),
    Column("live", Boolean, nullable=False),
    Column("first_stamp", STAMP, nullable=False),
    Column("stamp", STAMP, nullable=False),
    *_doubles("x_m", "y_m", "z_m", nullable=True),
    Column("std_m", REAL),
    *(Column(name, ARRAY(Integer), nullable=False) for name in ("region_ids", "careful_ids")),
    *_reals("calm_std_m"),
    Column("calm_until", STAMP, nullable=False),
    Column("outlier_stamp", STAMP),
    *_doubles("outlier_x_m", "outlier_y_m", nullable=True),
    *_doubles("calm_x_min_m", "calm_x_max_m", "calm_y_min_m", "calm_y_max_m"),
    *_doubles("calm_z_min_m", "calm_z_max_m", nullable=True),
    *_reals("heading_rad", "speed_mps", "length_m", "width_m", nullable=True),
    *_reals("std_across_m", "std_yaw_rad", nullable=True),
)

track_place = Table(
    "track_place",
    VIEWS,
    *(
        Column(each.name, each.type)
        for each in track_now.c
        if each.name != "cell_m" and not each.name.startswith(("calm_", "outlier_"))
    ),
)

track_amendment = Table(
    "track_amendment",
    METADATA,
    _id("track_amendment_id", BigInteger),
    Column("map_id", Integer, nullable=False),
    Column("source_id", Integer, nullable=False),
    _ref("track_id", "track.track_id"),
    _ref("other_track_id", "track.track_id"),
    _text("kind"),
    Column("since", STAMP, nullable=False),
    Column("found", STAMP, nullable=False),
    Column("received_at", STAMP, nullable=False),
    UniqueConstraint("track_id", "other_track_id", "kind", "since"),
)

line_observation = Table(
    "line_observation",
    METADATA,
    Column("source_id", Integer, nullable=False),
    Column("stamp", STAMP, nullable=False),
    *_doubles("x1_m", "y1_m", "x2_m", "y2_m"),
    *_doubles("z_m", nullable=True),
    *_reals("angle_std_rad", "offset_std_m"),
    Column("points", Integer, nullable=False),
)

door_leaf = Table(
    "door_leaf",
    METADATA,
    _ref("instance_id", "instance.instance_id", primary_key=True),
    Column("map_id", Integer, nullable=False),
    *_doubles("hinge_x_m", "hinge_y_m", "closed_rad"),
    Column("sense", SmallInteger, nullable=False),
    *_doubles("width_m", "max_rad", "z_min_m", "z_max_m"),
    *_doubles("opening_above_rad", "open_from_rad", "turns_by_rad", "closed_below_rad", "rests_within_rad"),
    Column("rests_for", INTERVAL, nullable=False),
    _shape("range_of_motion"),
)

door_now = Table(
    "door_now",
    METADATA,
    _ref("instance_id", "door_leaf.instance_id", primary_key=True),
    Column("stamp", STAMP, nullable=False),
    _text("state", nullable=True),
    Column("since", STAMP),
    *_doubles("angle_rad", "angle_std_rad", "extreme_rad", "rest_rad", nullable=True),
    Column("rest_since", STAMP),
    _text("doubt", nullable=True),
)

continuous_query = Table(
    "continuous_query",
    METADATA,
    _id("query_id"),
    _ref("map_id", "map.map_id"),
    _text("name"),
    _text("predicate"),
    _ref("object_concept_id", "concept.concept_id", None, nullable=True),
    Column("object_uids", ARRAY(Uuid)),
    Column("object_where", JSONB(none_as_null=True)),
    _ref("subject_concept_id", "concept.concept_id", None, nullable=True),
    Column("subject_uids", ARRAY(Uuid)),
    Column("subject_where", JSONB(none_as_null=True)),
    *_doubles("distance_m", nullable=True),
    _text("abstraction"),
    Column("dimensions", SmallInteger, nullable=False),
    *_doubles("enter_margin_m", "leave_margin_m"),
    *(Column(name, INTERVAL, nullable=False) for name in ("enter_confirm", "leave_confirm")),
    *_doubles("enter_probability", "leave_probability", "widest_std_m", nullable=True),
    Column("longest_gap", INTERVAL),
    *_doubles("fastest_mps", nullable=True),
    Column("payload", JSONB, nullable=False),
    _text("sql", nullable=True),
    Column("enabled", Boolean, nullable=False),
    *(_text(name) for name in ("subject_kind", "object_kind")),
    Column("count", Integer),
    *_doubles("angle_rad", "speed_mps", nullable=True),
    _text("direction", nullable=True),
    Column("in_pairs", Boolean, nullable=False, server_default=FetchedValue()),
    UniqueConstraint("map_id", "name"),
)

query_request = Table(
    "query_request",
    METADATA,
    _id("request_id", BigInteger),
    _ref("map_id", "map.map_id"),
    *(_text(name) for name in ("name", "sql")),
    Column("asked_by", Text, FetchedValue(), nullable=False),
    Column("asked_at", STAMP, FetchedValue(), nullable=False),
    Column("answered_at", STAMP),
    Column("query_id", Integer),
    Column("refusal", JSONB),
)

query_track = Table(
    "query_track",
    METADATA,
    _ref("query_id", "continuous_query.query_id", primary_key=True),
    _ref("track_id", "track.track_id", primary_key=True),
    Column("map_id", Integer, nullable=False),
)

region = Table(
    "region",
    METADATA,
    _id("region_id"),
    Column("query_id", Integer, nullable=False),
    _text("query_name"),
    Column("instance_id", BigInteger, nullable=False),
    Column("instance_uid", Uuid, nullable=False),
    _text("instance_name"),
    Column("map_id", Integer, nullable=False),
    _shape("footprint"),
    *_doubles("z_min_m", "z_max_m"),
    _text("predicate"),
    *(_shape(name, nullable=True) for name in ("shape", "core", "reach")),
    *_doubles("distance_m", nullable=True),
    *(Column(name, INTERVAL, nullable=False) for name in ("enter_confirm", "leave_confirm")),
    *_doubles("enter_stds", "leave_stds", "widest_std_m", nullable=True),
    Column("longest_gap", INTERVAL),
    *_doubles("fastest_mps", nullable=True),
    _text("subject", nullable=True),
    Column("careful", Boolean, nullable=False),
    Column("formed_stamp", STAMP, nullable=False),
    Column("formed_track_id", BigInteger, nullable=False),
    UniqueConstraint("query_id", "instance_id"),
)

region_cell = Table(
    "region_cell",
    METADATA,
    Column("map_id", Integer, primary_key=True, autoincrement=False),
    Column("cell_x", Integer, primary_key=True, autoincrement=False),
    Column("cell_y", Integer, primary_key=True, autoincrement=False),
    _ref("region_id", "region.region_id", primary_key=True),
    *(Column(name, Boolean, nullable=False) for name in ("whole", "careful")),
    *_doubles("z_min_m", "z_max_m"),
)

region_edge = Table(
    "region_edge",
    METADATA,
    Column("map_id", Integer, nullable=False),
    Column("cell_x", Integer, nullable=False),
    Column("cell_y", Integer, nullable=False),
    _ref("region_id", "region.region_id"),
    *_doubles("x_min_m", "x_max_m", "y_min_m", "y_max_m"),
    *_reals("stds"),
)

verge = Table(
    "verge",
    METADATA,
    _ref("track_id", "track.track_id", primary_key=True),
    _ref("region_id", "region.region_id", primary_key=True),
    Column("map_id", Integer, nullable=False),
    *(Column(name, Boolean, nullable=False) for name in ("held", "inside", "side")),
    *(Column(name, STAMP) for name in ("inside_at", "side_at")),
    *_doubles("x_m", "y_m", nullable=True),
)

relation = Table(
    "relation",
    METADATA,
    Column("track_id", BigInteger, primary_key=True, autoincrement=False),
    Column("region_id", Integer, primary_key=True, autoincrement=False),
    Column("query_id", Integer, nullable=False),
    Column("instance_id", BigInteger, nullable=False),
    Column("map_id", Integer, nullable=False),
    Column("since", STAMP, nullable=False),
)

pair = Table(
    "pair",
    METADATA,
    _id("pair_id", BigInteger),
    *(Column(name, Integer, nullable=False) for name in ("map_id", "query_id")),
    *(Column(f"{side}_id", BigInteger) for side in SIDES),
    Column("held", Boolean, nullable=False),
    Column("since", STAMP),
    Column("inside", Boolean, nullable=False),
    Column("inside_at", STAMP),
    *_doubles("distance_m", nullable=True),
    Column("distance_at", STAMP),
    *(
        Column(f"{side}_key", BigInteger, nullable=False, server_default=FetchedValue())
        for side in ("subject", "object")
    ),
    UniqueConstraint("query_id", "subject_key", "object_key"),
)

pair_member = Table(
    "pair_member",
    METADATA,
    Column("key", BigInteger, primary_key=True, autoincrement=False, server_default=FetchedValue()),
    Column("query_id", Integer, primary_key=True, autoincrement=False),
    Column("is_object", Boolean, primary_key=True),
    Column("map_id", Integer, nullable=False),
    _text("query_name"),
    *(Column(f"{thing}_id", BigInteger) for thing in ("track", "instance")),
    Column("uid", Uuid, nullable=False),
    _text("name"),
    Column("stamp", STAMP),
    *(_shape(name, nullable=True) for name in ("place", "shape", "box")),
    *_doubles("z_min_m", "z_max_m", "yaw_rad", nullable=True),
    Column("formed_stamp", STAMP, nullable=False, server_default=FetchedValue()),
    Column("formed_track_id", BigInteger, nullable=False, server_default=FetchedValue()),
)

pair_progress = Table(
    "pair_progress",
    METADATA,
    Column("map_id", ForeignKey("semap.map.map_id", ondelete="CASCADE"), primary_key=True),
    Column("through", STAMP, nullable=False),
)

track_end = Table(
    "track_end",
    METADATA,
    Column("track_id", ForeignKey("semap.track.track_id", ondelete="CASCADE"), primary_key=True),
    Column("stamp", STAMP, primary_key=True),
)

pair_form = Table(
    "pair_form",
    METADATA,
    Column("query_id", ForeignKey("semap.continuous_query.query_id", ondelete="CASCADE"), primary_key=True),
    Column("map_id", Integer, nullable=False),
    Column("formed_stamp", STAMP, nullable=False),
    Column("formed_track_id", BigInteger, nullable=False),
)

relation_change = Table(
    "relation_change",
    METADATA,
    _id("change_id", BigInteger),
    Column("uid", Uuid, nullable=False, unique=True),
    Column("map_id", Integer, nullable=False),
    Column("query_id", Integer, nullable=False),
    _text("query_name"),
    *_sides(),
    Column("kind", CHANGE_KIND, nullable=False),
    Column("cause", CHANGE_CAUSE, nullable=False),
    Column("stamp", STAMP, nullable=False),
    Column("since", STAMP, nullable=False),
    Column("received_at", STAMP, nullable=False),
    Column("edge_at", STAMP, nullable=False),
    *_doubles("x_m", "y_m", nullable=True),
    _text("direction", nullable=True),
    Column("door_id", BigInteger),
    _text("door_name", nullable=True),
    Column("edge", Integer),
    _text("amendment", nullable=True),
    Column("retracts", Uuid),
)

relation_past = Table(
    "relation_past",
    METADATA,
    _id("relation_past_id", BigInteger),
    *(Column(name, Integer, nullable=False) for name in ("map_id", "query_id")),
    _text("query_name"),
    *_sides(),
    *(Column(name, STAMP, nullable=False) for name in ("since", "until")),
)

object_state = Table(
    "object_state",
    METADATA,
    _id("object_state_id", BigInteger),
    Column("uid", Uuid, nullable=False, unique=True),
    Column("map_id", Integer, nullable=False),
    _ref("source_id", "source.source_id"),
    Column("instance_id", BigInteger, nullable=False),
    *(_text(name) for name in ("instance_name", "property", "value")),
    _text("previous", nullable=True),
    Column("stamp", STAMP, nullable=False),
    Column("since", STAMP),
    Column("attributes", JSONB, nullable=False),
    Column("received_at", STAMP, nullable=False),
)

rule = Table(
    "rule",
    METADATA,
    _id("rule_id"),
    _ref("map_id", "map.map_id"),
    _text("name"),
    Column("version", Integer, nullable=False),
    Column("declaration", JSONB, nullable=False),
    Column("enabled", Boolean, nullable=False),
    Column("queries", JSONB, nullable=False),
    Column("backfill_from", STAMP),
    Column("seam", JSONB),
    UniqueConstraint("map_id", "name"),
)

rule_query = Table(
    "rule_query",
    METADATA,
    _ref("rule_id", "rule.rule_id", primary_key=True),
    Column(
        "query_id",
        ForeignKey("semap.continuous_query.query_id", deferrable=True, initially="DEFERRED"),
        primary_key=True,
    ),
)

rule_given_up = Table(
    "rule_given_up",
    VIEWS,
    Column("rule_id", Integer),
    Column("map_id", Integer),
    Column("attempts", BigInteger),
    Column("first", STAMP),
    Column("key", JSONB),
)

rule_version = Table(
    "rule_version",
    METADATA,
    Column("rule_id", Integer, primary_key=True, autoincrement=False),
    Column("version", Integer, primary_key=True, autoincrement=False),
    _ref("map_id", "map.map_id"),
    _text("name"),
    Column("declaration", JSONB, nullable=False),
    Column("declared_at", STAMP, nullable=False),
)

progress = Table(
    "progress",
    METADATA,
    Column("worker", Text, primary_key=True),
    Column("lsn", PgLsn, nullable=False),
    Column("event_seq", BigInteger, nullable=False),
    Column("rule_state", JSONB, nullable=False),
    Column("watermarks", JSONB, nullable=False),
    Column("updated_at", STAMP, nullable=False),
    Column("late_rows", BigInteger, nullable=False),
    Column("alive_at", STAMP, nullable=False),
)

rule_state = Table(
    "rule_state",
    METADATA,
    Column("worker", Text, primary_key=True),
    Column("rule_id", Integer, primary_key=True, autoincrement=False),
    Column("key", Text, primary_key=True),
    Column("state", JSONB, nullable=False),
)

pending_row = Table(
    "pending_row",
    METADATA,
    Column("worker", Text, primary_key=True),
    Column("map_id", Integer, primary_key=True, autoincrement=False),
    Column("uid", Text, primary_key=True),
    Column("row", JSONB, nullable=False),
)

late_row = Table(
    "late_row",
    METADATA,
    _id("late_row_id", BigInteger),
    Column("map_id", Integer, nullable=False),
    _text("uid"),
    _text("input"),
    Column("stamp", STAMP, nullable=False),
    Column("watermark", STAMP, nullable=False),
    Column("row", JSONB, nullable=False),
    Column("received_at", STAMP, nullable=False),
    Column("replayed_at", STAMP),
    UniqueConstraint("map_id", "uid"),
)

event = Table(
    "event",
    METADATA,
    Column("seq", BigInteger, primary_key=True, autoincrement=False),
    Column("event_id", Uuid, nullable=False, unique=True),
    Column("map_id", Integer, nullable=False),
    _text("rule_name"),
    Column("rule_version", Integer, nullable=False),
    _text("type"),
    Column("stamp", STAMP, nullable=False),
    _text("cause", nullable=True),
    Column("track_id", BigInteger),
    _text("track_name", nullable=True),
    Column("instance_id", BigInteger),
    _text("instance_name", nullable=True),
    Column("since", STAMP, nullable=False),
    Column("created_at", STAMP, nullable=False),
    Column("key", JSONB, nullable=False),
    Column("measures", JSONB, nullable=False),
    Column("confidence", Double),
    Column("by_batch", Boolean, nullable=False),
)

event_number = Table(
    "event_number",
    METADATA,
    Column("event_id", ForeignKey("semap.event.event_id", ondelete="CASCADE"), primary_key=True),
    Column("map_id", Integer, nullable=False),
    Column("number", BigInteger, nullable=False),
    UniqueConstraint("map_id", "number"),
)

event_count = Table(
    "event_count",
    METADATA,
    Column("map_id", Integer, primary_key=True, autoincrement=False),
    Column("newest", BigInteger, nullable=False),
)

event_evidence = Table(
    "event_evidence",
    METADATA,
    Column("event_id", ForeignKey("semap.event.event_id"), primary_key=True),
    Column("uid", Uuid, nullable=False),
    Column("place", Integer, primary_key=True, autoincrement=False),
    _text("variable"),
    _text("source"),
    Column("stamp", STAMP, nullable=False),
)

retention = Table(
    "retention",
    METADATA,
    Column("kind", Text, primary_key=True),
    Column("pack_after", INTERVAL),
    Column("drop_after", INTERVAL),
    Column("gone_before", STAMP),
)

recompute_run = Table(
    "recompute_run",
    METADATA,
    _id("run_id"),
    Column("map_id", Integer, nullable=False),
    Column("from_stamp", STAMP, nullable=False),
    Column("to_stamp", STAMP, nullable=False),
    Column("settings", JSONB, nullable=False),
    Column("started_at", STAMP, nullable=False),
    Column("finished_at", STAMP),
    Column("counts", JSONB, nullable=False),
)

event_amendment = Table(
    "event_amendment",
    METADATA,
    Column("event_id", ForeignKey("semap.event.event_id", ondelete="CASCADE"), primary_key=True),
    _text("verdict"),
    Column("by_event_id", ForeignKey("semap.event.event_id", ondelete="CASCADE")),
    _ref("run_id", "recompute_run.run_id"),
    Column("amended_at", STAMP, nullable=False),
)

job = Table(
    "job",
    METADATA,
    _id("job_id"),
    _text("kind"),
    _text("map", nullable=True),
    _text("file"),
    _text("state"),
    Column("cancel_requested", Boolean, nullable=False),
    Column("progress", REAL, nullable=False),
    _text("message"),
    Column("result", JSONB(none_as_null=True)),
    Column("problem", JSONB(none_as_null=True)),
    Column("token_id", BigInteger),
    _text("created_by"),
    Column("created_at", STAMP, nullable=False),
    Column("finished_at", STAMP),
)

webhook = Table(
    "webhook",
    METADATA,
    _id("webhook_id"),
    _text("url"),
    _text("description"),
    Column("maps", ARRAY(Text)),
    _text("event_type", nullable=True),
    _text("rule_name", nullable=True),
    _text("filter", nullable=True),
    _text("state"),
    _text("state_reason"),
    Column("cursor", BigInteger, nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("next_attempt_at", STAMP, nullable=False),
    Column("given_up_in_row", Integer, nullable=False),
    Column("delivered_count", BigInteger, nullable=False),
    Column("failed_count", BigInteger, nullable=False),
    Column("last_delivered_at", STAMP),
    _text("last_error"),
    Column("last_error_at", STAMP),
    _text("created_by"),
    Column("created_at", STAMP, nullable=False),
)

webhook_secret = Table(
    "webhook_secret",
    METADATA,
    _id("webhook_secret_id"),
    Column("webhook_id", ForeignKey("semap.webhook.webhook_id", ondelete="CASCADE"), nullable=False),
    Column("secret", LargeBinary, nullable=False),
    Column("created_at", STAMP, nullable=False),
    Column("expires_at", STAMP),
)

webhook_dead_letter = Table(
    "webhook_dead_letter",
    METADATA,
    _id("webhook_dead_letter_id", BigInteger),
    Column("webhook_id", ForeignKey("semap.webhook.webhook_id", ondelete="CASCADE"), nullable=False),
    Column("seq", BigInteger, nullable=False),
    Column("event_id", Uuid, nullable=False),
    _text("map"),
    _text("type"),
    _text("body"),
    Column("attempts", Integer, nullable=False),
    _text("error"),
    Column("status", SmallInteger),
    Column("given_up_at", STAMP, nullable=False),
    Column("resend_requested_at", STAMP),
    UniqueConstraint("webhook_id", "seq"),
)

token = Table(
    "token",
    METADATA,
    _id("token_id"),
    _text("name"),
    Column("hash", LargeBinary, nullable=False, unique=True),
    _text("hint"),
    Column("scopes", ARRAY(Text), nullable=False),
    Column("all_maps", Boolean, nullable=False),
    Column("created_at", STAMP, nullable=False),
    _text("created_by"),
    Column("expires_at", STAMP),
    Column("last_used_at", STAMP),
    Column("revoked_at", STAMP),
)

token_map = Table(
    "token_map",
    METADATA,
    _ref("token_id", "token.token_id", primary_key=True),
    _ref("map_id", "map.map_id", primary_key=True),
)

login_map = Table(
    "login_map",
    METADATA,
    Column("login", RegRole, primary_key=True),
    _ref("map_id", "map.map_id", primary_key=True),
)
