"""Relations of any two sides; crossings of lines; places of crossings; changes that are taken back."""

from alembic import op

revision = "0016"
down_revision = "0015"

QUERY = (
    """
    alter table semap.continuous_query
      drop constraint predicate_is_known,
      drop constraint distance_is_given,
      add constraint predicate_is_known check (predicate in (
        'contains', 'covers', 'intersects', 'within_distance', 'nearest', 'on', 'in_front_of', 'behind',
        'left_of', 'right_of', 'crosses', 'facing', 'approaching')),
      add column subject_kind text not null default 'track' check (subject_kind in ('track', 'instance')),
      add column object_kind text not null default 'instance' check (object_kind in ('track', 'instance')),
      add column count integer check (count between 1 and 100),
      add column angle_rad double precision check (angle_rad > 0 and angle_rad <= pi()),
      add column speed_mps double precision check (speed_mps > 0),
      add column direction text check (direction in ('left_to_right', 'right_to_left')),
      add constraint count_is_given check ((count is not null) = (predicate = 'nearest')),
      add constraint angle_is_given check ((angle_rad is not null) = (predicate = 'facing')),
      add constraint speed_is_given check ((speed_mps is not null) = (predicate = 'approaching')),
      add constraint only_lines_have_a_direction check (direction is null or predicate = 'crosses'),
      add constraint distance_is_given check (case
        when predicate in ('within_distance', 'in_front_of', 'behind', 'left_of', 'right_of', 'approaching')
          then distance_m is not null
        when predicate in ('nearest', 'facing') then true
        else distance_m is null end)
    """,
    # what the regions cannot answer, which ask only where a track is
    """
    alter table semap.continuous_query
      add column in_pairs boolean not null generated always as (
        subject_kind = 'instance' or object_kind = 'track'
        or predicate in ('intersects', 'nearest', 'crosses', 'facing', 'approaching')) stored
    """,
    # two things that a query follows: held is the relation, inside what it follows once that has lasted
    """
    create table semap.pair (
      pair_id              bigint generated always as identity primary key,
      map_id               integer not null,
      query_id             integer not null,
      track_id             bigint,
      subject_instance_id  bigint,
      instance_id          bigint,
      object_track_id      bigint,
      held                 boolean not null,
      since                timestamptz,
      inside               boolean not null,
      inside_at            timestamptz,
      distance_m           double precision,
      distance_at          timestamptz,
      subject_key          bigint not null
        generated always as (coalesce(track_id, -subject_instance_id)) stored,
      object_key           bigint not null
        generated always as (coalesce(object_track_id, -instance_id)) stored,
      unique (query_id, subject_key, object_key),
      check (num_nonnulls(track_id, subject_instance_id) = 1),
      check (num_nonnulls(instance_id, object_track_id) = 1),
      check (held = (since is not null))
    )
    """,
    "create index pair_subject on semap.pair (subject_key)",
    "create index pair_object on semap.pair (object_key)",
    "create index continuous_query_in_pairs on semap.continuous_query (map_id) where in_pairs",
    # who takes part in a query, on which side, and where it is; boxes of tracks are wider, so that a step
    # within one leaves the index alone
    """
    create table semap.pair_member (
      key          bigint not null generated always as (coalesce(track_id, -instance_id)) stored,
      query_id     integer not null,
      is_object    boolean not null,
      map_id       integer not null,
      query_name   text not null,
      track_id     bigint,
      instance_id  bigint,
      uid          uuid not null,
      name         text not null,
      stamp        timestamptz,
      place        public.geometry,
      shape        public.geometry,
      box          public.geometry,
      z_min_m      double precision,
      z_max_m      double precision,
      yaw_rad      double precision,
      primary key (key, query_id, is_object),
      check (num_nonnulls(track_id, instance_id) = 1)
    ) with (fillfactor = 50)
    """,
    "create index pair_member_query on semap.pair_member (query_id, is_object)",
    "create index pair_member_box on semap.pair_member using gist (box public.gist_geometry_ops_nd)",
    # a change of a pair as it is found, before it is written
    """
    create type semap.pair_change as (
      query_id integer, subject_key bigint, object_key bigint, kind text, cause semap.change_cause,
      stamp timestamptz, edge_at timestamptz, since timestamptz,
      x_m double precision, y_m double precision, direction text
    )
    """,
    # lines that are drawn, to be crossed
    """
    alter table semap.abstraction
      drop constraint abstraction_is_of_its_type,
      add constraint abstraction_is_of_its_type
        check (case
                 when type in ('Footprint', 'FootprintHull', 'FootprintBox', 'AxisAligned2D')
                   then geometrytype(geometry) in ('POLYGON', 'MULTIPOLYGON')
                        and not st_isempty(geometry) and st_isvalid(geometry)
                 when type = 'Line' then geometrytype(geometry) in ('LINESTRING', 'MULTILINESTRING')
                   and st_zmflag(geometry) = 0 and not st_isempty(geometry) and st_length(geometry) > 0
                 when type = 'Position2D' then geometrytype(geometry) = 'POINT' and st_zmflag(geometry) = 0
                 when type = 'Position3D' then geometrytype(geometry) = 'POINT' and st_zmflag(geometry) = 2
                 when type in ('AxisAligned3D', 'BoundingBox', 'BoundingHull')
                   then geometrytype(geometry) = 'TIN'
                 else false
               end)
    """,
)
CHANGE = (
    "alter type semap.change_kind add value 'crossed'",
    """
    alter table semap.relation_change
      alter track_id drop not null,
      alter track_name drop not null,
      alter instance_id drop not null,
      alter instance_name drop not null,
      add column subject_instance_id bigint,
      add column subject_instance_name text,
      add column object_track_id bigint,
      add column object_track_name text,
      add column direction text check (direction in ('left_to_right', 'right_to_left')),
      add column door_id bigint,
      add column door_name text,
      add column edge integer,
      add column amendment text check (amendment in ('added', 'retracted')),
      add column retracts uuid,
      add constraint subject_is_one_thing check (num_nonnulls(track_id, subject_instance_id) = 1),
      add constraint object_is_one_thing check (num_nonnulls(instance_id, object_track_id) = 1),
      add constraint retraction_says_what
        check ((retracts is not null) = (amendment is not distinct from 'retracted'))
    """,
    "create index relation_change_retracts on semap.relation_change (retracts) where retracts is not null",
    """
    alter table semap.relation_past
      alter track_id drop not null,
      alter track_name drop not null,
      alter instance_id drop not null,
      alter instance_name drop not null,
      add column subject_instance_id bigint,
      add column subject_instance_name text,
      add column object_track_id bigint,
      add column object_track_name text,
      add check (num_nonnulls(track_id, subject_instance_id) = 1),
      add check (num_nonnulls(instance_id, object_track_id) = 1)
    """,
    "create index relation_past_object_track on semap.relation_past (object_track_id)"
    " where object_track_id is not null",
)

# How many live tracks a source has is asked of it alone, however many others its map has.
TRACK_NOW = (
    "drop index semap.track_now_live",
    "create index track_now_live on semap.track_now (map_id, source_id) where live",
)


def upgrade() -> None:
    for statement in (*QUERY, *CHANGE, *TRACK_NOW):
        op.execute(statement)
