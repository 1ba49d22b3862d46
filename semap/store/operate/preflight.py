"""Whether a server that semap did not set up itself has what semap needs, all said at once."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from sqlalchemy import Connection, text

from semap.errors import ServerUnfit

OLDEST_MAJOR = 15
FIRST_WITH_GUARDED_ROLES = 16
"""From here on CREATEROLE alone may no longer grant a role that somebody else made, and a member may act as a
role only if that was granted, too: who creates a role may grant it, and no more."""

ROLES = (
    "semap_ingest",
    "semap_worker",
    "semap_api",
    "semap_read",
    "semap_admin",
    "semap_ingest_map",
    "semap_api_map",
    "semap_read_map",
    "semap_compile",
)

Finding = tuple[str, str]
"""What is missing, and its remedy."""


@dataclass(frozen=True)
class Server:
    """What decides whether a database fits; names are quoted as SQL needs them."""

    version: int
    wal_level: str
    slots: int
    slots_taken: int
    has_own_slot: bool
    wal_senders: int
    is_standby: bool
    database: str
    encoding: str
    may_create: bool
    role: str
    is_superuser: bool
    may_replicate: bool
    may_create_roles: bool
    missing_roles: list[str]
    foreign_roles: list[str]
    has_icu: bool
    postgis_schema: str | None
    postgis_available: bool
    postgis_needs_superuser: bool
    schema_owner: str | None

    @property
    def major(self) -> int:
        return self.version // 10_000


LOOK = text("""
select current_setting('server_version_num')::int as version,
       current_setting('wal_level') as wal_level,
       current_setting('max_replication_slots')::int as slots,
       (select count(*) from pg_replication_slots) as slots_taken,
       exists (select from pg_replication_slots
               where database = current_database() and slot_name like 'semap%') as has_own_slot,
       current_setting('max_wal_senders')::int as wal_senders,
       pg_is_in_recovery() as is_standby,
       quote_ident(current_database()) as database,
       current_setting('server_encoding') as encoding,
       has_database_privilege(current_database(), 'CREATE') as may_create,
       quote_ident(current_user) as role,
       own.rolsuper as is_superuser,
       own.rolreplication as may_replicate,
       own.rolcreaterole as may_create_roles,
       array(select name from unnest(cast(:roles as text[])) with ordinality as asked (name, n)
             where not exists (select from pg_roles where rolname = name) order by n) as missing_roles,
       array(select name from unnest(cast(:roles as text[])) with ordinality as asked (name, n)
             join pg_roles on rolname = name
             where not (pg_has_role(oid, cast(:act as text)) or pg_has_role(oid, 'MEMBER WITH ADMIN OPTION'))
             order by n) as foreign_roles,
       exists (select from pg_collation where collname = 'und-x-icu') as has_icu,
       (select quote_ident(nspname) from pg_extension join pg_namespace n on n.oid = extnamespace
        where extname = 'postgis') as postgis_schema,
       exists (select from pg_available_extensions where name = 'postgis') as postgis_available,
       coalesce((select v.superuser and not v.trusted
                 from pg_available_extensions e
                 join pg_available_extension_versions v
                   on v.name = e.name and v.version = e.default_version
                 where e.name = 'postgis'), false) as postgis_needs_superuser,
       (select quote_ident(pg_get_userbyid(nspowner)) from pg_namespace
        where nspname = 'semap' and not pg_has_role(nspowner, 'USAGE')) as schema_owner
from pg_roles own
where own.rolname = current_user
""")


def major_version(connection: Connection) -> int:
    """Of the server's PostgreSQL."""
    return int((connection.dialect.server_version_info or (0,))[0])


def right_to_act(connection: Connection) -> str:
    """What `pg_has_role` of this server calls the right to SET ROLE."""
    return "SET" if major_version(connection) >= FIRST_WITH_GUARDED_ROLES else "MEMBER"


def examine(connection: Connection) -> list[Finding]:
    """Every obstacle in the connection's database for its role; nothing is changed there.

    A server that is too old is not asked for the rest, which it could not even answer.
    """
    major = major_version(connection)
    if major < OLDEST_MAJOR:
        return [_too_old(major)]
    asked = {"roles": list(ROLES), "act": right_to_act(connection)}
    server = Server(**connection.execute(LOOK, asked).mappings().one())
    return [finding for check in CHECKS for finding in check(server)]


