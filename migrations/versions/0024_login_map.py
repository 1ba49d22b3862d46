"""Which maps a login of one's own sees."""

from alembic import op

revision = "0024"
down_revision = "0023"

STATEMENTS = (
    """
    create table semap.login_map (
      login   regrole not null,
      map_id  integer not null references semap.map on delete cascade,
      primary key (login, map_id)
    )
    """,
    "create index login_map_map on semap.login_map (map_id)",
    """
    comment on table semap.login_map is
      'The maps of each login, or of a role that logins are members of, that may not see every map.'
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
