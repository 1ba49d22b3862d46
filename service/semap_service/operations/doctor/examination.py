"""All checks, one after another."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import Connection

from semap.cluster import Cluster, default_home
from semap.errors import SemapError
from semap.store.database.connection import driver_of, own_session, translated
from semap.store.operate.doctor.content_checks import CONTENT_CHECKS
from semap.store.operate.doctor.finding import DatabaseCheck, Finding, Level, MachineCheck, Trouble
from semap.store.operate.doctor.flow_checks import FLOW_CHECKS
from semap.store.operate.doctor.server_checks import SERVER_CHECKS
from semap_service.operations.doctor.machine_checks import MACHINE_CHECKS
from semap_service.operations.redaction import redacted

DATABASE_CHECKS = (*SERVER_CHECKS, *FLOW_CHECKS, *CONTENT_CHECKS)
STATEMENT_S = 20
NO_DSN = "Set SEMAP_DSN as 'host=... dbname=... user=...' or postgresql://USER@HOST/DATABASE."
SCHEMA = "schema"


def examine_all(dsn: str | None) -> Iterator[Finding]:
    """What every check finds, as it is found.

    dsn  None: semap's own server, which is not started for this
    """
    yield from examine_database(dsn)
    for check in MACHINE_CHECKS:
        yield from examine_machine(check)


def examine_database(dsn: str | None) -> Iterator[Finding]:
    """Whether the database answers, and then what is wrong in it."""
    if dsn is None:
        cluster = Cluster(default_home())
        if not cluster.is_running():
            remedy = "It starts with the next command that needs it: semap up."
            yield Finding(
                "database", Level.WRONG, f"semap's own server in {cluster.home} does not run", remedy
            )
            return
        dsn = cluster.dsn("semap")
    try:
        connection = own_session(dsn, application="semap doctor", statement_s=STATEMENT_S)
    except SemapError as error:
        yield Finding("database", Level.WRONG, redacted(str(error)), error.remedy or NO_DSN)
        return
    with connection:
        yield Finding("database", Level.OK, _place(connection))
        for check in DATABASE_CHECKS:
            found = list(examine(check, connection))
            yield from found
            if check.name == SCHEMA and any(each.level == Level.WRONG for each in found):
                return  # all others read that schema


def examine(check: DatabaseCheck, connection: Connection) -> Iterator[Finding]:
    """What one check finds."""
    try:
        with translated():
            yield from _told(check, list(check.look(connection)))
    except SemapError as error:
        yield _impossible(check, error, error.remedy)


def examine_machine(check: MachineCheck) -> Iterator[Finding]:
    """What one check finds."""
    try:
        yield from _told(check, list(check.look()))
    except OSError as error:
        yield _impossible(check, error, "Run it as the user that runs semap.")


def _told(check: DatabaseCheck | MachineCheck, troubles: list[Trouble]) -> Iterator[Finding]:
    for trouble in troubles:
        yield Finding(check.name, trouble.level, redacted(trouble.message), trouble.remedy)
    if not troubles:
        yield Finding(check.name, Level.OK, check.fine)


def _impossible(check: DatabaseCheck | MachineCheck, error: Exception, remedy: str) -> Finding:
    return Finding(check.name, Level.WARN, redacted(f"could not be looked at: {error}"), remedy)


def _place(connection: Connection) -> str:
    info = driver_of(connection).info
    version = f"PostgreSQL {info.server_version // 10_000}.{info.server_version % 10_000}"
    return f"{info.dbname} answers at {info.host or 'the local socket'}, {version}"
