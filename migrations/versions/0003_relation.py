"""Continuous queries, the regions they watch, the relations that hold and their changes."""

from alembic import op

revision = "0003"
down_revision = "0002"

STATEMENTS = (
    """
    create table semap.continuous_query (
      query_id           integer generated always as identity primary key,
      map_id             integer not null references semap.map on delete cascade,
      name               text not null check (name <> ''),
      predicate          text not null default 'contains' check (predicate in ('contains')),
      object_concept_id  integer not null references semap.concept,
      enabled            boolean not null default true,
      unique (map_id, name)
    )
    """,
    """
    create table semap.region (
      region_id      integer generated always as identity primary key,
      query_id       integer not null,
      query_name     text not null,
      instance_id    bigint not null,
      instance_uid   uuid not null,
      instance_name  text not null,
      map_id         integer not null,
      footprint      public.geometry not null,
      z_min_m        double precision not null,
      z_max_m        double precision not null,
      unique (query_id, instance_id)
    )
    """,
    "create index region_instance on semap.region (instance_id)",
    """
    create table semap.region_cell (
      map_id     integer not null,
      cell_x     integer not null,
      cell_y     integer not null,
      region_id  integer not null references semap.region on delete cascade,
      whole      boolean not null,
      z_min_m    double precision not null,
      z_max_m    double precision not null,
      primary key (map_id, cell_x, cell_y, region_id)
    )
    """,
    "create index region_cell_region on semap.region_cell (region_id)",
    """
    create table semap.region_edge (
      map_id     integer not null,
      cell_x     integer not null,
      cell_y     integer not null,
      region_id  integer not null references semap.region on delete cascade,
      x_min_m    double precision not null,
      x_max_m    double precision not null,
      y_min_m    double precision not null,
      y_max_m    double precision not null
    )
    """,
    "create index region_edge_cell on semap.region_edge (map_id, cell_x, cell_y)",
    "create index region_edge_region on semap.region_edge (region_id)",
    "create type semap.change_kind as enum ('began', 'ended')",
    "create type semap.change_cause as enum ('moved', 'appeared', 'disappeared', 'map')",
    """
    create type semap.crossing as (
      track_id bigint, region_id integer, kind semap.change_kind, cause semap.change_cause, stamp timestamptz
    )
    """,
    """
    create table semap.relation (
      track_id     bigint not null,
      region_id    integer not null,
      query_id     integer not null,
      instance_id  bigint not null,
      map_id       integer not null,
      since        timestamptz not null,
      primary key (track_id, region_id)
    )
    """,
    "create index relation_region on semap.relation (region_id)",
    "create index relation_instance on semap.relation (instance_id)",
    """
    create table semap.relation_change (
      change_id      bigint generated always as identity primary key,
      uid            uuid not null unique,
      map_id         integer not null,
      query_id       integer not null,
      query_name     text not null,
      track_id       bigint not null,
      track_name     text not null,
      instance_id    bigint not null,
      instance_name  text not null,
      kind           semap.change_kind not null,
      cause          semap.change_cause not null,
      stamp          timestamptz not null,
      since          timestamptz not null,
      received_at    timestamptz not null default clock_timestamp(),
      check (since <= stamp),
      check (kind = 'ended' or since = stamp)
    )
    """,
    "create index relation_change_stamp on semap.relation_change (stamp)",
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
