-- Continuous queries, what they watch, the relations that hold, and their changes.

-- Each condition of continuous queries; what was compiled of it is the function semap.condition_<id>.
create table semap.condition (
  condition_id  integer generated always as identity primary key,
  map_id        integer not null references semap.map on delete cascade,
  kind          text not null check (kind in ('track', 'instance')),
  condition     jsonb not null,
  said          text[] not null
);
create unique index condition_known on semap.condition (map_id, kind, md5(condition::text));

-- What the database asks of each predicate, which is a file of sql/117_predicate (semap/model/predicate.py explains
-- it).
create table semap.predicate (
  name              text primary key,
  needs             text[] not null,
  takes             text[] not null,
  relates           text[] not null,
  follows_from      text not null check (follows_from in ('moment', 'trend', 'rank', 'way')),
  region_test       text check (region_test in ('contains', 'covers', 'dwithin')),
  subject_compared  text not null check (subject_compared in ('position', 'pose', 'ground', 'body')),
  object_compared   text not null check (
    object_compared in ('position', 'ground', 'front', 'back', 'left', 'right', 'line', 'top')),
  reach             text not null check (reach in ('contact', 'distance', 'any'))
);
-- In which predicates have functions of two rows.
create schema semap_query;

create table semap.continuous_query (
  query_id            integer generated always as identity primary key,
  map_id              integer not null references semap.map on delete cascade,
  name                text not null check (name <> ''),
  enabled             boolean not null default true,
  predicate           text not null default 'contains' references semap.predicate,
  subject_kind        text not null default 'track' check (subject_kind in ('track', 'instance')),
  subject_concept_id  integer references semap.concept,
  subject_uids        uuid[],
  subject_where       jsonb check (jsonb_typeof(subject_where) = 'object'),
  subject_condition_id  integer references semap.condition,
  object_kind         text not null default 'instance' check (object_kind in ('track', 'instance')),
  object_concept_id   integer references semap.concept,
  object_uids         uuid[],
  object_where        jsonb check (jsonb_typeof(object_where) = 'object'),
  object_condition_id  integer references semap.condition,
  distance_m          double precision check (distance_m > 0 and distance_m <= 1e4),
  count               integer check (count between 1 and 100),
  angle_rad           double precision check (angle_rad > 0 and angle_rad <= pi()),
  speed_mps           double precision check (speed_mps > 0),
  direction           text check (direction in ('left_to_right', 'right_to_left')),
  abstraction         text not null default 'Footprint',
  dimensions          smallint not null default 3 check (dimensions in (2, 3)),
  enter_margin_m      double precision not null default 0 check (enter_margin_m between 0 and 100),
  leave_margin_m      double precision not null default 0 check (leave_margin_m between 0 and 100),
  enter_confirm       interval not null default '0' check (enter_confirm between '0' and '1 day'),
  leave_confirm       interval not null default '0' check (leave_confirm between '0' and '1 day'),
  enter_probability   double precision check (enter_probability >= 0.5 and enter_probability < 1),
  leave_probability   double precision check (leave_probability > 0 and leave_probability <= 0.5),
  widest_std_m        double precision check (widest_std_m > 0 and widest_std_m <= 100),
  longest_gap         interval check (longest_gap > '0' and longest_gap <= '1 day'),
  fastest_mps         double precision check (fastest_mps > 0),
  payload             jsonb not null default '{}',
  follows_amendments  boolean not null default false,
  sql                 text,
  -- what the regions cannot answer, which ask only where a track is: said by a trigger (sql/115)
  in_pairs            boolean not null default false,
  unique (map_id, name),
  constraint probabilities_are_both_given
    check ((enter_probability is null) = (leave_probability is null)
           and (enter_probability is null) = (widest_std_m is null)),
  constraint gap_and_speed_are_both_given check ((longest_gap is null) = (fastest_mps is null))
);
create index continuous_query_in_pairs on semap.continuous_query (map_id) where in_pairs;

create table semap.query_request (
  request_id   bigint generated always as identity primary key,
  map_id       integer not null references semap.map on delete cascade,
  name         text not null,
  sql          text not null,
  asked_by     text not null default current_user,
  asked_at     timestamptz not null default clock_timestamp(),
  answered_at  timestamptz,
  query_id     integer,
  refusal      jsonb,
  constraint an_answer_is_a_query_or_a_refusal
    check (num_nonnulls(query_id, refusal) = (answered_at is not null)::integer)
);
create unique index query_request_waits on semap.query_request (map_id, name) where answered_at is null;
comment on table semap.query_request is 'Continuous queries that were asked for in SQL.';
comment on column semap.query_request.refusal is
  'line and column in the text (null where there is no place), the reason, and the remedy.';

