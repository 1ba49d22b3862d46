"""What late states may correct of pairs: since when a query, and an instance in it, has its form."""

from alembic import op

revision = "0020"
down_revision = "0019"

STATEMENTS = (
    # Pairs of tracks that are older than a form are corrected only after the newest state of its map.
    """
    create table semap.pair_form (
      query_id         integer primary key references semap.continuous_query on delete cascade,
      map_id           integer not null,
      formed_stamp     timestamptz not null,
      formed_track_id  bigint not null
    )
    """,
    """
    alter table semap.pair_member
      add column formed_stamp timestamptz not null default '-infinity',
      add column formed_track_id bigint not null default 0
    """,
    """
    insert into semap.pair_form
    select q.query_id, q.map_id, n.stamp, n.track_id
    from semap.continuous_query q
    join (select map_id, max(stamp) as stamp, max(track_id) as track_id
          from semap.track_now group by map_id) n using (map_id)
    where q.in_pairs
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
