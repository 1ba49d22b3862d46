"""Rules that read more than a query, states of objects, state of rules by key, verdicts on events."""

from alembic import op

revision = "0007"
down_revision = "0006"

OBJECT_STATE = (
    """
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
    )
    """,
    "create index object_state_instance on semap.object_state (instance_id, property, stamp)",
    "create index object_state_map on semap.object_state (map_id, property, stamp)",
    "alter publication semap_change add table semap.object_state",
    "alter publication semap_map add table semap.door_room",
    """
    alter table semap.source
      add column lateness interval not null default '0' check (lateness >= '0'),
      add column idle boolean not null default false,
      add column ended boolean not null default false
    """,
)

RULE = (
    """
    alter table semap.rule
      add column queries jsonb not null default '{}' check (jsonb_typeof(queries) = 'object'),
      add column backfill_from timestamptz check (backfill_from between '1800-01-01Z' and '9999-01-01Z'),
      add column seam jsonb
    """,
    """
    create table semap.rule_query (
      rule_id   integer not null references semap.rule on delete cascade,
      query_id  integer not null references semap.continuous_query deferrable initially deferred,
      primary key (rule_id, query_id)
    )
    """,
    "create index rule_query_query on semap.rule_query (query_id)",
    """
    comment on column semap.rule_query.query_id is
      'Deferred, since with a map go its queries before its rules.'
    """,
    """
    create table semap.rule_version (
      rule_id      integer not null,
      version      integer not null check (version > 0),
      map_id       integer not null references semap.map on delete cascade,
      name         text not null,
      declaration  jsonb not null,
      declared_at  timestamptz not null default clock_timestamp(),
      primary key (rule_id, version)
    )
    """,
    "create index rule_version_name on semap.rule_version (map_id, name)",
    """
    comment on column semap.rule_version.rule_id is
      'No foreign key: versions outlive their rule, so that none of a name comes twice in the ids of events.'
    """,
    """
    insert into semap.rule_query (rule_id, query_id) select rule_id, query_id from semap.rule
    """,
    """
    insert into semap.rule_version (rule_id, version, map_id, name, declaration)
    select rule_id, version, map_id, name, declaration from semap.rule
    """,
    """
    update semap.rule r set queries = jsonb_build_object(q.name, q.query_id)
    from semap.continuous_query q where q.query_id = r.query_id
    """,
    "alter table semap.rule drop column query_id",
    """
    create table semap.rule_state (
      worker   text not null,
      rule_id  integer not null,
      key      text not null,
      state    jsonb not null,
      primary key (worker, rule_id, key)
    ) with (fillfactor = 70)
    """,
    """
    create table semap.pending_row (
      worker  text not null,
      map_id  integer not null,
      uid     text not null,
      row     jsonb not null,
      primary key (worker, map_id, uid)
    )
    """,
    """
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
    )
    """,
    """
    update semap.progress p set rule_state = coalesce((
      select jsonb_object_agg(r.key, (r.value - 'query_id') || jsonb_build_object(
        'queries', jsonb_build_object(r.value -> 'declaration' ->> 'input', r.value -> 'query_id'),
        'backfill_from', null, 'seam', null))
      from jsonb_each(p.rule_state) r), '{}')
    """,
    """
    update semap.progress p set watermarks = jsonb_build_object('maps', coalesce((
      select jsonb_object_agg(map_id, marks) from (
        select s.map_id, jsonb_build_object(
          'released_us', min(w.stamp_us),
          'sources', jsonb_object_agg(
            s.source_id, jsonb_build_object('complete_us', w.stamp_us, 'awaited', true))) marks
        from (
          select key::integer as source_id,
                 (extract(epoch from value::timestamptz) * 1000000)::bigint as stamp_us
          from jsonb_each_text(p.watermarks)) w
        join semap.source s using (source_id)
        group by s.map_id) by_map), '{}'))
    """,
)

EVENT = (
    """
    alter table semap.event
      alter column track_id drop not null,
      alter column track_name drop not null,
      alter column instance_id drop not null,
      alter column instance_name drop not null,
      alter column cause drop not null,
      add column key jsonb not null default '{}' check (jsonb_typeof(key) = 'object'),
      add column measures jsonb not null default '{}' check (jsonb_typeof(measures) = 'object'),
      add column confidence double precision check (confidence between 0 and 1),
      add column by_batch boolean not null default false
    """,
    """
    alter table semap.event_evidence
      add column place integer,
      add column variable text not null default '',
      add column source text not null default 'relation'
        check (source in ('relation', 'object_state', 'map', 'event')),
      add column stamp timestamptz
    """,
    "alter table semap.event_evidence rename column change_uid to uid",
    """
    update semap.event_evidence v set stamp = coalesce(found.stamp, e.stamp), place = found.place
    from (
      select v.event_id, v.uid, c.stamp,
             row_number() over (partition by v.event_id order by c.stamp, v.uid) as place
      from semap.event_evidence v left join semap.relation_change c on c.uid = v.uid
    ) found, semap.event e
    where found.event_id = v.event_id and found.uid = v.uid and e.event_id = v.event_id
    """,
    """
    alter table semap.event_evidence
      alter column place set not null,
      alter column stamp set not null,
      alter column variable drop default,
      alter column source drop default,
      drop constraint event_evidence_pkey,
      add primary key (event_id, place)
    """,
    """
    comment on column semap.event_evidence.uid is
      'No foreign key: the log shows a row an instant before other sessions may see it.'
    """,
    """
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
    )
    """,
    """
    create table semap.event_amendment (
      event_id     uuid primary key references semap.event (event_id) on delete cascade,
      verdict      text not null check (verdict in ('confirmed', 'retracted', 'amended')),
      by_event_id  uuid references semap.event (event_id) on delete cascade,
      run_id       integer not null references semap.recompute_run on delete cascade,
      amended_at   timestamptz not null default clock_timestamp(),
      check ((verdict = 'amended') = (by_event_id is not null))
    )
    """,
    "create index event_amendment_by on semap.event_amendment (by_event_id)",
    "create index event_amendment_run on semap.event_amendment (run_id)",
)


def upgrade() -> None:
    for statement in (*OBJECT_STATE, *RULE, *EVENT):
        op.execute(statement)
