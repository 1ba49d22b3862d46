"""Continuous queries of any predicate; when an edge was, beside when it was known; stays that are over."""

from alembic import op

revision = "0014"
down_revision = "0013"

QUERY = (
    "alter table semap.continuous_query drop constraint continuous_query_predicate_check",
    """
    alter table semap.continuous_query
      add constraint predicate_is_known check (predicate in (
        'contains', 'covers', 'within_distance', 'on', 'in_front_of', 'behind', 'left_of', 'right_of')),
      alter object_concept_id drop not null,
      add column object_uids uuid[],
      add column object_where jsonb check (jsonb_typeof(object_where) = 'object'),
      add column subject_concept_id integer references semap.concept,
      add column subject_uids uuid[],
      add column subject_where jsonb check (jsonb_typeof(subject_where) = 'object'),
      add column distance_m double precision check (distance_m > 0 and distance_m <= 1e4),
      add column abstraction text not null default 'Footprint',
      add column dimensions smallint not null default 3 check (dimensions in (2, 3)),
      add column enter_margin_m double precision not null default 0 check (enter_margin_m between 0 and 100),
      add column leave_margin_m double precision not null default 0 check (leave_margin_m between 0 and 100),
      add column enter_confirm interval not null default '0' check (enter_confirm between '0' and '1 day'),
      add column leave_confirm interval not null default '0' check (leave_confirm between '0' and '1 day'),
      add column enter_probability double precision
        check (enter_probability >= 0.5 and enter_probability < 1),
      add column leave_probability double precision
        check (leave_probability > 0 and leave_probability <= 0.5),
      add column widest_std_m double precision check (widest_std_m > 0 and widest_std_m <= 100),
      add column longest_gap interval check (longest_gap > '0' and longest_gap <= '1 day'),
      add column fastest_mps double precision check (fastest_mps > 0),
      add column payload jsonb not null default '{}',
      add column sql text,
      add constraint distance_is_given check ((distance_m is not null) = (predicate in (
        'within_distance', 'in_front_of', 'behind', 'left_of', 'right_of'))),
      add constraint probabilities_are_both_given
        check ((enter_probability is null) = (leave_probability is null)
               and (enter_probability is null) = (widest_std_m is null)),
      add constraint gap_and_speed_are_both_given check ((longest_gap is null) = (fastest_mps is null))
    """,
)
REGION = (
    """
    alter table semap.region
      add column predicate text not null default 'contains',
      add column shape public.geometry,
      add column distance_m double precision,
      add column core public.geometry,
      add column reach public.geometry,
      add column enter_confirm interval not null default '0',
      add column leave_confirm interval not null default '0',
      add column enter_stds double precision,
      add column leave_stds double precision,
      add column longest_gap interval,
      add column fastest_mps double precision,
      add column widest_std_m double precision,
      add column subject text,
      add column careful boolean not null default false
    """,
    "create index region_careful on semap.region using gist (footprint) where careful",
    "create index region_careful_map on semap.region (map_id) where careful",
    "alter table semap.region_cell add column careful boolean not null default false",
    "alter table semap.region_edge add column stds real not null default 0",
)
CHANGE = (
    # a crossing as it is found, before it is written
    """
    alter type semap.crossing
      add attribute edge_at timestamptz,
      add attribute x_m double precision, add attribute y_m double precision
    """,
    # a state, with what is known of its track before it
    """
    create type semap.arrival as (
      track_id bigint, stamp timestamptz, x_m double precision, y_m double precision, z_m double precision,
      std_m real, heading_rad real, speed_mps real, length_m real, width_m real, is_last boolean,
      source_id integer, map_id integer, cell_m double precision, live boolean, seen_stamp timestamptz,
      from_x_m double precision, from_y_m double precision, from_z_m double precision, region_ids integer[],
      outlier_stamp timestamptz
    )
    """,
    """
    alter table semap.relation_change
      add column edge_at timestamptz,
      add column x_m double precision,
      add column y_m double precision
    """,
    "update semap.relation_change set edge_at = stamp",
    """
    alter table semap.relation_change
      alter edge_at set not null,
      drop constraint relation_change_check,
      drop constraint relation_change_check1,
      add constraint edge_is_known_later check (edge_at <= stamp),
      add constraint began_before check (since <= edge_at),
      add constraint beginning_is_since check (kind = 'ended' or since = edge_at)
    """,
    "drop index semap.relation_change_stamp",
    "drop index semap.relation_change_stay",
    """
    create table semap.relation_past (
      relation_past_id  bigint generated always as identity primary key,
      map_id         integer not null,
      query_id       integer not null,
      query_name     text not null,
      track_id       bigint not null,
      track_name     text not null,
      instance_id    bigint not null,
      instance_name  text not null,
      since          timestamptz not null,
      until          timestamptz not null,
      check (since <= until)
    )
    """,
    """
    insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name,
                                     instance_id, instance_name, since, until)
    select map_id, query_id, query_name, track_id, track_name, instance_id, instance_name, since, stamp
    from semap.relation_change where kind = 'ended' order by change_id
    """,
    "create index relation_past_stay on semap.relation_past using gist (tstzrange(since, until, '[]'))",
    "create index relation_past_track on semap.relation_past (track_id)",
)
TRACK = (
    """
    alter table semap.track
      add column concept_id integer references semap.concept,
      add column attributes jsonb not null default '{}' check (jsonb_typeof(attributes) = 'object')
    """,
    # which tracks a query with conditions on its subject is about
    """
    create table semap.query_track (
      query_id  integer not null references semap.continuous_query on delete cascade,
      track_id  bigint not null references semap.track on delete cascade,
      map_id    integer not null,
      primary key (query_id, track_id)
    )
    """,
    "create index query_track_track on semap.query_track (track_id)",
    # where a track near a region's boundary stands: to that, as debounced, and in the relation
    """
    create table semap.verge (
      track_id   bigint not null references semap.track on delete cascade,
      region_id  integer not null references semap.region on delete cascade,
      map_id     integer not null,
      held       boolean not null,
      inside     boolean not null,
      inside_at  timestamptz,
      side       boolean not null,
      side_at    timestamptz,
      x_m        double precision,
      y_m        double precision,
      primary key (track_id, region_id)
    )
    """,
    "create index verge_region on semap.verge (region_id)",
    """
    alter table semap.track_now
      add column careful_ids integer[] not null default '{}',
      add column calm_until timestamptz not null default 'infinity',
      add column calm_std_m real not null default 'infinity',
      add column outlier_stamp timestamptz,
      add column outlier_x_m double precision,
      add column outlier_y_m double precision
    """,
    """
    alter table semap.source
      add column jump_m double precision default 15 check (jump_m > 0),
      add column jump_mps double precision not null default 30 check (jump_mps >= 0),
      add column outliers bigint not null default 0
    """,
    # of the newest batch that held every live track of its source once, at one stamp
    """
    alter table semap.source_count
      add column frame_stamp timestamptz not null default '-infinity',
      add column frame_tracks integer,
      add column placed_stamp timestamptz not null default '-infinity'
    """,
)


def upgrade() -> None:
    for statement in (*QUERY, *REGION, *CHANGE, *TRACK):
        op.execute(statement)
