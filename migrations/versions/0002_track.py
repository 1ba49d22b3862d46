"""Tracks: who was seen by which source, every state, and the present one."""

from alembic import op

revision = "0002"
down_revision = "0001"

STATEMENTS = (
    """
    create table semap.source (
      source_id    integer generated always as identity primary key,
      map_id       integer not null references semap.map on delete cascade,
      name         text not null check (name <> ''),
      watermark    timestamptz not null default '-infinity' check (watermark < '9999-01-01Z'),
      late_states  bigint not null default 0,
      unique (map_id, name)
    )
    """,
    """
    create table semap.recording (
      recording_id  integer generated always as identity primary key,
      source_id     integer not null references semap.source on delete cascade,
      fingerprint   text not null,
      path          text not null,
      states_total  bigint not null,
      states_done   bigint not null default 0,
      started_at    timestamptz not null default clock_timestamp(),
      finished_at   timestamptz,
      unique (source_id, fingerprint),
      check (states_done between 0 and states_total)
    )
    """,
    """
    create table semap.track (
      track_id    bigint generated always as identity primary key,
      uid         uuid not null unique,
      source_id   integer not null references semap.source on delete cascade,
      map_id      integer not null references semap.map on delete cascade,
      name        text not null check (name <> ''),
      ended_at    timestamptz check (ended_at between '1800-01-01Z' and '9999-01-01Z'),
      unique (source_id, name)
    )
    """,
    "create index track_map on semap.track (map_id)",
    """
    create table semap.track_state (
      track_id  bigint not null,
      stamp     timestamptz not null,
      x_m       double precision not null,
      y_m       double precision not null,
      z_m       double precision,
      std_m     real,
      is_last   boolean not null default false,
      primary key (stamp, track_id),
      constraint stamp_is_usual check (stamp between '1800-01-01Z' and '9999-01-01Z'),
      constraint state_is_finite check (abs(x_m) <= 1e7 and abs(y_m) <= 1e7 and abs(z_m) <= 1e7)
    ) partition by range (stamp)
    """,
    "create table semap.track_state_default partition of semap.track_state default",
    """
    create table semap.track_now (
      track_id      bigint primary key references semap.track on delete cascade,
      source_id     integer not null,
      map_id        integer not null,
      cell_m        double precision not null,
      live          boolean not null default false,
      stamp         timestamptz not null default '-infinity',
      x_m           double precision,
      y_m           double precision,
      z_m           double precision,
      std_m         real,
      region_ids    integer[] not null default '{}',
      calm_x_min_m  double precision not null default 'infinity',
      calm_x_max_m  double precision not null default '-infinity',
      calm_y_min_m  double precision not null default 'infinity',
      calm_y_max_m  double precision not null default '-infinity',
      calm_z_min_m  double precision,
      calm_z_max_m  double precision
    ) with (fillfactor = 40)
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
