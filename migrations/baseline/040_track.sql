-- Sources and the tracks that they see.
create table semap.source (
  source_id        integer generated always as identity primary key,
  map_id           integer not null references semap.map on delete cascade,
  name             text not null check (name <> ''),
  watermark        timestamptz check (watermark < '9999-01-01Z'),
  newest_stamp     timestamptz,
  newest_is_whole  boolean not null default false,
  lateness         interval not null default '0' check (lateness >= '0'),
  late_states      bigint not null default 0,
  late_from        timestamptz,
  idle             boolean not null default false,
  ended            boolean not null default false,
  jump_m           double precision default 15 check (jump_m > 0),
  jump_mps         double precision not null default 30 check (jump_mps >= 0),
  outliers         bigint not null default 0,
  unique (map_id, name)
);
comment on column semap.source.watermark is
  'Up to here the source has given all its states, and later ones follow; null where it does not say.';
comment on column semap.source.newest_stamp is
  'Where it says no watermark: its newest stamp, before which all states are taken to have come.';
comment on column semap.source.newest_is_whole is
  'Whether all states at the newest stamp have come: those of a frame have, or silence followed.';
comment on column semap.source.late_from is
  'From which stamp on late states within its lateness are queued: rules wait for their corrections.';

create table semap.source_count (
  source_id        integer primary key references semap.source on delete cascade,
  track_states     bigint not null default 0,
  lines            bigint not null default 0,
  object_states    bigint not null default 0,
  received_at      timestamptz not null default clock_timestamp(),
  newest_stamp     timestamptz not null default '-infinity',
  flushed_stamp    timestamptz not null default '-infinity',
  unflushed        integer not null default 0
) with (fillfactor = 50);
comment on table semap.source_count is
  'What each source has brought in. Beside the source, whose changes all go to the rule worker.';
comment on column semap.source_count.newest_stamp is 'The newest stamp of any state of its tracks.';
comment on column semap.source_count.flushed_stamp is
  'Up to which stamp the positions of its tracks are in track_now; later ones are in its newest chunks.';
comment on column semap.source_count.unflushed is 'How many chunks came since positions were flushed.';

create table semap.recording (
  recording_id  integer generated always as identity primary key,
  source_id     integer not null references semap.source on delete cascade,
  fingerprint   text not null,
  path          text not null,
  states_total  bigint,
  states_done   bigint not null default 0,
  started_at    timestamptz not null default clock_timestamp(),
  finished_at   timestamptz,
  unique (source_id, fingerprint),
  check (states_done between 0 and states_total)
);
comment on column semap.recording.states_total is
  'Null where it is not known before the end; states_done then counts results of perception.';

create table semap.track (
  track_id    bigint generated always as identity primary key,
  uid         uuid not null unique,
  source_id   integer not null references semap.source on delete cascade,
  map_id      integer not null references semap.map on delete cascade,
  name        text not null check (name <> ''),
  ended_at    timestamptz check (ended_at between '1800-01-01Z' and '9999-01-01Z'),
  concept_id  integer references semap.concept,
  attributes  jsonb not null default '{}' check (jsonb_typeof(attributes) = 'object'),
  unique (source_id, name)
);
create index track_map on semap.track (map_id);

create table semap.track_end (
  track_id  bigint not null references semap.track on delete cascade,
  stamp     timestamptz not null,
  primary key (track_id, stamp)
);
comment on table semap.track_end is
  'When tracks were said to have ended, beside states that are their last; some went on after that.';

create table semap.late_state (
  track_id   bigint not null,
  stamp      timestamptz not null,
  source_id  integer not null,
  of_pairs   boolean not null,
  primary key (track_id, of_pairs, stamp)
);
create index late_state_source on semap.late_state (source_id, of_pairs, stamp);
comment on table semap.late_state is
  'States that came late, and whose corrections of the past are to be written: of regions, or of pairs.';

-- Of tracks that amendments are about alone. What has no foreign key is deleted with its tracks by a trigger.
create table semap.track_reading (
  state_track_id  bigint not null,
  from_stamp      timestamptz not null,
  to_stamp        timestamptz not null,
  track_id        bigint not null,
  map_id          integer not null,
  primary key (state_track_id, from_stamp),
  check (from_stamp < to_stamp)
);
create index track_reading_track on semap.track_reading (track_id);
comment on table semap.track_reading is
  'Whose the states of amended tracks are, from a stamp on and before another, as amendments tell.';

create table semap.reading_due (
  source_id   integer not null,
  track_id    bigint not null,
  from_stamp  timestamptz not null
);
create index reading_due_source on semap.reading_due (source_id);
comment on table semap.reading_due is
  'Tracks that are to be read again from a stamp on, for queries that follow amendments.';

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
);
create index track_amendment_other on semap.track_amendment (other_track_id);
comment on table semap.track_amendment is
  'merged: both are one person from then on; the other is older. switched: each followed the other''s.';
