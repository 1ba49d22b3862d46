"""What is stored: shapes and partitions; and what the service keeps: webhooks, jobs, tokens."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import Connection, text

from semap.store.operate.doctor.finding import DatabaseCheck, Trouble, listed, warn, wrong

JOB_LOCK = 7369
STUCK = "10 min"
EXPIRES_WITHIN = "7 days"
PARTITIONS = 1000
STRAYED = "select exists (select from semap.{}_default)"
OVERDUE = text("""
    select d.day::text from semap.day_partitions() d
    where d.day + 2 < (semap.kept_since(case d.of_table when 'state_chunk' then 'states' else 'lines' end)
                       at time zone 'UTC')::date
      and coalesce(d.made_at < clock_timestamp() - interval '2 h', true)
    order by d.day limit 100
""")
"""What was put off, or nobody does, is told after two days."""
SHAPELESS = text("""
    select s.query_name, array_agg(m.name || '/' || i.name order by m.name, i.name)
    from semap.query_side s
    join semap.map m using (map_id)
    join semap.instance i on i.map_id = s.map_id
    where s.enabled and s.kind = 'instance' and (s.concept_id is not null or s.uids is not null)
      and (s.concept_id is null or i.concept_id in (select semap.concepts_below(s.concept_id)))
      and (s.uids is null or i.uid = any (s.uids))
      and (s.condition_id is null
           or semap.condition_holds(s.condition_id, s.said, i.name, i.alias, i.attributes))
      and (s.in_pairs or s.is_object)
      and not exists (select from semap.region r
                      where (r.query_id, r.instance_id) = (s.query_id, i.instance_id))
      and not exists (select from semap.pair_instance p
                      where (p.instance_id, p.query_id) = (i.instance_id, s.query_id)
                        and p.is_object = s.is_object)
    group by s.query_id, s.query_name, s.is_object order by 1 limit 5
""")
"""Who takes part in a query, by its pairs or by its regions, is compared with whom it asks for."""


def _shapes(connection: Connection) -> Iterator[Trouble]:
    bent = connection.scalars(
        text(
            "select distinct m.name || '/' || r.instance_name"
            " from semap.region r join semap.map m using (map_id)"
            " where not st_isvalid(r.footprint) or st_isempty(r.footprint) limit 100"
        )
    ).all()
    if bent:
        yield wrong(
            f"rooms whose outline is no valid area: {listed(bent)}",
            "Draw or import them again; semap map show MAP lists them.",
        )
    for query, names in connection.execute(SHAPELESS):
        yield warn(
            f"instances that the query {query} watches and that have no shape that it could compare:"
            f" {listed(names)}",
            "Give them a footprint or a mesh: PATCH /instances/{id}, or import them with one.",
        )


def _partitions(connection: Connection) -> Iterator[Trouble]:
    for table in ("state_chunk", "line_observation"):
        if connection.scalar(text(STRAYED.format(table))):
            yield warn(
                f"rows of {table} lie in its default partition, and are slower to find",
                "Call semap.ensure_partitions with the days of states before they are written.",
            )
    overdue = connection.scalars(OVERDUE).all()
    if overdue:
        yield warn(
            f"days that should have been dropped by now: {listed(overdue)}",
            "See that semap work runs, which does it once an hour; or do it now: semap db maintain.",
        )
    partitions = connection.scalars(
        text("select count(*) from pg_inherits where inhparent = 'semap.state_chunk'::regclass")
    ).one()
    if partitions > PARTITIONS:
        yield warn(
            f"state_chunk has {partitions} partitions, which makes each statement slower to plan",
            "Say how long states are kept: semap db retention --drop-states-after 30d.",
        )


def _webhooks(connection: Connection) -> Iterator[Trouble]:
    for webhook_id, reason in connection.execute(
        text(
            "select webhook_id, coalesce(nullif(state_reason, ''), last_error) from semap.webhook"
            " where state = 'disabled' order by webhook_id limit 5"
        )
    ):
        yield wrong(
            f"webhook {webhook_id} is disabled: {reason or 'its address refuses'}",
            f"Mend the receiver, then semap webhook resume {webhook_id}.",
        )
    for webhook_id, count in connection.execute(
        text(
            "select w.webhook_id, d.count from semap.webhook w cross join lateral (select count(*) from ("
            "  select from semap.webhook_dead_letter d where d.webhook_id = w.webhook_id limit 1000) d) d"
            " where d.count > 0 order by 1 limit 5"
        )
    ):
        yield warn(
            f"webhook {webhook_id} has {count} events that it did not take",
            f"See and send them again: semap webhook dead-letters {webhook_id}",
        )


def _jobs(connection: Connection) -> Iterator[Trouble]:
    lost = connection.scalars(
        text(
            "select j.job_id::text from semap.job j where j.finished_at is null"
            " and j.created_at < clock_timestamp() - interval '1 min' and not exists (select from pg_locks l"
            " where l.locktype = 'advisory' and l.classid = :lock and l.objid = j.job_id and l.granted"
            " and l.database = (select oid from pg_database where datname = current_database()))"
            " order by j.job_id limit 100"
        ),
        {"lock": JOB_LOCK},
    ).all()
    if lost:
        yield wrong(
            f"jobs without a process: {listed(lost)}",
            "Start semap serve, which marks them as failed; then send the files again.",
        )
        return
    waiting = connection.scalars(
        text(
            "select job_id::text from semap.job where state = 'waiting'"
            " and created_at < clock_timestamp() - cast(:stuck as interval) order by job_id limit 100"
        ),
        {"stuck": STUCK},
    ).all()
    if waiting:
        yield warn(
            f"jobs that wait for long: {listed(waiting)}",
            "See what runs: semap job list; cancel what hangs: semap job cancel ID.",
        )


def _tokens(connection: Connection) -> Iterator[Trouble]:
    soon = connection.scalars(
        text(
            "select name from semap.token where revoked_at is null and expires_at > clock_timestamp()"
            " and expires_at < clock_timestamp() + cast(:within as interval) order by expires_at limit 100"
        ),
        {"within": EXPIRES_WITHIN},
    ).all()
    if soon:
        yield warn(
            f"tokens that expire within a week: {listed(soon)}",
            "Make new ones: semap token add NAME --scope ...",
        )
    gone = connection.scalars(
        text(
            "select name from semap.token where revoked_at is null and expires_at <= clock_timestamp()"
            " and last_used_at > expires_at - interval '1 day' order by expires_at desc limit 100"
        )
    ).all()
    if gone:
        yield warn(
            f"tokens that were in use until they expired: {listed(gone)}",
            "Make new ones: semap token add NAME --scope ...; semap token revoke forgets the old.",
        )


CONTENT_CHECKS = (
    DatabaseCheck("shapes", "instances of queries have valid outlines", _shapes),
    DatabaseCheck("partitions", "states lie in the partition of their day", _partitions),
    DatabaseCheck("webhooks", "webhooks take what they are sent", _webhooks),
    DatabaseCheck("jobs", "no job is stuck", _jobs),
    DatabaseCheck("tokens", "no token is about to expire", _tokens),
)
