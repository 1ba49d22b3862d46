"""States that came together: those of all tracks of a source at one moment, in one row."""

from alembic import op

revision = "0021"
down_revision = "0020"

STATEMENTS = (
    # What is kept here becomes rows of track_state soon, so it is never much. Long arrays lie beside their
    # row as they came; constraints of values are with the trigger (sql/146), which is the only way in.
    """
    create table semap.track_state_frame (
      stamp         timestamptz not null,
      source_id     integer not null,
      track_ids     bigint[] not null,
      x_m           double precision[] not null,
      y_m           double precision[] not null,
      z_m           double precision[],
      std_m         real[],
      heading_rad   real[],
      speed_mps     real[],
      length_m      real[],
      width_m       real[],
      std_across_m  real[],
      std_yaw_rad   real[],
      primary key (stamp, source_id)
    ) with (autovacuum_vacuum_scale_factor = 0, autovacuum_vacuum_threshold = 2000,
            toast.autovacuum_vacuum_scale_factor = 0, toast.autovacuum_vacuum_threshold = 20000)
    """,
    """
    do $$
    declare
      v_column  text;
    begin
      for v_column in
        select attname from pg_attribute
        where attrelid = 'semap.track_state_frame'::regclass and attnum > 0 and attstorage = 'x'
      loop
        execute format('alter table semap.track_state_frame alter column %I set storage external', v_column);
      end loop;
    end $$
    """,
    """
    alter table semap.source_count
      add column frame_track_ids bigint[],
      alter column frame_track_ids set storage external
    """,
    """
    comment on column semap.source_count.frame_track_ids is
      'The tracks of the last frame, each live one of the source once; null where that is not known.'
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
