-- Pairs: relations of which either side may move.

-- Two things that a query follows: held is the relation, inside what it follows once that has lasted.
create table semap.pair (
  pair_id              bigint generated always as identity primary key,
  map_id               integer not null,
  query_id             integer not null,
  track_id             bigint,
  subject_instance_id  bigint,
  instance_id          bigint,
  object_track_id      bigint,
  held                 boolean not null,
  since                timestamptz,
  inside               boolean not null,
  inside_at            timestamptz,
  distance_m           double precision,
  distance_at          timestamptz,
  subject_key          bigint not null generated always as (coalesce(track_id, -subject_instance_id)) stored,
  object_key           bigint not null generated always as (coalesce(object_track_id, -instance_id)) stored,
  unique (query_id, subject_key, object_key),
  constraint subject_is_one_thing check (num_nonnulls(track_id, subject_instance_id) = 1),
  constraint object_is_one_thing check (num_nonnulls(instance_id, object_track_id) = 1),
  constraint what_holds_has_begun check (held = (since is not null))
);
create index pair_subject on semap.pair (subject_key);
create index pair_object on semap.pair (object_key);

-- Who takes part in a query, on which side, and where it is; boxes of tracks are wider, so that a step within one
-- leaves the index alone.
create table semap.pair_member (
  key              bigint not null generated always as (coalesce(track_id, -instance_id)) stored,
  query_id         integer not null,
  is_object        boolean not null,
  map_id           integer not null,
  query_name       text not null,
  track_id         bigint,
  instance_id      bigint,
  uid              uuid not null,
  name             text not null,
  stamp            timestamptz,
  place            public.geometry,
  shape            public.geometry,
  box              public.geometry,
  z_min_m          double precision,
  z_max_m          double precision,
  yaw_rad          double precision,
  formed_stamp     timestamptz not null default '-infinity',
  formed_track_id  bigint not null default 0,
  primary key (key, query_id, is_object),
  check (num_nonnulls(track_id, instance_id) = 1)
) with (fillfactor = 50);
create index pair_member_query on semap.pair_member (query_id, is_object);
create index pair_member_box on semap.pair_member using gist (box public.gist_geometry_ops_nd);

-- Pairs of tracks that are older than the form of a query are corrected only after the newest state of its map.
create table semap.pair_form (
  query_id         integer primary key references semap.continuous_query on delete cascade,
  map_id           integer not null,
  formed_stamp     timestamptz not null,
  formed_track_id  bigint not null
);

create table semap.pair_progress (
  map_id   integer primary key references semap.map on delete cascade,
  through  timestamptz not null
);
comment on table semap.pair_progress is
  'Up to which stamp the pairs of a map were followed; tracks in pair_member are where they were then.';

-- A change of a pair as it is found, before it is written.
create type semap.pair_change as (
  query_id integer, subject_key bigint, object_key bigint, kind text, cause semap.change_cause,
  stamp timestamptz, edge_at timestamptz, since timestamptz,
  x_m double precision, y_m double precision, direction text
);
