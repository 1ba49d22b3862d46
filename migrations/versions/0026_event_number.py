"""The numbers that the events of each map have among themselves, which say nothing of other maps."""

from alembic import op

revision = "0026"
down_revision = "0025"

STATEMENTS = (
    """
    create table semap.event_number (
      event_id  uuid primary key references semap.event (event_id) on delete cascade,
      map_id    integer not null,
      number    bigint not null,
      unique (map_id, number)
    )
    """,
    "create table semap.event_count (map_id integer primary key, newest bigint not null)",
    """
    insert into semap.event_number (event_id, map_id, number)
    select event_id, map_id, row_number() over (partition by map_id order by seq) from semap.event
    """,
    """
    insert into semap.event_count (map_id, newest)
    select map_id, max(number) from semap.event_number group by map_id
    """,
    """
    comment on column semap.event.seq is
      'Its place among the events of all maps; its gaps within a map tell what happened on others.'
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
