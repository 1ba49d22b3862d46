"""The schema of the database: migrations own state, the files of sql/ own behaviour.

`migrate` brings a database up to date and may be run at any time, by several processes at once and beside a
service that runs. Migrations and behaviour are one transaction; what cannot be part of one, the replication
slot, comes last and is made where it is missing.
"""

from __future__ import annotations

import hashlib
import logging
import time
from dataclasses import dataclass

from sqlalchemy import Connection, text

from semap.errors import DatabaseError, InUse, ServerUnavailable
from semap.schema_files import schema_folder, sql_files
from semap.store.database.connection import connect, one_transaction, translated
from semap.store.operate.object_comment import comment_statements
from semap.store.operate.rule_slot import MIGRATION_LOCK, ensure_slot
from semap.store.relation.conditions import compile_again
from semap.store.relation.predicate_rows import keep_predicates
from semap.version import VERSION

log = logging.getLogger(__name__)

FORGET = "000_forget.sql"
LOCK_S = 2.0
"""So long a migration waits for a table that is in use: whoever wants it after that waits as long."""
PAUSE_S = 1.0
ATTEMPTS = 10
GIVE_WAY = text("""
    select set_config('lock_timeout', :lock, true),
           (select set_config('deadlock_timeout', '20ms', true)
            from pg_roles where rolname = current_user and rolsuper)
""")
"""Of two that wait for one another the one that looks first is ended: the migration, which tries again."""


@dataclass(frozen=True)
class Migrated:
    """What `migrate` found and did."""

    version_before: str | None
    version: str
    behaviour_changed: bool


def migrate(dsn: str, *, slot: bool = True) -> Migrated:
    """Create or update everything that semap keeps in the database.

    slot    also make the rule worker's slot; not in a database that is only copied from
    raises  DatabaseError where the database is newer than this semap, ServerUnavailable where others use its
            tables for so long that nothing was changed
    """
    migrated = _bring_up_to_date(dsn)
    if slot:
        with connect(dsn, application="semap migrate") as plain:
            ensure_slot(plain)
    return migrated


def _bring_up_to_date(dsn: str) -> Migrated:
    """All or nothing, again and again where somebody holds what it needs."""
    for attempt in range(1, ATTEMPTS + 1):
        try:
            with one_transaction(dsn, application="semap migrate") as connection:
                connection.execute(text("select pg_advisory_xact_lock(:key)"), {"key": MIGRATION_LOCK})
                connection.execute(GIVE_WAY, {"lock": f"{LOCK_S * 1000:.0f}ms"})
                connection.execute(text("create schema if not exists semap"))
                before = _upgrade(connection)
                changed = _apply_behaviour(connection, again=before != head_version())
            return Migrated(before, head_version(), changed)
        except InUse:
            log.info("Tables are in use; tried %d of %d times.", attempt, ATTEMPTS)
            time.sleep(PAUSE_S)
    raise ServerUnavailable(
        f"The schema is as it was: its tables were in use each time in {ATTEMPTS} attempts.",
        "End what works on the database for long, an import or a query (`select * from pg_stat_activity`"
        " lists them), then run `semap db migrate` again.",
    )


def head_version() -> str:
    """The newest version that this semap knows."""
    return _known_versions()[-1]


def is_current(connection: Connection) -> bool:
    """Whether the database is just as `migrate` of this semap leaves it."""
    if connection.scalar(text("select to_regclass('semap.behaviour')")) is None:
        return False
    checksums = connection.scalars(text("select checksum from semap.behaviour")).all()
    if checksums != [_checksum()] or database_version(connection) != head_version():
        return False
    # its slot comes last: a migration that was killed before it is not done
    return bool(connection.scalar(text("select exists (select from semap.progress where worker = 'rules')")))


def require_current(connection: Connection) -> None:
    """raises DatabaseError where `semap db migrate` has to run first."""
    with translated():
        if not is_current(connection):
            raise DatabaseError(
                "The database has no schema of semap, or that of another version.", "Run: semap db migrate"
            )


def database_version(connection: Connection) -> str | None:
    """The version of the database's schema; None where there is none."""
    if connection.scalar(text("select to_regclass('semap.schema_version')")) is None:
        return None
    version: str | None = connection.scalar(text("select version_num from semap.schema_version"))
    return version


def _known_versions() -> list[str]:
    """Every version, oldest first: what a file of migrations/versions/ begins with."""
    return sorted(file.name[:4] for file in schema_folder("migrations").glob("versions/[0-9]*.py"))


def _upgrade(connection: Connection) -> str | None:
    from alembic import command  # noqa: PLC0415  slow to import, and rarely needed
    from alembic.config import Config  # noqa: PLC0415

    before = database_version(connection)
    if before is not None and before not in _known_versions():
        raise DatabaseError(
            f"The database has schema version {before}, which semap {VERSION} does not know.",
            "Install the version of semap that migrated it, or a newer one.",
        )
    if before is not None and before != head_version():
        # else views and functions hold the tables that a migration changes
        connection.connection.cursor().execute((schema_folder("sql") / FORGET).read_text())
    config = Config()
    config.set_main_option("script_location", str(schema_folder("migrations")))
    config.attributes["connection"] = connection
    command.upgrade(config, "head")
    return before


def run_files(connection: Connection, folder: str) -> None:
    """Run the SQL of a folder, in the order of its files' names, and make comments of the sentences in it."""
    cursor = connection.connection.cursor()
    for file in sql_files(folder):
        sql = file.read_text()
        cursor.execute(f"{sql}\n{comment_statements(sql)}")


def _checksum() -> str:
    parts = [file.name.encode() + b"\0" + file.read_bytes() for file in sql_files("sql")]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def _apply_behaviour(connection: Connection, *, again: bool) -> bool:
    """Apply sql/ where it differs, and after a migration, whose tables want their grants."""
    if not again and connection.scalar(text("select checksum from semap.behaviour")) == _checksum():
        return False
    keep_predicates(connection)
    run_files(connection, "sql")
    compile_again(connection)
    connection.execute(text("delete from semap.behaviour"))
    connection.execute(
        text("insert into semap.behaviour (checksum) values (:digest)"), {"digest": _checksum()}
    )
    return True
