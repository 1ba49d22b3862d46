"""The schema of the database: migrations own state, the files of sql/ own behaviour.

`migrate` brings a database up to date and may be run at any time, by several processes at once.
Migrations and behaviour are one transaction; what cannot be part of one, the replication slot, comes
last and is made where it is missing.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import psycopg
from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, text

import semap
from semap.errors import DatabaseError
from semap.store.database import connect, open_engine, translated

MIGRATION_LOCK = 7366


@dataclass(frozen=True)
class Migrated:
    """What `migrate` found and did."""

    version_before: str | None
    version: str
    behaviour_changed: bool


def schema_folder(name: str) -> Path:
    """Where `sql` or `migrations` lies: inside the installed package, or at the top of a checkout."""
    package = Path(semap.__file__).parent
    for folder in (package / "schema" / name, package.parent / name):
        if folder.is_dir():
            return folder
    raise DatabaseError(f"The folder {name}/ is missing.", "Install semap again.")


def migrate(dsn: str) -> Migrated:
    """Create or update everything that semap keeps in the database.

    raises DatabaseError where the database is newer than this semap
    """
    engine = open_engine(dsn, application="semap migrate")
    try:
        with translated(), engine.begin() as connection:
            connection.execute(text("select pg_advisory_xact_lock(:key)"), {"key": MIGRATION_LOCK})
            connection.execute(text("create schema if not exists semap"))
            before = _upgrade(connection)
            changed = _apply_behaviour(connection)
    finally:
        engine.dispose()
    with connect(dsn, application="semap migrate") as plain:
        ensure_slot(plain)
    return Migrated(before, head_version(), changed)


def head_version() -> str:
    """The newest version that this semap knows."""
    head = ScriptDirectory(str(schema_folder("migrations"))).get_current_head()
    if head is None:
        raise DatabaseError("The folder migrations/ is empty.", "Install semap again.")
    return head


def database_version(connection: psycopg.Connection) -> str | None:
    """The version of the database's schema; None where there is none."""
    if connection.execute("select to_regclass('semap.schema_version')").fetchone() == (None,):
        return None
    row = connection.execute("select version_num from semap.schema_version").fetchone()
    return None if row is None else str(row[0])


def _upgrade(connection: Connection) -> str | None:
    scripts = ScriptDirectory(str(schema_folder("migrations")))
    known = {script.revision for script in scripts.walk_revisions()}
    before = None
    if connection.scalar(text("select to_regclass('semap.schema_version')")) is not None:
        before = connection.scalar(text("select version_num from semap.schema_version"))
    if before is not None and before not in known:
        raise DatabaseError(
            f"The database has schema version {before}, which semap {semap.__version__} does not know.",
            "Install the version of semap that migrated it, or a newer one.",
        )
    config = Config()
    config.set_main_option("script_location", str(schema_folder("migrations")))
    config.attributes["connection"] = connection
    command.upgrade(config, "head")
    return before


def _apply_behaviour(connection: Connection) -> bool:
    files = sorted(schema_folder("sql").glob("*.sql"))
    digest = hashlib.sha256(b"\0".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()
    if connection.scalar(text("select checksum from semap.behaviour")) == digest:
        return False
    cursor = connection.connection.cursor()
    for file in files:
        cursor.execute(file.read_text())
    connection.execute(text("delete from semap.behaviour"))
    connection.execute(text("insert into semap.behaviour (checksum) values (:digest)"), {"digest": digest})
    return True


def ensure_slot(connection: psycopg.Connection) -> None:
    """Make the rule worker's replication slot and its first progress where they are missing.

    A slot is an object of the whole server and is not part of a transaction or of a copied database.
    The rules known so far are noted after the slot exists: later ones come through it.
    """
    with translated():
        connection.execute("select pg_advisory_lock(%s)", [MIGRATION_LOCK])
        try:
            connection.execute("select semap.create_rule_slot()")
            connection.execute("select semap.begin_progress()")
        finally:
            connection.execute("select pg_advisory_unlock(%s)", [MIGRATION_LOCK])
