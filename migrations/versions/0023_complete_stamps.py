"""Up to where all states of a source, and of a map, have come; and up to where pairs follow them."""

from alembic import op

revision = "0023"
down_revision = "0022"

STATEMENTS = (
    """
    alter table semap.source
      alter column watermark drop not null,
      alter column watermark drop default,
      add column newest_stamp timestamptz,
      add column newest_is_whole boolean not null default false
    """,
    "update semap.source set watermark = null where watermark = '-infinity'",
    """
    comment on column semap.source.watermark is
      'Up to here the source has given all its states, and later ones follow; null where it does not say.'
    """,
    """
    comment on column semap.source.newest_stamp is
      'Where it says no watermark: its newest stamp, before which all states are taken to have come.'
    """,
    """
    comment on column semap.source.newest_is_whole is
      'Whether all states at the newest stamp have come: those of a frame have, or silence followed.'
    """,
    """
    create table semap.pair_progress (
      map_id   integer primary key references semap.map on delete cascade,
      through  timestamptz not null
    )
    """,
    """
    comment on table semap.pair_progress is
      'Up to which stamp the pairs of a map were followed; tracks in pair_member are where they were then.'
    """,
    """
    create table semap.track_end (
      track_id  bigint not null references semap.track on delete cascade,
      stamp     timestamptz not null,
      primary key (track_id, stamp)
    )
    """,
    """
    comment on table semap.track_end is
      'When tracks were said to have ended, beside states that are their last; some went on after that.'
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