-- Which tracks the sides of queries are about that ask for more than any.
create table semap.query_track (
  query_id         integer not null references semap.continuous_query on delete cascade,
  is_object        boolean not null,
  track_id         bigint not null references semap.track on delete cascade,
  map_id           integer not null,
  valid_from       timestamptz not null default '-infinity',
  valid_from_track_id  bigint not null default 0,
  primary key (query_id, is_object, track_id)
);
create index query_track_track on semap.query_track (track_id);

create table semap.region (
  region_id        integer generated always as identity primary key,
  query_id         integer not null,
  query_name       text not null,
  instance_id      bigint not null,
  instance_uid     uuid not null,
  instance_name    text not null,
  map_id           integer not null,
  footprint        public.geometry not null,
  z_min_m          double precision not null,
  z_max_m          double precision not null,
  test             text not null default 'contains',
  compared         text not null default 'ground',
  shape            public.geometry,
  distance_m       double precision,
  enter_area       public.geometry,
  leave_area       public.geometry,
  enter_confirm    interval not null default '0',
  leave_confirm    interval not null default '0',
  enter_stds       double precision,
  leave_stds       double precision,
  longest_gap      interval,
  fastest_mps      double precision,
  widest_std_m     double precision,
  subject          text,
  stateful         boolean not null default false,
  -- Tracks that are older than the form of a region are corrected only after the newest state of its map.
  valid_from       timestamptz not null default '-infinity',
  valid_from_track_id  bigint not null default 0,
  unique (query_id, instance_id)
);
create index region_instance on semap.region (instance_id);
create index region_stateful on semap.region using gist (footprint) where stateful;
create index region_stateful_map on semap.region (map_id) where stateful;

create table semap.region_cell (
  map_id     integer not null,
  cell_x     integer not null,
  cell_y     integer not null,
  region_id  integer not null references semap.region on delete cascade,
  whole      boolean not null,
  z_min_m    double precision not null,
  z_max_m    double precision not null,
  stateful    boolean not null default false,
  primary key (map_id, cell_x, cell_y, region_id)
);
create index region_cell_region on semap.region_cell (region_id);

create table semap.region_edge (
  map_id     integer not null,
  cell_x     integer not null,
  cell_y     integer not null,
  region_id  integer not null references semap.region on delete cascade,
  x_min_m    double precision not null,
  x_max_m    double precision not null,
  y_min_m    double precision not null,
  y_max_m    double precision not null,
  stds       real not null default 0
);
create index region_edge_cell on semap.region_edge (map_id, cell_x, cell_y);
create index region_edge_region on semap.region_edge (region_id);

-- What a subject and an object are to each other by a query (sql/112): while it holds, and while there is something to
-- remember of it. A key is the id of a track, or that of an instance below zero. Those of queries about regions are
-- found by the regions (sql/100, 132), those of the others in pairs (sql/126).
create table semap.relation (
  query_id             integer not null,
  map_id               integer not null,
  in_pairs             boolean not null default false,
  track_id             bigint,
  subject_instance_id  bigint,
  instance_id          bigint,
  object_track_id      bigint,
  subject_key          bigint not null generated always as (coalesce(track_id, -subject_instance_id)) stored,
  object_key           bigint not null generated always as (coalesce(object_track_id, -instance_id)) stored,
  confirmed            boolean not null,
  since                timestamptz,
  pending              boolean not null,
  pending_at           timestamptz,
  raw                  boolean not null,
  raw_at               timestamptz,
  x_m                  double precision,
  y_m                  double precision,
  distance_m           double precision,
  distance_at          timestamptz,
  primary key (query_id, subject_key, object_key),
  constraint subject_is_one_thing check (num_nonnulls(track_id, subject_instance_id) = 1),
  constraint object_is_one_thing check (num_nonnulls(instance_id, object_track_id) = 1),
  constraint what_holds_has_begun check (confirmed = (since is not null))
);
create index relation_track on semap.relation (track_id) where track_id is not null;
create index relation_subject_instance on semap.relation (subject_instance_id) where subject_instance_id is not null;
create index relation_instance on semap.relation (instance_id, query_id) where instance_id is not null;
create index relation_object_track on semap.relation (object_track_id) where object_track_id is not null;

