"""Where the bytes of a database go, and how fast it grows.

Rows of tables are the server's own estimate, since to count them would be to read everything; states are
counted, which reads one row for many.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta

from sqlalchemy import Connection, text

from semap.store.database.connection import translated
from semap.store.operate.retention import Kind, Retention, read_retention

STATES = "states of tracks"
GROUPS: Mapping[str, Sequence[str]] = {
    STATES: ("state_chunk", "track_state"),
    "lines": ("line_observation", "camera_report"),
    "tracks and sources": (
        "track", "track_now", "track_amendment", "track_reading", "source", "source_count", "recording",
    ),
    "relations and regions": (
        "relation", "relation_past", "pair_query", "pair_instance",
        "followed_state", "continuous_query", "query_track", "region", "region_cell", "region_edge",
    ),
    "changes": ("relation_change", "object_state", "door_now"),
    "events and evidence": (
        "event", "event_number", "event_count", "event_evidence", "event_place", "event_amendment",
        "recompute_run",
    ),
    "rules and their state": (
        "rule", "rule_query", "rule_version", "rule_state", "pending_row", "late_row", "progress",
        "collected",
    ),
    "history of the map": ("change_set", "row_version"),
    "map and meshes": (
        "map", "place", "shard", "map_anchor", "map_grid", "concept", "concept_parent", "concept_iri",
        "frame", "frame_pose", "description", "geometry", "abstraction", "instance", "door_room", "door_leaf",
    ),
}  # fmt: skip
OTHERS = "jobs, webhooks and others"
REST = "the rest of the database"
LOG = "log kept for slots"
GROWTH_DAYS = 7

TABLES = text("""
    select coalesce(p.relname, c.relname)::text,
           to_date(substring(c.relname from '_([0-9]{8})$'), 'YYYYMMDD'),
           case when c.reltuples > 0 and c.relpages > 0
                then c.reltuples / c.relpages * pg_relation_size(c.oid)
                     / current_setting('block_size')::integer
                else pg_stat_get_live_tuples(c.oid) end::bigint,
           pg_table_size(c.oid), pg_indexes_size(c.oid)
    from pg_class c
    left join pg_inherits i on i.inhrelid = c.oid
    left join pg_class p on p.oid = i.inhparent
    where c.relnamespace = 'semap'::regnamespace and c.relkind = 'r'
    order by 2 nulls last, 1
""")
COUNTED = text("""
    select to_date(substring(tableoid::regclass::text from '_([0-9]{8})$'), 'YYYYMMDD'), sum(states)::bigint
    from semap.state_chunk group by 1
""")
WHOLE = text("""
    select pg_database_size(current_database()), clock_timestamp(),
           coalesce((select max(pg_wal_lsn_diff(pg_current_wal_lsn(), restart_lsn))
                     from pg_replication_slots), 0)::bigint
""")


@dataclass(frozen=True)
class Part:
    """What one kind of thing takes.

    rows         about so many; None where to count them says nothing
    table_bytes  with long values, which lie outside of rows
    """

    name: str
    rows: int | None
    table_bytes: int
    index_bytes: int

    @property
    def bytes(self) -> int:
        return self.table_bytes + self.index_bytes


@dataclass(frozen=True)
class DayOfStates:
    """The states of a day; day is None for those that lie in no partition of their day."""

    day: date | None
    states: int
    table_bytes: int
    index_bytes: int

    @property
    def bytes(self) -> int:
        return self.table_bytes + self.index_bytes


@dataclass(frozen=True)
class DiskUse:
    """growth_bytes and growth_states are of a day, means of the last GROWTH_DAYS whole days by event time."""

    at: datetime
    total_bytes: int
    parts: tuple[Part, ...]
    days: tuple[DayOfStates, ...]
    growth_bytes: int
    growth_states: int
    retention: Mapping[Kind, Retention]

    def due(self) -> tuple[str, ...]:
        """What maintenance does next by the settings, in words."""
        states = self.retention["states"]
        days = [each.day for each in self.days if each.day and each.states]
        said = []
        if states.drop_after and days:
            said.append(f"states of {min(days)} are dropped {_when(min(days), states.drop_after, self.at)}")
        return tuple(said)


@dataclass(frozen=True)
class _Table:
    """A table, or a partition of one; `day` is that in its name."""

    name: str
    day: date | None
    rows: int
    table_bytes: int
    index_bytes: int


def read_disk_use(connection: Connection) -> DiskUse:
    """As it is now."""
    with translated():
        tables = [_Table(*row) for row in connection.execute(TABLES)]
        counted: dict[date | None, int] = dict(connection.execute(COUNTED).all())
        total_bytes, at, log_bytes = connection.execute(WHOLE).one()
        retention = read_retention(connection)
    days = _days(tables, counted)
    parts = _parts(tables, sum(counted.values()))
    parts.append(Part(REST, None, total_bytes - sum(part.bytes for part in parts), 0))
    parts.append(Part(LOG, None, log_bytes, 0))
    growth = _growth(tables, days, at.date())
    return DiskUse(at, total_bytes + log_bytes, tuple(parts), days, *growth, retention)


def _parts(tables: Sequence[_Table], states: int) -> list[Part]:
    """By group; states are told by themselves, not by the rows that hold them."""
    parts = []
    for group, names in {**GROUPS, OTHERS: None}.items():
        known = {name for names in GROUPS.values() for name in names} if names is None else names
        of_group = [each for each in tables if (each.name in known) is not (names is None)]
        rows = states if group == STATES else sum(each.rows for each in of_group)
        parts.append(
            Part(
                group,
                None if names is None else rows,
                sum(each.table_bytes for each in of_group),
                sum(each.index_bytes for each in of_group),
            )
        )
    return parts


def _days(tables: Sequence[_Table], counted: Mapping[date | None, int]) -> tuple[DayOfStates, ...]:
    days = [
        DayOfStates(each.day, counted.get(each.day, 0), each.table_bytes, each.index_bytes)
        for each in tables
        if each.name == "state_chunk" and (each.day or counted.get(None))
    ]
    return tuple(sorted(days, key=lambda each: (each.day is None, each.day or date.min)))


def _growth(tables: Sequence[_Table], days: Sequence[DayOfStates], today: date) -> tuple[int, int]:
    """Bytes and states that a day brings: states as they lie there now, and lines."""
    last = {today - timedelta(days=back) for back in range(1, GROWTH_DAYS + 1)}
    lines = [each for each in tables if each.name == "line_observation" and each.day in last]
    states = [each for each in days if each.day in last]
    in_bytes = sum(each.table_bytes + each.index_bytes for each in lines)
    in_bytes += sum(each.bytes for each in states)
    return in_bytes // GROWTH_DAYS, sum(each.states for each in states) // GROWTH_DAYS


def _when(day: date, age: timedelta, now: datetime) -> str:
    due = datetime(day.year, day.month, day.day, tzinfo=now.tzinfo) + timedelta(days=1) + age
    return "at the next maintenance" if due <= now else f"from {due:%Y-%m-%d %H:%M} UTC on"
