"""Pairs are followed on values: where tracks were is one row each, and only instances are looked up by index."""

from alembic import op

revision = "0027"
down_revision = "0026"

STATEMENTS = (
    """
    create type semap.relation_state as (
      query_id integer, subject_key bigint, object_key bigint,
      confirmed boolean, since timestamptz, pending boolean, pending_at timestamptz,
      raw boolean, raw_at timestamptz, x_m double precision, y_m double precision,
      distance_m double precision, distance_at timestamptz
    )
    """,
    """
    create type semap.observation as (
      at timestamptz, x_m double precision, y_m double precision,
      raw boolean, enters boolean, leaves boolean, is_fresh boolean, distance_m double precision
    )
    """,
    """
    create table semap.followed_state (
      track_id      bigint primary key,
      map_id        integer not null,
      cell_x        integer not null,
      cell_y        integer not null,
      stamp         timestamptz not null,
      x_m           double precision not null,
      y_m           double precision not null,
      z_m           double precision,
      std_m         real,
      heading_rad   real,
      speed_mps     real,
      length_m      real,
      width_m       real,
      std_across_m  real,
      std_yaw_rad   real
    ) with (fillfactor = 50)
    """,
    "create index followed_state_cell on semap.followed_state (map_id, cell_x, cell_y)",
    "comment on table semap.followed_state is"
    " 'The state of each live track at the stamp up to which the pairs of its map were followed.'",
    "drop table semap.pair_member",
    """
    create table semap.pair_instance (
      instance_id      bigint not null,
      query_id         integer not null,
      is_object        boolean not null,
      map_id           integer not null,
      uid              uuid not null,
      name             text not null,
      place            public.geometry,
      shape            public.geometry not null,
      box              public.geometry not null,
      z_min_m          double precision not null,
      z_max_m          double precision not null,
      yaw_rad          double precision,
      formed_stamp     timestamptz not null default '-infinity',
      formed_track_id  bigint not null default 0,
      primary key (instance_id, query_id, is_object)
    )
    """,
    "comment on table semap.pair_instance is"
    " 'Which instances queries about pairs are about, on which side, and what they compare of each.'",
    "create index pair_instance_query on semap.pair_instance (query_id, is_object)",
    "create index pair_instance_box on semap.pair_instance using gist (box public.gist_geometry_ops_nd)",
    """
    alter table semap.query_track
      add column is_object boolean not null default false,
      add column formed_stamp timestamptz not null default '-infinity',
      add column formed_track_id bigint not null default 0,
      drop constraint query_track_pkey,
      add primary key (query_id, is_object, track_id)
    """,
    "alter table semap.pair_form drop constraint pair_form_query_id_fkey, add column query_name text not null default ''",
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
