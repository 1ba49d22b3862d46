"""States are stored in one form: chunks of arrays, of many tracks at one stamp or of one track."""

from alembic import op

revision = "0027"
down_revision = "0026"

STATEMENTS = (
    "drop table semap.track_state_frame, semap.track_state_packed, semap.track_state cascade",
    # A row that is inserted here is stored as part of a chunk at once. What it leaves is thrown away.
    """
    create table semap.track_state (
      track_id      bigint not null,
      stamp         timestamptz not null,
      x_m           double precision not null,
      y_m           double precision not null,
      z_m           double precision,
      std_m         real,
      is_last       boolean not null default false,
      heading_rad   real,
      speed_mps     real,
      length_m      real,
      width_m       real,
      std_across_m  real,
      std_yaw_rad   real,
      constraint stamp_is_usual check (stamp between '1800-01-01Z' and '9999-01-01Z'),
      constraint state_is_finite check (abs(x_m) <= 1e7 and abs(y_m) <= 1e7 and abs(z_m) <= 1e7),
      constraint extent_is_finite check (
        abs(heading_rad) <= 7 and speed_mps between 0 and 1e4
        and length_m > 0 and length_m <= 1e4 and width_m > 0 and width_m <= 1e4),
      constraint ellipse_is_one check (
        case when std_across_m is null then std_yaw_rad is null
             else std_across_m between 0 and std_m and std_m < 1e15 and abs(std_yaw_rad) <= 7
             end is true)
    ) partition by range (stamp)
    """,
    """
    create unlogged table semap.track_state_inbox partition of semap.track_state default
    with (autovacuum_enabled = off)
    """,
    """
    comment on table semap.track_state is
      'A state of a track, as it is written. Each is stored in semap.state_chunk at once: read semap.states.'
    """,
    """
    create table semap.state_chunk (
      source_id     integer not null,
      track_id      bigint,
      from_stamp    timestamptz not null,
      to_stamp      timestamptz not null,
      states        integer not null,
      track_ids     bigint[],
      offsets_us    integer[],
      x_m           double precision[] not null,
      y_m           double precision[] not null,
      z_m           double precision[],
      std_m         real[],
      is_last       boolean[],
      heading_rad   real[],
      speed_mps     real[],
      length_m      real[],
      width_m       real[],
      std_across_m  real[],
      std_yaw_rad   real[],
      constraint tracks_are_named_once check (num_nonnulls(track_id, track_ids) = 1)
    ) partition by range (from_stamp)
    """,
    "create table semap.state_chunk_default partition of semap.state_chunk default",
    """
    comment on table semap.state_chunk is
      'States within one half hour: of many tracks at one stamp, or of one track. A null array is all null.'
    """,
    "comment on column semap.state_chunk.track_id is 'The track of all; null where track_ids has them.'",
    """
    comment on column semap.state_chunk.offsets_us is
      'How far each stamp of a track is off an even pace from from_stamp to to_stamp [us]; null: not at all.'
    """,
    """
    create index state_chunk_of_track on semap.state_chunk (track_id, from_stamp) where track_id is not null
    """,
    """
    create index state_chunk_of_stamp on semap.state_chunk (source_id, from_stamp) where track_id is null
    """,
    """
    do $$
    declare
      v_column  name;
    begin
      for v_column in
        select attname from pg_attribute
        where attrelid = 'semap.state_chunk'::regclass and attnum > 0 and attndims > 0
      loop
        execute format('alter table semap.state_chunk alter column %I set compression lz4', v_column);
        execute format('alter table semap.state_chunk_default alter column %I set compression lz4', v_column);
      end loop;
    exception when feature_not_supported then
      null; -- a server that was built without lz4 keeps what it has
    end $$
    """,
    """
    alter table semap.source_count
      drop column frame_stamp, drop column placed_stamp, drop column frame_tracks,
      drop column frame_track_ids,
      add column newest_stamp timestamptz not null default '-infinity',
      add column flushed_stamp timestamptz not null default '-infinity',
      add column unflushed integer not null default 0
    """,
    "comment on column semap.source_count.newest_stamp is 'The newest stamp of any state of the source.'",
    """
    comment on column semap.source_count.flushed_stamp is
      'Up to which stamp the positions of its tracks are in track_now; later ones are in its newest chunks.'
    """,
    "comment on column semap.source_count.unflushed is 'How many chunks came since positions were flushed.'",
    "alter table semap.track_now drop column slot",
    "alter table semap.retention drop column pack_after cascade",
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
