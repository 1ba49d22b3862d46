"""What there is in the database, and how far the rule worker has come, for whoever looks by hand."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, text

from semap.store.database import translated

STATUS = text("""
    select (select version_num from semap.schema_version) as schema,
           (select count(*) from semap.map) as maps, (select count(*) from semap.instance) as instances,
           (select count(*) from semap.track) as tracks, (select count(*) from semap.event) as events,
           coalesce(p.event_seq, 0) as last_event, coalesce(s.active, false) as worker_running,
           p.updated_at as worker_committed_at,
           cast(pg_wal_lsn_diff(pg_current_wal_lsn(), s.confirmed_flush_lsn) as bigint) as worker_behind_bytes
    from (values ('rules')) w (worker)
    left join semap.progress p using (worker)
    left join pg_replication_slots s on p.worker is not null and s.slot_name = semap.rule_slot()
""")
SUMS_OF_VISITS = text("""
    select instance_name, count(*) filter (where type = 'entered'), count(*) filter (where type = 'left')
    from semap.event where seq > :after and type in ('entered', 'left')
    group by instance_name order by instance_name
""")
SUMS_OF_TYPES = text("""
    select type, count(*) from semap.event where seq > :after and cause is null group by type order by type
""")
ALL_MADE = text("""
    select (select count(*) from semap.relation_change where map_id = m.map_id)
           = (select count(*) from semap.event where map_id = m.map_id and cause is not null)
           and not exists (select from semap.pending_row w where w.map_id = m.map_id)
    from semap.map m where m.name = :map
""")


@dataclass(frozen=True)
class Status:
    """Counts of everything, the number of the last event, and what the rule worker has not confirmed yet."""

    schema: str | None
    maps: int
    instances: int
    tracks: int
    events: int
    last_event: int
    worker_running: bool
    worker_committed_at: datetime | None
    worker_behind_bytes: int | None


def read_status(connection: Connection) -> Status:
    with translated():
        return Status(*connection.execute(STATUS).one())


def sum_visits(connection: Connection, after: int) -> tuple[tuple[str, int, int], ...]:
    """Each instance that tracks visited in events after a number, how many entered and how many left."""
    with translated():
        return tuple((row[0], row[1], row[2]) for row in connection.execute(SUMS_OF_VISITS, {"after": after}))


def sum_types(connection: Connection, after: int) -> tuple[tuple[str, int], ...]:
    """How often each type came after a number, of events that no single change of a relation made."""
    with translated():
        return tuple((row[0], row[1]) for row in connection.execute(SUMS_OF_TYPES, {"after": after}))


def are_events_made(connection: Connection, map_name: str) -> bool:
    """Whether the rule worker has read all that is known of a map, each of whose changes makes an event."""
    with translated():
        return bool(connection.scalar(ALL_MADE, {"map": map_name}))
