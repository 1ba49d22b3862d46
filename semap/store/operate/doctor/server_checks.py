"""The server, and what semap has set up in it."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime

from sqlalchemy import Connection, text

from semap.store.operate.doctor.finding import DatabaseCheck, Trouble, listed, warn, wrong
from semap.store.operate.preflight import ROLES, examine, right_to_act
from semap.store.operate.schema import database_version, head_version, is_current

CLOCKS_APART_S = 1.0
LONG_TRANSACTION = "5 min"

RIGHTS = (
    ("semap_ingest", "has_table_privilege(:role, 'semap.track_state', 'insert')"),
    ("semap_ingest", "has_table_privilege(:role, 'semap.source', 'insert')"),
    ("semap_api", "has_table_privilege(:role, 'semap.instance', 'insert, update, delete')"),
    ("semap_admin", "has_table_privilege(:role, 'semap.token', 'insert')"),
    ("semap_read", "has_table_privilege(:role, 'semap.relation', 'select')"),
    ("semap_worker", "has_table_privilege(:role, 'semap.progress', 'select')"),
)
"""One right of each role that it cannot do without."""
FOREIGN = text(
    "select name from unnest(cast(:wanted as text[])) with ordinality w (name, n)"
    " where not pg_has_role(current_user, name::name, :act) order by n"
)


def _server(connection: Connection) -> Iterator[Trouble]:
    for lack, remedy in examine(connection):
        yield wrong(f"semap needs {lack}", remedy)


def _schema(connection: Connection) -> Iterator[Trouble]:
    version = database_version(connection)
    if version is None:
        yield wrong("there is no schema of semap", "Run: semap db migrate")
    elif version > head_version():
        yield wrong(
            f"the schema is {version}, newer than this semap's {head_version()}",
            "Install the newer semap here.",
        )
    elif not is_current(connection):
        yield wrong(f"the schema is {version}, not as semap leaves {head_version()}", "Run: semap db migrate")


def _roles(connection: Connection) -> Iterator[Trouble]:
    wanted = [*ROLES, "semap_admin"]
    there = connection.scalars(
        text("select rolname from pg_roles where rolname = any (:wanted)"), {"wanted": wanted}
    ).all()
    if missing := [name for name in wanted if name not in there]:
        yield wrong(f"missing roles: {listed(missing)}", "Run: semap db migrate")
        return
    foreign = connection.scalars(FOREIGN, {"wanted": wanted, "act": right_to_act(connection)}).all()
    if foreign:
        user = connection.scalar(text("select session_user"))
        yield wrong(
            f"this user may not act as {listed(foreign)}",
            f"As a superuser: GRANT {', '.join(foreign)} TO {user};",
        )
    poor = sorted(
        {role for role, right in RIGHTS if not connection.scalar(text(f"select {right}"), {"role": role})}
    )
    if poor:
        yield wrong(f"{listed(poor)} lack rights on semap's tables", "Run: semap db migrate --again")


def _clocks(connection: Connection) -> Iterator[Trouble]:
    there = connection.scalars(text("select clock_timestamp()")).one()
    apart_s = abs((datetime.now(UTC) - there).total_seconds())
    if apart_s > CLOCKS_APART_S:
        yield warn(
            f"the clocks of this machine and of the database are {apart_s:.1f} s apart",
            "Let both follow NTP (timedatectl set-ntp true).",
        )
    ahead = connection.scalars(
        text(
            "select distinct m.name || '/' || s.name from semap.source s join semap.map m using (map_id)"
            " left join semap.track_place t using (source_id)"
            " where greatest(s.watermark, t.stamp) > clock_timestamp() + interval '1 min'"
            " order by 1 limit 100"
        )
    ).all()
    if ahead:
        yield warn(
            f"sources whose stamps lie in the future: {listed(ahead)}",
            "Set the clock of the sensor; for a file, see --epoch and --stamp-unit of semap ingest.",
        )


def _transactions(connection: Connection) -> Iterator[Trouble]:
    for pid, application, minutes in connection.execute(
        text(
            "select pid, application_name, extract(epoch from clock_timestamp() - xact_start)::bigint / 60"
            " from pg_stat_activity where datname = current_database() and pid <> pg_backend_pid()"
            " and backend_type = 'client backend'"
            " and xact_start < clock_timestamp() - cast(:long as interval) order by xact_start limit 5"
        ),
        {"long": LONG_TRANSACTION},
    ):
        yield warn(
            f"a transaction of {application or 'an unnamed program'} is open for {minutes} min",
            f"End that program, or: SELECT pg_terminate_backend({pid});",
        )


def _connections(connection: Connection) -> Iterator[Trouble]:
    used, most = connection.execute(
        text(
            "select count(*), current_setting('max_connections')::int from pg_stat_activity"
            " where backend_type = 'client backend'"
        )
    ).one()
    if used > 0.9 * most:
        yield warn(
            f"{used} of {most} connections of the server are in use",
            f"ALTER SYSTEM SET max_connections = {2 * most}; and restart the server.",
        )


SERVER_CHECKS = (
    DatabaseCheck("server", "PostgreSQL and PostGIS are as semap needs them", _server),
    DatabaseCheck("schema", "the schema is as this semap leaves it", _schema),
    DatabaseCheck("roles", "each role is there and has its rights", _roles),
    DatabaseCheck("clocks", "clocks agree, and no stamp lies in the future", _clocks),
    DatabaseCheck("transactions", "no transaction is open for long", _transactions),
    DatabaseCheck("connections", "the server has connections to spare", _connections),
)