-- The same as a value.
create type semap.relation_state as (
  query_id integer, subject_key bigint, object_key bigint,
  confirmed boolean, since timestamptz, pending boolean, pending_at timestamptz,
  raw boolean, raw_at timestamptz, x_m double precision, y_m double precision,
  distance_m double precision, distance_at timestamptz
);

create type semap.change_kind as enum ('began', 'ended', 'crossed');
create type semap.change_cause as enum ('moved', 'appeared', 'disappeared', 'map');

create table semap.relation_change (
  change_id              bigint generated always as identity primary key,
  uid                    uuid not null unique,
  map_id                 integer not null,
  query_id               integer not null,
  query_name             text not null,
  track_id               bigint,
  track_name             text,
  subject_instance_id    bigint,
  subject_instance_name  text,
  instance_id            bigint,
  instance_name          text,
  object_track_id        bigint,
  object_track_name      text,
  kind                   semap.change_kind not null,
  cause                  semap.change_cause not null,
  stamp                  timestamptz not null,
  transition_at                timestamptz not null,
  since                  timestamptz not null,
  received_at            timestamptz not null default clock_timestamp(),
  x_m                    double precision,
  y_m                    double precision,
  direction              text check (direction in ('left_to_right', 'right_to_left')),
  door_id                bigint,
  door_name              text,
  edge                   integer,
  amendment              text check (amendment in ('added', 'retracted')),
  retracts               uuid,
  constraint subject_is_one_thing check (num_nonnulls(track_id, subject_instance_id) = 1),
  constraint object_is_one_thing check (num_nonnulls(instance_id, object_track_id) = 1),
  constraint edge_is_known_later check (transition_at <= stamp),
  constraint began_before check (since <= transition_at),
  constraint beginning_is_since check (kind = 'ended' or since = transition_at),
  constraint retraction_says_what check ((retracts is not null) = (amendment is not distinct from 'retracted'))
);
create index relation_change_map on semap.relation_change (map_id, stamp);
create index relation_change_retracts on semap.relation_change (retracts) where retracts is not null;

create table semap.relation_past (
  relation_past_id       bigint generated always as identity primary key,
  map_id                 integer not null,
  query_id               integer not null,
  query_name             text not null,
  track_id               bigint,
  track_name             text,
  subject_instance_id    bigint,
  subject_instance_name  text,
  instance_id            bigint,
  instance_name          text,
  object_track_id        bigint,
  object_track_name      text,
  since                  timestamptz not null,
  until                  timestamptz not null,
  constraint subject_is_one_thing check (num_nonnulls(track_id, subject_instance_id) = 1),
  constraint object_is_one_thing check (num_nonnulls(instance_id, object_track_id) = 1),
  constraint began_before check (since <= until)
);
create index relation_past_stay on semap.relation_past using gist (tstzrange(since, until, '[]'));
create index relation_past_instance on semap.relation_past (instance_id, until) where instance_id is not null;
create index relation_past_track on semap.relation_past (track_id);
create index relation_past_object_track on semap.relation_past (object_track_id) where object_track_id is not null;

-- A state as it comes, with what is known of its track before it. It is made by semap.new_state_update.
create type semap.state_update as (
  state semap.track_state, source_id integer, map_id integer, cell_m double precision, live boolean,
  seen_stamp timestamptz, from_x_m double precision, from_y_m double precision, from_z_m double precision,
  region_ids integer[], outlier_stamp timestamptz
);
-- A crossing as it is found, before it is written.
create type semap.crossing as (
  track_id bigint, region_id integer, kind semap.change_kind, cause semap.change_cause, stamp timestamptz,
  transition_at timestamptz, x_m double precision, y_m double precision
);
-- Between which stamps what is found of a region may differ from what was found without late states.
create type semap.replayed as (region_id integer, from_stamp timestamptz, to_stamp timestamptz);
create type semap.amended as (
  region_id integer, kind semap.change_kind, cause semap.change_cause,
  stamp timestamptz, transition_at timestamptz, since timestamptz, x_m double precision, y_m double precision
);
-- Such a span in which the log can be corrected: what was found there, since when the region holds at its end by that
-- (now_since; null: it does not), and since when and until when it held there by the log.
create type semap.sound_span as (
  region_id integer, query_id integer, instance_id bigint, from_stamp timestamptz, to_stamp timestamptz,
  is_present boolean, now_since timestamptz, after_since timestamptz, after_until timestamptz, changes semap.amended[]
);
