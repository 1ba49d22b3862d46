-- States: of tracks as they are written, as they are stored, and now; of lines; of objects.
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
) partition by range (stamp);
-- What rows that became chunks leave here is thrown away (sql/135).
create unlogged table semap.track_state_inbox partition of semap.track_state default with (autovacuum_enabled = off);
comment on table semap.track_state is
  'A state of a track, as it is written. It is stored in semap.state_chunk at once, and read by semap.states.';
comment on column semap.track_state.std_m is
  'Standard deviation of the position: of all directions, or along the longer axis of its error ellipse.';
comment on column semap.track_state.std_across_m is
  'Standard deviation along the shorter axis; null: the error is alike in all directions.';
comment on column semap.track_state.std_yaw_rad is
  'Where the longer axis of the error ellipse points, in the map frame, from x towards y.';

-- States within one half hour of the clock: of many tracks at one stamp, as they come, or of one track, once compacted.
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
) partition by range (from_stamp);
-- A server that was built without lz4 keeps what it has.
do $$
declare
  v_column  name;
begin
  for v_column in
    select attname from pg_attribute where attrelid = 'semap.state_chunk'::regclass and attnum > 0 and attndims > 0
  loop
    execute format('alter table semap.state_chunk alter column %I set compression lz4', v_column);
  end loop;
exception when feature_not_supported then
  null;
end $$;
create table semap.state_chunk_default partition of semap.state_chunk default;
create index state_chunk_of_track on semap.state_chunk (track_id, from_stamp) where track_id is not null;
create index state_chunk_of_stamp on semap.state_chunk (source_id, from_stamp) where track_id is null;
comment on table semap.state_chunk is
  'States of many tracks at one stamp, or of one track within half an hour. An array that is null is all null.';
comment on column semap.state_chunk.track_id is 'The track of all of these states; null where track_ids has them.';
comment on column semap.state_chunk.offsets_us is
  'How far each stamp is off an even pace from from_stamp to to_stamp [us]; null: not at all.';

-- Where a track is changes with every state and is in no index, so that these updates stay in their page.
-- The present of a deleted track says where its states lie, until they are deleted with it.
create table semap.track_now (
  track_id       bigint primary key references semap.track deferrable initially deferred,
  source_id      integer not null,
  map_id         integer not null,
  cell_m         double precision not null,
  live           boolean not null default false,
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
  stateful_ids    integer[] not null default '{}',
  safe_x_min_m   double precision not null default 'infinity',
  safe_x_max_m   double precision not null default '-infinity',
  safe_y_min_m   double precision not null default 'infinity',
  safe_y_max_m   double precision not null default '-infinity',
  safe_z_min_m   double precision,
  safe_z_max_m   double precision,
  safe_until     timestamptz not null default 'infinity',
  safe_std_m     real not null default 'infinity'
) with (fillfactor = 40);
-- By it each state that comes finds its track, a fifth faster than by the key.
create index track_now_lookup on semap.track_now using hash (track_id);
-- How many live tracks a source has is asked of it alone, however many others its map has.
create index track_now_live on semap.track_now (map_id, source_id) where live;

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

create table semap.camera_report (
  map_id       integer not null references semap.map on delete cascade,
  source       text not null,
  camera       text not null check (camera <> ''),
  object       text not null check (object <> ''),
  stamp        timestamptz not null,
  document     jsonb not null,
  digest       uuid not null generated always as (md5(document::text)::uuid) stored,
  received_at  timestamptz not null default clock_timestamp(),
  constraint stamp_is_usual check (stamp between '1800-01-01Z' and '9999-01-01Z'),
  primary key (map_id, camera, object, stamp, source, digest)
);
create index camera_report_stamp on semap.camera_report (stamp);
comment on table semap.camera_report is
  'What programs that watch cameras say of things in a picture, with their boxes in pixels, as it came.';
comment on column semap.camera_report.object is 'Id of what was seen, by its program.';
comment on column semap.camera_report.digest is 'So that what is told twice is there once.';