def require_fit(connection: Connection) -> None:
    """raises ServerUnfit with all that `examine` finds."""
    findings = examine(connection)
    if findings:
        raise ServerUnfit(findings)


def _too_old(major: int) -> Finding:
    return (
        f"PostgreSQL {OLDEST_MAJOR} or newer (this is {major})",
        f"Upgrade the server to PostgreSQL {OLDEST_MAJOR} or newer.",
    )


def _writable(server: Server) -> Iterator[Finding]:
    if server.is_standby:
        yield "a server that takes writes (this is a standby)", "Connect to the primary server."


def _encoding(server: Server) -> Iterator[Finding]:
    if server.encoding != "UTF8":
        yield (
            f"a database in UTF8 (this one is in {server.encoding})",
            "CREATE DATABASE semap TEMPLATE template0 ENCODING 'UTF8'; and use that one.",
        )


def _icu(server: Server) -> Iterator[Finding]:
    # in another encoding than UTF8 there are none, which is said already
    if not server.has_icu and server.encoding == "UTF8":
        yield (
            "the collations of ICU (there is no und-x-icu)",
            "Use a PostgreSQL that is built with ICU, as those of Debian and postgresql.org are.",
        )


def _wal_level(server: Server) -> Iterator[Finding]:
    if server.wal_level != "logical":
        yield (
            f"wal_level = logical (it is {server.wal_level})",
            "ALTER SYSTEM SET wal_level = logical; and restart the server.",
        )


def _slot(server: Server) -> Iterator[Finding]:
    if server.slots_taken >= server.slots and not server.has_own_slot:
        yield (
            f"a free replication slot (all {server.slots} are taken)",
            f"ALTER SYSTEM SET max_replication_slots = {server.slots + 8}; and restart the server, "
            "or drop an unread slot.",
        )
    if server.wal_senders == 0:
        yield (
            "max_wal_senders above 0",
            "ALTER SYSTEM SET max_wal_senders = 10; and restart the server.",
        )


def _replication(server: Server) -> Iterator[Finding]:
    if not (server.may_replicate or server.is_superuser):
        yield f"the right of {server.role} to replicate", f"ALTER ROLE {server.role} REPLICATION;"


def _postgis(server: Server) -> Iterator[Finding]:
    if server.postgis_schema == "public":
        return
    if server.postgis_schema is not None:
        yield (
            f"PostGIS in the schema public (it is in {server.postgis_schema})",
            "PostGIS cannot be moved. In another database: CREATE EXTENSION postgis SCHEMA public;",
        )
    elif not server.postgis_available:
        yield (
            "PostGIS",
            "Install PostGIS on the server's machine "
            f"(Debian: apt-get install postgresql-{server.major}-postgis-3).",
        )
    elif server.postgis_needs_superuser and not server.is_superuser:
        yield (
            f"PostGIS in the database {server.database}, where {server.role} may not install it",
            f"As a superuser, in the database {server.database}: CREATE EXTENSION postgis SCHEMA public;",
        )


def _create(server: Server) -> Iterator[Finding]:
    if not server.may_create:
        yield (
            f"the right of {server.role} to create a schema in {server.database}",
            f"GRANT CREATE ON DATABASE {server.database} TO {server.role};",
        )
    if server.schema_owner is not None:
        yield (
            f"ownership of the schema semap (it belongs to {server.schema_owner})",
            f"Connect as {server.schema_owner}, or GRANT {server.schema_owner} TO {server.role};",
        )


def _roles(server: Server) -> Iterator[Finding]:
    if server.is_superuser:
        return
    if server.missing_roles and not server.may_create_roles:
        names = ", ".join(server.missing_roles)
        creations = " ".join(f"CREATE ROLE {name};" for name in server.missing_roles)
        yield (
            f"the roles {names}, which {server.role} may not create",
            f"ALTER ROLE {server.role} CREATEROLE; or {creations} GRANT {names} TO {server.role};",
        )
    may_grant_any = server.may_create_roles and server.major < FIRST_WITH_GUARDED_ROLES
    if server.foreign_roles and not may_grant_any:
        names = ", ".join(server.foreign_roles)
        yield f"membership of {server.role} in {names}", f"GRANT {names} TO {server.role};"


CHECKS: tuple[Callable[[Server], Iterator[Finding]], ...] = (
    _writable,
    _encoding,
    _icu,
    _wal_level,
    _slot,
    _replication,
    _postgis,
    _create,
    _roles,
)
