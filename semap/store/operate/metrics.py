"""What the tables and the server say about how semap is doing: bounded, and cheap to ask.

Lags come as samples: of what is new since the last time the newest SAMPLES are looked at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, text

from semap.store.database.connection import translated

SAMPLES = 200
SOURCES = 100
WEBHOOKS = 50
MOST_BRIDGES = 50
DEAD_LETTERS = 100
"""So many are told apart or counted at most."""

SLOTS = text("""
    select slot_name::text, active,
           coalesce(pg_wal_lsn_diff(pg_current_wal_lsn(), confirmed_flush_lsn), 0)::bigint,
           coalesce(pg_wal_lsn_diff(pg_current_wal_lsn(), restart_lsn), 0)::bigint,
           coalesce(wal_status, 'lost')
    from pg_replication_slots where database = current_database() and not temporary
    order by slot_name limit 20
""")
WORKER = text("""
    select p.event_seq, p.late_rows, p.updated_at,
           coalesce((select max(change_id) from semap.relation_change), 0),
           coalesce((select jsonb_object_agg(rule_id, jsonb_build_array(r.name, g.attempts))
                     from semap.rule_given_up g join semap.rule r using (rule_id)), '{}')
    from semap.progress p where p.worker = 'rules'
""")
RECEIVED = text("""
    select m.name, s.name, c.track_states, c.lines, c.object_states, s.late_states,
           (select count(*) from semap.late_state l where l.source_id = s.source_id), c.received_at,
           nullif(coalesce(s.watermark, s.newest_stamp), '-infinity'), s.idle or s.ended
    from semap.source_count c join semap.source s using (source_id) join semap.map m using (map_id)
    order by c.received_at desc limit :limit
""")
JOBS = text("select state, count(*) from semap.job group by state")
WEBHOOK = text("""
    select w.webhook_id, w.state, greatest(p.event_seq - w.cursor, 0), w.delivered_count, w.failed_count,
           (select count(*) from (select from semap.webhook_dead_letter d where d.webhook_id = w.webhook_id
                                  limit :dead_letters) d)
    from semap.webhook w cross join semap.progress p where p.worker = 'rules'
    order by w.webhook_id limit :limit
""")
NEW_RELATIONS = text("""
    select change_id, extract(epoch from received_at - stamp)::double precision
    from semap.relation_change where change_id > :after order by change_id desc limit :limit
""")
NEW_EVENTS = text("""
    select e.seq, m.name, e.rule_name,
           (select extract(epoch from e.created_at - max(coalesce(c.received_at, o.received_at)))
                   ::double precision
            from semap.event_evidence v
            left join semap.relation_change c on v.source in ('relation', 'map') and c.uid = v.uid
            left join semap.object_state o on v.source = 'object_state' and o.uid = v.uid
            where v.event_id = e.event_id)
    from (select * from semap.event where seq > :after and not by_batch order by seq desc limit :limit) e
    join semap.map m using (map_id)
""")

BRIDGES = text("""
    select m.name, b.name, b.kind, b.state = 'connected', b.lag_s, b.received, b.committed, b.delivered,
           b.dropped, b.reconnects, b.refusals, b.told_at
    from semap.bridge b join semap.map m using (map_id) where b.state <> 'ended'
    order by b.told_at desc limit :limit
""")


@dataclass(frozen=True)
class SlotFigures:
    """behind_bytes is not confirmed yet; kept_bytes is what the server keeps of its log for it."""

    name: str
    active: bool
    behind_bytes: int
    kept_bytes: int
    wal_status: str


@dataclass(frozen=True)
class WorkerFigures:
    """dropped: attempts that the version in force gave up, by the id of the rule, with its name."""

    events: int
    late_rows: int
    committed_at: datetime
    relation_changes: int
    dropped: Mapping[str, tuple[str, int]]


@dataclass(frozen=True)
class SourceFigures:
    """What a source has brought in since it is there."""

    map: str
    name: str
    track_states: int
    lines: int
    object_states: int
    late_states: int
    late_waiting: int
    received_at: datetime
    watermark: datetime | None
    is_silent: bool


@dataclass(frozen=True)
class WebhookFigures:
    """waiting counts events that may yet not be selected."""

    webhook_id: int
    state: str
    waiting: int
    delivered: int
    failed: int
    dead_letters: int


@dataclass(frozen=True)
class BridgeFigures:
    """What a bridge that has not ended says of itself (`semap/store/motion/bridges`)."""

    map: str
    name: str
    kind: str
    is_connected: bool
    lag_s: float | None
    received: int
    committed: int
    delivered: int
    dropped: int
    reconnects: int
    refusals: Mapping[str, int]
    told_at: datetime


@dataclass(frozen=True)
class Figures:
    """worker is None where the schema is there and its worker was never begun."""

    slots: tuple[SlotFigures, ...]
    worker: WorkerFigures | None
    sources: tuple[SourceFigures, ...]
    jobs: Mapping[str, int]
    webhooks: tuple[WebhookFigures, ...]
    bridges: tuple[BridgeFigures, ...]


@dataclass(frozen=True)
class LagSamples:
    """What was new.

    relation_cursor, event_cursor  where to go on
    relations_s                    from stamps to when their relations were written
    events                         map, rule, and seconds from the last evidence to the event
    """

    relation_cursor: int
    event_cursor: int
    relations_s: tuple[float, ...]
    events: tuple[tuple[str, str, float], ...]


def read_figures(connection: Connection) -> Figures:
    """As they are now."""
    with translated():
        worker = connection.execute(WORKER).one_or_none()
        return Figures(
            tuple(SlotFigures(*row) for row in connection.execute(SLOTS)),
            None if worker is None else WorkerFigures(*worker),
            tuple(SourceFigures(*row) for row in connection.execute(RECEIVED, {"limit": SOURCES})),
            {str(state): int(count) for state, count in connection.execute(JOBS)},
            tuple(
                WebhookFigures(*row)
                for row in connection.execute(WEBHOOK, {"limit": WEBHOOKS, "dead_letters": DEAD_LETTERS})
            ),
            tuple(BridgeFigures(*row) for row in connection.execute(BRIDGES, {"limit": MOST_BRIDGES})),
        )


def newest(connection: Connection) -> tuple[int, int]:
    """The cursors behind all that is there now."""
    with translated():
        row = connection.execute(
            text(
                "select coalesce((select max(change_id) from semap.relation_change), 0),"
                " coalesce((select max(seq) from semap.event), 0)"
            )
        ).one()
    return int(row[0]), int(row[1])


def sample_lags(connection: Connection, relation_cursor: int, event_cursor: int) -> LagSamples:
    """Of what came after the cursors, the newest SAMPLES of each kind."""
    with translated():
        relations = connection.execute(NEW_RELATIONS, {"after": relation_cursor, "limit": SAMPLES}).all()
        events = connection.execute(NEW_EVENTS, {"after": event_cursor, "limit": SAMPLES}).all()
    return LagSamples(
        max((row[0] for row in relations), default=relation_cursor),
        max((row[0] for row in events), default=event_cursor),
        tuple(row[1] for row in relations),
        tuple((map_name, rule, lag_s) for _, map_name, rule, lag_s in events if lag_s is not None),
    )
