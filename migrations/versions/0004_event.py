"""Rules, the events that they make with their evidence, and how far a worker has come."""

from alembic import op

revision = "0004"
down_revision = "0003"

STATEMENTS = (
    """
    create table semap.rule (
      rule_id      integer generated always as identity primary key,
      map_id       integer not null references semap.map on delete cascade,
      name         text not null check (name <> ''),
      version      integer not null default 1 check (version > 0),
      query_id     integer not null references semap.continuous_query on delete cascade,
      declaration  jsonb not null,
      enabled      boolean not null default true,
      unique (map_id, name)
    )
    """,
    "alter table semap.rule replica identity full",
    """
    create table semap.progress (
      worker      text primary key,
      lsn         pg_lsn not null,
      event_seq   bigint not null default 0,
      rule_state  jsonb not null default '{}',
      watermarks  jsonb not null default '{}',
      updated_at  timestamptz not null default clock_timestamp()
    )
    """,
    """
    create table semap.event (
      seq            bigint primary key,
      event_id       uuid not null unique,
      map_id         integer not null,
      rule_name      text not null,
      rule_version   integer not null,
      type           text not null,
      stamp          timestamptz not null,
      cause          text not null,
      track_id       bigint not null,
      track_name     text not null,
      instance_id    bigint not null,
      instance_name  text not null,
      since          timestamptz not null,
      created_at     timestamptz not null default clock_timestamp()
    )
    """,
    "create index event_stamp on semap.event (stamp)",
    "create index event_map on semap.event (map_id, seq)",
    """
    create table semap.event_evidence (
      event_id    uuid not null references semap.event (event_id),
      change_uid  uuid not null,
      primary key (event_id, change_uid)
    )
    """,
    """
    comment on column semap.event_evidence.change_uid is
      'No foreign key: the log shows a change an instant before other sessions may see its row.'
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
