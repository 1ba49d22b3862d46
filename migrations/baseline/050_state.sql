-- States: of tracks as rows, as they came together, packed and now; of lines; of objects.
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
  primary key (stamp, track_id),
  constraint stamp_is_usual check (stamp between '1800-01-01Z' and '9999-01-01Z'),
  constraint state_is_finite check (abs(x_m) <= 1e7 and abs(y_m) <= 1e7 and abs(z_m) <= 1e7),
  constraint extent_is_finite check (
    abs(heading_rad) <= 7 and speed_mps between 0 and 1e4
    and length_m > 0 and length_m <= 1e4 and width_m > 0 and width_m <= 1e4),
  constraint ellipse_is_one check (
    case when std_across_m is null then std_yaw_rad is null
         else std_across_m between 0 and std_m and std_m < 1e15 and abs(std_yaw_rad) <= 7
         end is true)
) partition by range (stamp);
create table semap.track_state_default partition of semap.track_state default;
comment on column semap.track_state.std_m is
  'Standard deviation of the position: of all directions, or along the longer axis of its error ellipse.';
comment on column semap.track_state.std_across_m is
  'Standard deviation along the shorter axis; null: the error is alike in all directions.';
comment on column semap.track_state.std_yaw_rad is
  'Where the longer axis of the error ellipse points, in the map frame, from x towards y.';

-- What is kept here becomes rows of track_state soon, so it is never much. Long arrays lie beside their row as
-- they came; constraints of values are with the trigger (sql/146), which is the only way in.
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
        toast.autovacuum_vacuum_scale_factor = 0, toast.autovacuum_vacuum_threshold = 20000);
alter table semap.track_state_frame
  alter column track_ids set storage external,
  alter column x_m set storage external,
  alter column y_m set storage external,
  alter column z_m set storage external,
  alter column std_m set storage external,
  alter column heading_rad set storage external,
  alter column speed_mps set storage external,
  alter column length_m set storage external,
  alter column width_m set storage external,
  alter column std_across_m set storage external,
  alter column std_yaw_rad set storage external;

create table semap.track_state_packed (
  track_id      bigint not null,
  from_stamp    timestamptz not null,
  to_stamp      timestamptz not null,
  states        integer not null check (states > 0),
  span_us       integer not null,
  off_high      smallint[] not null,
  off_low       smallint[] not null,
  x_high        smallint[] not null,
  x_middle      smallint[] not null,
  x_low         integer[] not null,
  y_high        smallint[] not null,
  y_middle      smallint[] not null,
  y_low         integer[] not null,
  z_m           double precision[],
  std_m         real[],
  is_last       boolean[],
  heading_rad   real[],
  speed_mps     real[],
  length_m      real[],
  width_m       real[],
  std_across_m  real[],
  std_yaw_rad   real[],
  primary key (track_id, from_stamp)
) with (toast_tuple_target = 1000, autovacuum_vacuum_scale_factor = 0.05);
-- What is read is a stretch of time: a row that has states in it begins less than half an hour before.
create index track_state_packed_stamp on semap.track_state_packed (from_stamp, to_stamp);
-- A server that was built without lz4 keeps what it has.
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
end $$;
comment on table semap.track_state_packed is
  'Up to 490 states of a track within half an hour, in the order of stamps. A null array is all null.';
comment on column semap.track_state_packed.off_high is
  'How far each stamp is off the even pace of span_us in so many states [us], and 32768: its higher half.';
comment on column semap.track_state_packed.x_high is
  'The sixteen highest bits of x_m, which are like those before; x_middle and x_low have the rest.';

-- Where a track is changes with every state and is in no index, so that these updates stay in their page.
-- The present of a deleted track says where its states lie, until they are deleted with it.
create table semap.track_now (
  track_id       bigint primary key references semap.track deferrable initially deferred,
  source_id      integer not null,
  map_id         integer not null,
  cell_m         double precision not null,
  live           boolean not null default false,
  slot           integer,
  stamp          timestamptz not null default '-infinity',
  x_m            double precision,
  y_m            double precision,
  z_m            double precision,
  std_m          real,
  heading_rad    real,
  speed_mps      real,
  length_m       real,
  width_m        real,
  std_across_m   real,
  std_yaw_rad    real,
  -- An index of states by track would cost a fifth of what the triggers take. What bounds a look at one track is
  -- when it was seen first and last.
  first_stamp    timestamptz not null default 'infinity',
  outlier_stamp  timestamptz,
  outlier_x_m    double precision,
  outlier_y_m    double precision,
  region_ids     integer[] not null default '{}',
  careful_ids    integer[] not null default '{}',
  calm_x_min_m   double precision not null default 'infinity',
  calm_x_max_m   double precision not null default '-infinity',
  calm_y_min_m   double precision not null default 'infinity',
  calm_y_max_m   double precision not null default '-infinity',
  calm_z_min_m   double precision,
  calm_z_max_m   double precision,
  calm_until     timestamptz not null default 'infinity',
  calm_std_m     real not null default 'infinity'
) with (fillfactor = 40);
-- How many live tracks a source has is asked of it alone, however many others its map has.
create index track_now_live on semap.track_now (map_id, source_id) where live;
comment on column semap.track_now.slot is
  'The place of the track in source_count.frame_track_ids, from 1; of no meaning where that is null.';

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
) partition by range (stamp);
create index line_observation_source on semap.line_observation using brin (source_id)
  with (autosummarize = on);
create table semap.line_observation_default partition of semap.line_observation default;
comment on table semap.line_observation is
  'Lines that sources saw, in the map frame. Without a key: none is looked up by itself.';

create table semap.object_state (
  object_state_id  bigint generated always as identity primary key,
  uid              uuid not null unique,
  map_id           integer not null,
  source_id        integer not null references semap.source on delete cascade,
  instance_id      bigint not null,
  instance_name    text not null,
  property         text not null check (property <> ''),
  value            text not null,
  previous         text,
  stamp            timestamptz not null,
  since            timestamptz,
  attributes       jsonb not null default '{}',
  received_at      timestamptz not null default clock_timestamp(),
  constraint stamp_is_usual check (stamp between '1800-01-01Z' and '9999-01-01Z'),
  check (since < stamp),
  check (jsonb_typeof(attributes) = 'object')
);
create index object_state_instance on semap.object_state (instance_id, property, stamp);
create index object_state_map on semap.object_state (map_id, property, stamp);
create index object_state_map_stamp on semap.object_state (map_id, stamp);
