-- Rules, the events that they make with their evidence, and how far a worker has come.
create table semap.rule (
  rule_id        integer generated always as identity primary key,
  map_id         integer not null references semap.map on delete cascade,
  name           text not null check (name <> ''),
  version        integer not null default 1 check (version > 0),
  declaration    jsonb not null,
  queries        jsonb not null default '{}' check (jsonb_typeof(queries) = 'object'),
  enabled        boolean not null default true,
  backfill_from  timestamptz check (backfill_from between '1800-01-01Z' and '9999-01-01Z'),
  seam           jsonb,
  unique (map_id, name)
);
alter table semap.rule replica identity full;

create table semap.rule_query (
  rule_id   integer not null references semap.rule on delete cascade,
  query_id  integer not null references semap.continuous_query deferrable initially deferred,
  primary key (rule_id, query_id)
);
create index rule_query_query on semap.rule_query (query_id);
comment on column semap.rule_query.query_id is 'Deferred, since with a map go its queries before its rules.';

create table semap.rule_version (
  rule_id      integer not null,
  version      integer not null check (version > 0),
  map_id       integer not null references semap.map on delete cascade,
  name         text not null,
  declaration  jsonb not null,
  declared_at  timestamptz not null default clock_timestamp(),
  primary key (rule_id, version)
);
create index rule_version_name on semap.rule_version (map_id, name);
comment on column semap.rule_version.rule_id is
  'No foreign key: versions outlive their rule, so that none of a name comes twice in the ids of events.';

create table semap.progress (
  worker      text primary key,
  lsn         pg_lsn not null,
  event_seq   bigint not null default 0,
  rule_state  jsonb not null default '{}',
  watermarks  jsonb not null default '{}',
  late_rows   bigint not null default 0,
  updated_at  timestamptz not null default clock_timestamp(),
  alive_at    timestamptz not null default '-infinity'
);
comment on column semap.progress.late_rows is 'How many rows came after the watermark had passed them.';
comment on column semap.progress.alive_at is
  'When the worker last said that it is at work, by the clock of the database.';

create table semap.collected (
  topic        text not null,
  partition    integer not null,
  next_offset  bigint not null,
  primary key (topic, partition)
);
comment on table semap.collected is
  'Up to where topics of events were read that rules made elsewhere; it moves in the transaction that writes them.';

create table semap.rule_state (
  worker   text not null,
  rule_id  integer not null,
  key      text not null,
  state    jsonb not null,
  primary key (worker, rule_id, key)
) with (fillfactor = 70);

create table semap.pending_row (
  worker  text not null,
  map_id  integer not null,
  uid     text not null,
  row     jsonb not null,
  primary key (worker, map_id, uid)
);

create table semap.late_row (
  late_row_id  bigint generated always as identity primary key,
  map_id       integer not null,
  uid          text not null,
  input        text not null,
  stamp        timestamptz not null,
  watermark    timestamptz not null,
  row          jsonb not null,
  received_at  timestamptz not null default clock_timestamp(),
  replayed_at  timestamptz,
  unique (map_id, uid)
);

create table semap.event (
  seq            bigint primary key,
  event_id       uuid not null unique,
  map_id         integer not null,
  rule_name      text not null,
  rule_version   integer not null,
  type           text not null,
  stamp          timestamptz not null,
  cause          text,
  track_id       bigint,
  track_name     text,
  instance_id    bigint,
  instance_name  text,
  since          timestamptz not null,
  created_at     timestamptz not null default clock_timestamp(),
  key            jsonb not null default '{}' check (jsonb_typeof(key) = 'object'),
  measures       jsonb not null default '{}' check (jsonb_typeof(measures) = 'object'),
  confidence     double precision check (confidence between 0 and 1),
  by_batch       boolean not null default false
);
create index event_stamp on semap.event (stamp);
create index event_map on semap.event (map_id, seq);
create index event_map_stamp on semap.event (map_id, stamp, seq);
comment on column semap.event.seq is
  'Its place among the events of all maps; its gaps within a map tell what happened on others.';

-- The numbers that the events of each map have among themselves, which say nothing of other maps.
create table semap.event_number (
  event_id  uuid primary key references semap.event (event_id) on delete cascade,
  map_id    integer not null,
  number    bigint not null,
  unique (map_id, number)
);
create table semap.event_count (
  map_id  integer primary key,
  newest  bigint not null
);

create table semap.event_evidence (
  event_id  uuid not null references semap.event (event_id),
  place     integer not null,
  uid       uuid not null,
  variable  text not null,
  source    text not null check (source in ('relation', 'object_state', 'map', 'event')),
  stamp     timestamptz not null,
  primary key (event_id, place)
);
comment on column semap.event_evidence.uid is
  'No foreign key: the log shows a row an instant before other sessions may see it.';

create table semap.event_place (
  event_id  uuid primary key references semap.event (event_id) on delete cascade,
  place     public.geometry not null
);
comment on table semap.event_place is
  'Where events were that were gathered from a shard, whose tracks and instances are not here.';

create table semap.recompute_run (
  run_id       integer generated always as identity primary key,
  map_id       integer not null,
  from_stamp   timestamptz not null,
  to_stamp     timestamptz not null,
  settings     jsonb not null default '{}',
  started_at   timestamptz not null default clock_timestamp(),
  finished_at  timestamptz,
  counts       jsonb not null default '{}',
  check (from_stamp <= to_stamp)
);

create table semap.event_amendment (
  event_id     uuid primary key references semap.event (event_id) on delete cascade,
  verdict      text not null check (verdict in ('confirmed', 'retracted', 'amended')),
  by_event_id  uuid references semap.event (event_id) on delete cascade,
  run_id       integer not null references semap.recompute_run on delete cascade,
  amended_at   timestamptz not null default clock_timestamp(),
  check ((verdict = 'amended') = (by_event_id is not null))
);
create index event_amendment_by on semap.event_amendment (by_event_id);
create index event_amendment_run on semap.event_amendment (run_id);
