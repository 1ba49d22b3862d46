-- Pairs: relations of which either side may move.

-- Which instances a query is about, on which side, and what it compares of each.
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
  valid_from       timestamptz not null default '-infinity',
  valid_from_track_id  bigint not null default 0,
  primary key (instance_id, query_id, is_object)
);
create index pair_instance_query on semap.pair_instance (query_id, is_object);
create index pair_instance_box on semap.pair_instance using gist (box public.gist_geometry_ops_nd);

-- The state of each live track at the stamp up to which the pairs of its map were followed.
create table semap.followed_state (
  track_id  bigint primary key,
  map_id    integer not null,
  cell_x    integer not null,
  cell_y    integer not null,
  state     semap.track_state not null
) with (fillfactor = 50);
create index followed_state_cell on semap.followed_state (map_id, cell_x, cell_y);

-- Pairs of tracks that are older than the form of a query are corrected only after the newest state of its map.
create table semap.pair_query (
  query_id         integer primary key,
  map_id           integer not null,
  query_name       text not null,
  valid_from           timestamptz not null,
  valid_from_track_id  bigint not null
);

create table semap.pair_progress (
  map_id    integer primary key references semap.map on delete cascade,
  through   timestamptz not null,
  revision  bigint not null default 0
);
comment on table semap.pair_progress is
  'Up to which stamp the pairs of a map were followed; followed_state has where tracks were then.';
comment on column semap.pair_progress.revision is
  'How often what was known of pairs up to then changed: a correction is of that which it was made from.';

-- What a predicate compares: a track, whose number is above zero, or an instance, whose is below.
create type semap.compared as (
  key bigint, place public.geometry, shape public.geometry, z_min_m double precision, z_max_m double precision,
  yaw_rad double precision
);

-- How a subject stands to an object: whether the predicate holds (of what follows from a trend: whether the two are
-- near enough), whether it does so deep enough to begin, and whether it is far enough from that to end.
create type semap.standing as (raw boolean, enters boolean, leaves boolean, distance_m double precision);

-- What is seen of a relation at a moment.
create type semap.observation as (
  at timestamptz, x_m double precision, y_m double precision,
  raw boolean, enters boolean, leaves boolean, is_fresh boolean, distance_m double precision
);

-- A change of a pair as it is found, before it is written.
create type semap.pair_change as (
  query_id integer, subject_key bigint, object_key bigint, kind text, cause semap.change_cause,
  stamp timestamptz, transition_at timestamptz, since timestamptz,
  x_m double precision, y_m double precision, direction text
);

-- A change of a pair that stands in the log, by its uid.
create type semap.told_change as (uid uuid, said semap.pair_change);
-- A pair by a replay and by the log: since when it holds before late states and after them, as found and as told (null:
-- it does not).
create type semap.compared_pair as (
  query_id integer, subject_key bigint, object_key bigint, told semap.told_change[],
  found_before timestamptz, told_before timestamptz, found_since timestamptz, told_since timestamptz
);
