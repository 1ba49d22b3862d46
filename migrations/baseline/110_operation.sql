-- What operations need: which behaviour is applied, how long data stays, jobs and webhooks.
create table semap.behaviour (
  checksum    text not null,
  applied_at  timestamptz not null default clock_timestamp()
);

create table semap.retention (
  kind         text primary key check (kind in ('states', 'lines', 'changes', 'events')),
  drop_after   interval check (drop_after > '0'),
  gone_before  timestamptz
);
comment on table semap.retention is
  'How long what is kept, by event time. Without an age nothing of a kind is dropped.';
comment on column semap.retention.gone_before is 'What is older has been dropped.';
insert into semap.retention (kind) values ('states'), ('lines'), ('changes'), ('events');

create table semap.job (
  job_id            integer generated always as identity primary key,
  kind              text not null check (kind in ('map_import', 'instance_import', 'mesh_upload')),
  map               text,
  file              text not null,
  state             text not null default 'waiting'
                    check (state in ('waiting', 'running', 'done', 'failed', 'cancelled')),
  cancel_requested  boolean not null default false,
  progress          real not null default 0 check (progress between 0 and 1),
  message           text not null default '',
  result            jsonb,
  problem           jsonb,
  token_id          bigint,
  created_by        text not null,
  created_at        timestamptz not null default clock_timestamp(),
  finished_at       timestamptz,
  check ((finished_at is null) = (state in ('waiting', 'running'))),
  check ((result is not null) = (state = 'done')),
  check ((problem is not null) = (state = 'failed'))
);
create index job_unfinished on semap.job (job_id) where finished_at is null;
comment on table semap.job is
  'Imports that run beside the request that brought them. Whoever runs one, or holds its file, holds the '
  'advisory lock (7369, job_id) in share mode; one that nobody holds was lost.';
comment on column semap.job.token_id is 'Whose job it is; null: of a service without tokens.';
comment on column semap.job.problem is 'What a synchronous import would have answered (RFC 9457).';

create table semap.webhook (
  webhook_id         integer generated always as identity primary key,
  url                text not null,
  description        text not null default '',
  maps               text[],
  event_type         text,
  rule_name          text,
  filter             text,
  state              text not null default 'active' check (state in ('active', 'paused', 'disabled')),
  state_reason       text not null default '',
  cursor             bigint not null,
  attempts           integer not null default 0 check (attempts >= 0),
  next_attempt_at    timestamptz not null default '-infinity',
  given_up_in_row    integer not null default 0 check (given_up_in_row >= 0),
  delivered_count    bigint not null default 0,
  failed_count       bigint not null default 0,
  last_delivered_at  timestamptz,
  last_error         text not null default '',
  last_error_at      timestamptz,
  created_by         text not null,
  created_at         timestamptz not null default clock_timestamp(),
  check (cardinality(maps) > 0)
);
comment on column semap.webhook.maps is 'Names of the maps whose events it gets; null: of all.';
comment on column semap.webhook.cursor is
  'Number of the last event that was delivered, set aside or not selected.';
comment on column semap.webhook.attempts is 'How often the event after the cursor was tried in vain.';
comment on column semap.webhook.given_up_in_row is 'How many events were set aside since one was delivered.';

create table semap.webhook_secret (
  webhook_secret_id  integer generated always as identity primary key,
  webhook_id         integer not null references semap.webhook on delete cascade,
  secret             bytea not null check (length(secret) between 24 and 64),
  created_at         timestamptz not null default clock_timestamp(),
  expires_at         timestamptz
);
create index webhook_secret_webhook on semap.webhook_secret (webhook_id);
comment on table semap.webhook_secret is
  'Keys that sign. In clear, since they are needed to sign; only semap_admin may read them.';

create table semap.webhook_dead_letter (
  webhook_dead_letter_id  bigint generated always as identity primary key,
  webhook_id              integer not null references semap.webhook on delete cascade,
  seq                     bigint not null,
  event_id                uuid not null,
  map                     text not null,
  type                    text not null,
  body                    text not null,
  attempts                integer not null,
  error                   text not null,
  status                  smallint,
  given_up_at             timestamptz not null default clock_timestamp(),
  resend_requested_at     timestamptz,
  unique (webhook_id, seq)
);
create index webhook_dead_letter_resend on semap.webhook_dead_letter (webhook_id, webhook_dead_letter_id)
  where resend_requested_at is not null;
comment on table semap.webhook_dead_letter is 'Events that a webhook did not take, as they were sent.';

create table semap.bridge (
  map_id      integer not null references semap.map on delete cascade,
  name        text not null check (name <> ''),
  kind        text not null,
  state       text not null check (state in ('connected', 'waiting', 'ended')),
  trouble     text not null default '',
  lag_s       double precision,
  received    bigint not null default 0,
  committed   bigint not null default 0,
  delivered   bigint not null default 0,
  dropped     bigint not null default 0,
  refused     bigint not null default 0,
  reconnects  bigint not null default 0,
  refusals    jsonb not null default '{}' check (jsonb_typeof(refusals) = 'object'),
  started_at  timestamptz not null default clock_timestamp(),
  told_at     timestamptz not null default clock_timestamp(),
  primary key (map_id, name)
);
comment on table semap.bridge is 'What each bridge has said of itself last; counts are since it was started.';
comment on column semap.bridge.lag_s is
  'How long the oldest that came in has waited to be passed on, or what was passed on last had; null: nothing yet.';
comment on column semap.bridge.refusals is 'How many records were refused, by the reason.';

create table semap.bridge_position (
  map_id    integer not null references semap.map on delete cascade,
  name      text not null check (name <> ''),
  way       text not null check (way in ('in', 'out', 'changes', 'client')),
  position  jsonb,
  moved_at  timestamptz not null default clock_timestamp(),
  primary key (map_id, name, way)
);
comment on table semap.bridge_position is
  'How far a bridge has come in what it reads, or writes, or a client of the service in what it sends.';
