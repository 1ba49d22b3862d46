"""The flow from sources to events: the log, the worker, sources, rules."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import Connection, text

from semap.model.given_up import GivenUp
from semap.store.operate.doctor.finding import DatabaseCheck, Trouble, listed, mebibytes, warn, wrong

BEHIND_BYTES = 64 * 1024**2
KEPT_BYTES = 4 * 1024**3
LATE_SHARE = 0.01

WORK_IS_NEEDED = "Start it: semap work (or semap up, or systemctl start semap-work)."
RESYNC = "Stop the rule worker and run: semap db resync"


def _slot(connection: Connection) -> Iterator[Trouble]:
    row = connection.execute(
        text(
            "select s.slot_name, s.wal_status, pg_wal_lsn_diff(pg_current_wal_lsn(), s.restart_lsn)::bigint,"
            " (select nullif(setting::bigint, -1) * 1024 * 1024 from pg_settings"
            "  where name = 'max_slot_wal_keep_size')"
            " from (select semap.rule_slot() as name) wanted"
            " left join pg_replication_slots s on s.slot_name = wanted.name"
        )
    ).first()
    name, status, kept, most = row or (None, None, None, None)
    if name is None:
        yield wrong("the rule worker's replication slot is missing", RESYNC)
    elif status == "lost":
        yield wrong("the rule worker's slot has lost its place: the log it needs is gone", RESYNC)
    elif kept is not None and most is not None and kept > most / 2:
        yield warn(
            f"the server keeps {mebibytes(kept)} of log for the rule worker, of {mebibytes(most)} at most",
            WORK_IS_NEEDED,
        )
    elif kept is not None and kept > KEPT_BYTES:
        yield warn(f"the server keeps {mebibytes(kept)} of log for the rule worker", WORK_IS_NEEDED)


def _other_slots(connection: Connection) -> Iterator[Trouble]:
    for name, kept in connection.execute(
        text(
            "select slot_name, pg_wal_lsn_diff(pg_current_wal_lsn(), restart_lsn)::bigint"
            " from pg_replication_slots where not active and slot_name <> semap.rule_slot()"
            " order by restart_lsn limit 20"
        )
    ):
        if kept is not None and kept > BEHIND_BYTES:
            yield warn(
                f"no process reads the slot {name}, for which the server keeps {mebibytes(kept)} of log",
                f"If it is needed no more: SELECT pg_drop_replication_slot('{name}');",
            )


def _worker(connection: Connection) -> Iterator[Trouble]:
    row = connection.execute(
        text(
            "select s.active, pg_wal_lsn_diff(pg_current_wal_lsn(), s.confirmed_flush_lsn)::bigint"
            " from pg_replication_slots s where s.slot_name = semap.rule_slot()"
        )
    ).first()
    if row is None or not row[0]:
        yield wrong("no rule worker runs: changes make no events", WORK_IS_NEEDED)
    elif row[1] > BEHIND_BYTES:
        yield warn(
            f"the rule worker is {mebibytes(row[1])} of log behind",
            "Give it time, or a faster machine; see semap_slot_lag_bytes in /metrics.",
        )


def _sources(connection: Connection) -> Iterator[Trouble]:
    idle = connection.scalars(
        text(
            "select m.name || '/' || s.name from semap.source s join semap.map m using (map_id)"
            " where s.idle and not s.ended order by 1 limit 100"
        )
    ).all()
    if idle:
        yield warn(
            f"silent sources, for which rules wait no more: {listed(idle)}",
            "See that the sensor and its `semap ingest` run.",
        )
    for name, late, states, is_of_lines in connection.execute(
        text(
            "select m.name || '/' || s.name, s.late_states, c.track_states + c.lines, c.track_states = 0"
            " from semap.source s"
            " join semap.map m using (map_id) join semap.source_count c using (source_id)"
            " where s.late_states > :share * (c.track_states + c.lines) order by s.late_states desc limit 5"
        ),
        {"share": LATE_SHARE},
    ):
        consequence = (
            "came too late to move a door"
            if is_of_lines
            else "came late: they corrected relations, and rules read them late or not at all"
        )
        yield warn(
            f"of {states} states of source {name}, {late} {consequence}",
            "Bring each recording in once, in the order of stamps, each sensor as a source of its own.",
        )


def _rules(connection: Connection) -> Iterator[Trouble]:
    failed = connection.scalars(
        text(
            "select m.name || '/' || r.name from semap.rule r join semap.map m using (map_id)"
            " join semap.rule_version v using (rule_id, version) cross join semap.progress p"
            " where p.worker = 'rules' and r.enabled and not p.rule_state ? r.rule_id::text"
            " and to_timestamp((p.watermarks ->> 'committed_at_us')::double precision / 1e6)"
            "     > v.declared_at + interval '10 s' order by 1 limit 100"
        )
    ).all()
    if failed:
        yield wrong(
            f"rules that the worker has put out of force: {listed(failed)}",
            "The worker's log has the error; correct the rule: semap rule replace NAME FILE.",
        )
    for name, *noted in connection.execute(
        text(
            "select m.name || '/' || r.name, g.attempts, g.first, g.key, g.matches from semap.rule_given_up g"
            " join semap.rule r using (rule_id) join semap.map m on m.map_id = g.map_id"
            " order by g.first, 1 limit 5"
        )
    ):
        given_up = GivenUp(*noted)
        yield warn(f"rule {name}: {given_up.loss()}", given_up.remedy)


def _late_rows(connection: Connection) -> Iterator[Trouble]:
    row = connection.execute(
        text("select count(*) from (select from semap.late_row where replayed_at is null limit 1000) l")
    ).first()
    if row and row[0]:
        count = "1000 or more" if row[0] == 1000 else str(row[0])
        yield warn(
            f"{count} rows came after their watermark, and no rule has seen them",
            "Give them to the rules: semap rule replay-late; and give their source a lateness.",
        )


def _bridges(connection: Connection) -> Iterator[Trouble]:
    for name, is_silent, trouble, dropped, refused in connection.execute(
        text(
            "select m.name || '/' || b.name, b.told_at < clock_timestamp() - interval '1 min', b.trouble,"
            " b.dropped, b.refused from semap.bridge b join semap.map m using (map_id)"
            " where b.state <> 'ended' order by 1 limit 50"
        )
    ):
        if is_silent:
            yield wrong(f"the bridge {name} does not run any more", "Start it: semap bridge CONFIG.yaml")
        elif trouble:
            yield wrong(f"the bridge {name} waits: {trouble}", "Its log says what to do.")
        if dropped:
            yield warn(
                f"the bridge {name} dropped {dropped} records, which came faster than they could be stored",
                "See that the database keeps up, or give the bridge a longer `queue`.",
            )
        if refused:
            yield warn(
                f"the bridge {name} refused {refused} records",
                "semap bridge check CONFIG.yaml says why; correct the sender.",
            )


FLOW_CHECKS = (
    DatabaseCheck("slot", "the rule worker's slot is there", _slot),
    DatabaseCheck("other slots", "no unread slot retains the log", _other_slots),
    DatabaseCheck("worker", "a rule worker runs and keeps up", _worker),
    DatabaseCheck("sources", "no source is silent or late", _sources),
    DatabaseCheck("rules", "all rules are in force", _rules),
    DatabaseCheck("bridges", "all bridges run and keep up", _bridges),
    DatabaseCheck("late rows", "no row waits that came too late", _late_rows),
)
