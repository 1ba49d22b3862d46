"""How long what is kept, and the states of past days in little room."""

from alembic import op

revision = "0015"
down_revision = "0014"

STATEMENTS = (
    """
    create table semap.retention (
      kind         text primary key check (kind in ('states', 'lines', 'changes', 'events')),
      pack_after   interval check (pack_after is null or (pack_after > '0' and kind = 'states')),
      drop_after   interval check (drop_after > '0'),
      gone_before  timestamptz,
      check (drop_after > pack_after)
    )
    """,
    """
    comment on table semap.retention is
      'How long what is kept, by event time. Without an age nothing of a kind is packed or dropped.'
    """,
    "comment on column semap.retention.gone_before is 'What is older has been dropped.'",
    "insert into semap.retention (kind) values ('states'), ('lines'), ('changes'), ('events')",
    """
    create table semap.track_state_packed (
      track_id     bigint not null,
      from_stamp   timestamptz not null,
      to_stamp     timestamptz not null,
      states       integer not null check (states > 0),
      span_us      integer not null,
      off_high     smallint[] not null,
      off_low      smallint[] not null,
      x_high       smallint[] not null,
      x_middle     smallint[] not null,
      x_low        integer[] not null,
      y_high       smallint[] not null,
      y_middle     smallint[] not null,
      y_low        integer[] not null,
      z_m          double precision[],
      std_m        real[],
      is_last      boolean[],
      heading_rad  real[],
      speed_mps    real[],
      length_m     real[],
      width_m      real[],
      primary key (track_id, from_stamp)
    ) with (toast_tuple_target = 1000, autovacuum_vacuum_scale_factor = 0.05)
    """,
    """
    comment on table semap.track_state_packed is
      'Up to 490 states of a track within half an hour, in the order of stamps. A null array is all null.'
    """,
    """
    comment on column semap.track_state_packed.off_high is
      'How far each stamp is off the even pace of span_us in so many states [us], and 32768: its higher half.'
    """,
    """
    comment on column semap.track_state_packed.x_high is
      'The sixteen highest bits of x_m, which are like those before; x_middle and x_low have the rest.'
    """,
    # What is read is a stretch of time: a row that has states in it begins less than half an hour before.
    "create index track_state_packed_stamp on semap.track_state_packed (from_stamp, to_stamp)",
    # A server that was built without lz4 keeps what it has.
    """
    do $$
    declare
      v_column  name;
    begin
      for v_column in
        select attname from pg_attribute
        where attrelid = 'semap.track_state_packed'::regclass and attnum > 0 and attndims > 0
      loop
        execute format('alter table semap.track_state_packed alter column %I set compression lz4', v_column);
      end loop;
    exception when feature_not_supported then
      null;
    end $$
    """,
    # The present of a deleted track says where its states lie, until they are deleted with it.
    """
    alter table semap.track_now
      drop constraint track_now_track_id_fkey,
      add constraint track_now_track_id_fkey foreign key (track_id) references semap.track
        deferrable initially deferred
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
