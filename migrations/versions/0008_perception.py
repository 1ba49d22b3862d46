"""What perception sees: the extent of tracks, lines, leaves of doors and how they stand, amendments."""

from alembic import op

revision = "0008"
down_revision = "0007"

EXTENT = (
    """
    alter table semap.track_state
      add column heading_rad real,
      add column speed_mps real,
      add column length_m real,
      add column width_m real,
      add constraint extent_is_finite check (
        abs(heading_rad) <= 7 and speed_mps between 0 and 1e4
        and length_m > 0 and length_m <= 1e4 and width_m > 0 and width_m <= 1e4)
    """,
    """
    alter table semap.track_now
      add column heading_rad real,
      add column speed_mps real,
      add column length_m real,
      add column width_m real
    """,
)

LINE = (
    """
    create table semap.line_observation (
      source_id      integer not null,
      stamp          timestamptz not null,
      x1_m           double precision not null,
      y1_m           double precision not null,
      x2_m           double precision not null,
      y2_m           double precision not null,
      z_m            double precision,
      angle_std_rad  real not null,
      offset_std_m   real not null,
      points         integer not null check (points >= 2),
      constraint stamp_is_usual check (stamp between '1800-01-01Z' and '9999-01-01Z'),
      constraint line_is_finite check (
        abs(x1_m) <= 1e7 and abs(y1_m) <= 1e7 and abs(x2_m) <= 1e7 and abs(y2_m) <= 1e7 and abs(z_m) <= 1e7),
      constraint line_is_long check (abs(x2_m - x1_m) + abs(y2_m - y1_m) >= 1e-6),
      constraint deviation_is_finite check (angle_std_rad between 0 and 10 and offset_std_m between 0 and 1e3)
    ) partition by range (stamp)
    """,
    """
    comment on table semap.line_observation is
      'Lines that sources saw, in the map frame. Without a key: none is looked up by itself.'
    """,
    """
    create index line_observation_source on semap.line_observation using brin (source_id)
      with (autosummarize = on)
    """,
    "create table semap.line_observation_default partition of semap.line_observation default",
)

DOOR = (
    """
    create table semap.door_leaf (
      instance_id        bigint primary key references semap.instance on delete cascade,
      map_id             integer not null,
      hinge_x_m          double precision not null,
      hinge_y_m          double precision not null,
      closed_rad         double precision not null,
      sense              smallint not null check (sense in (-1, 1)),
      width_m            double precision not null check (width_m > 0),
      max_rad            double precision not null check (max_rad > 0),
      z_min_m            double precision not null,
      z_max_m            double precision not null,
      opening_above_rad  double precision not null,
      open_from_rad      double precision not null,
      turns_by_rad       double precision not null,
      closed_below_rad   double precision not null,
      rests_within_rad   double precision not null,
      rests_for          interval not null,
      range_of_motion    public.geometry not null
    )
    """,
    "create index door_leaf_range_of_motion on semap.door_leaf using gist (range_of_motion)",
    """
    comment on column semap.door_leaf.closed_rad is
      'Direction in the map frame from the hinge to the free edge of the closed leaf.'
    """,
    """
    comment on column semap.door_leaf.sense is
      'Opens counter-clockwise (1) or clockwise (-1), seen from above.'
    """,
    """
    create table semap.door_now (
      instance_id    bigint primary key references semap.door_leaf on delete cascade,
      stamp          timestamptz not null default '-infinity',
      state          text check (state in ('opening', 'open', 'closing', 'closed')),
      since          timestamptz,
      angle_rad      double precision,
      angle_std_rad  double precision,
      extreme_rad    double precision,
      rest_rad       double precision,
      rest_since     timestamptz,
      doubt          text
    ) with (fillfactor = 40)
    """,
    """
    comment on column semap.door_now.extreme_rad is
      'The largest angle since it began to open, or the smallest since it began to close.'
    """,
    "comment on column semap.door_now.rest_rad is 'Where the leaf has stayed since rest_since.'",
    "comment on column semap.door_now.doubt is 'The state that the last observation alone would have made.'",
)

AMENDMENT = (
    """
    create table semap.track_amendment (
      track_amendment_id  bigint generated always as identity primary key,
      map_id              integer not null,
      source_id           integer not null,
      track_id            bigint not null references semap.track on delete cascade,
      other_track_id      bigint not null references semap.track on delete cascade,
      kind                text not null check (kind in ('merged', 'switched')),
      since               timestamptz not null,
      found               timestamptz not null,
      received_at         timestamptz not null default clock_timestamp(),
      unique (track_id, other_track_id, kind, since),
      check (track_id <> other_track_id),
      constraint stamps_are_usual
        check (since between '1800-01-01Z' and '9999-01-01Z' and found between since and '9999-01-01Z')
    )
    """,
    "create index track_amendment_other on semap.track_amendment (other_track_id)",
    "create publication semap_amendment for table semap.track_amendment with (publish = 'insert')",
    """
    comment on table semap.track_amendment is
      'merged: both are one person from then on; the other is older. switched: each followed the other''s.'
    """,
)

RECORDING = (
    "alter table semap.recording alter column states_total drop not null",
    """
    comment on column semap.recording.states_total is
      'Null where it is not known before the end; states_done then counts results of perception.'
    """,
)


def upgrade() -> None:
    for statement in (*RECORDING, *EXTENT, *LINE, *DOOR, *AMENDMENT):
        op.execute(statement)
