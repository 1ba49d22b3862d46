"""One PostgreSQL cluster in one folder, reachable over its unix socket alone."""

import logging
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import psycopg
from psycopg.conninfo import make_conninfo
from psycopg.sql import SQL, Composed, Identifier

from semap.cluster.folders import claim_folder, explained_access, socket_folder
from semap.cluster.os_user import OsUser, own, require_reach, run_as, server_user
from semap.cluster.postmaster import await_settled, live_postmaster, remove_remains
from semap.cluster.programs import ServerPrograms, find_programs
from semap.cluster.settings import settings_file
from semap.errors import DatabaseError, ServerUnavailable

log = logging.getLogger(__name__)

SUPERUSER = "postgres"
START_LIMIT_S = 300
"""Long, because a server that crashed replays its log first."""
STOP_LIMIT_S = 30
LOG_LIMIT_BYTES = 10_000_000

# The socket's folder is private to the server's user, so whoever gets to ask may enter.
HBA = """\
local all all trust
local replication all trust
"""


class Cluster:
    """The server of the data in `home`; nothing outside of `home` and its socket folder is ever touched.

    Takes no locks: callers that may not be alone go through `semap.cluster.lease`.
    """

    def __init__(self, home: Path) -> None:
        self.home = home.absolute()
        self.data = self.home / "data"
        self.log_file = self.home / "server.log"
        self.socket_folder = socket_folder(self.home)

    def dsn(self, dbname: str) -> str:
        """A conninfo string of libpq, for the superuser."""
        # An empty hostaddr keeps PGHOSTADDR of the environment from winning over the host.
        return make_conninfo(
            host=str(self.socket_folder), hostaddr="", port=5432, user=SUPERUSER, dbname=dbname
        )

    def is_running(self) -> bool:
        with explained_access(self.home):
            return live_postmaster(self.data) is not None

    def prepare(self) -> OsUser | None:
        """Make the folders, and say whom the server runs as (None: this process's own user)."""
        with explained_access(self.home):
            user = server_user(self.data)
            if not self.home.is_dir():
                self.home.mkdir(parents=True, exist_ok=True)
                own(self.home, user)
            require_reach(user, self.home)
            claim_folder(self.socket_folder, user)
        return user

    def initialise(self, *, sync: bool = True) -> None:
        """Make the data folder unless it is there; it appears whole or, after a crash on the way, not at all.

        sync=False leaves the new files to the operating system to write in its own time.
        """
        user = self.prepare()
        if self.data.exists():
            return
        programs = find_programs()
        log.info("initialising a cluster of PostgreSQL %d in %s", programs.major, self.home)
        for remains in self.home.glob("data.partial-*"):
            shutil.rmtree(remains)
        partial = Path(tempfile.mkdtemp(prefix="data.partial-", dir=self.home))
        own(partial, user)
        self._initdb(programs, partial, user, sync=sync)
        (partial / "pg_hba.conf").write_text(HBA)
        with (partial / "postgresql.conf").open("a") as configuration:
            configuration.write("\ninclude 'semap.conf'\n")
        partial.rename(self.data)
        if sync:
            _sync_folder(self.home)

    def start(self, settings: Mapping[str, str] | None = None) -> None:
        """Start the server unless it runs, initialised first if need be; it outlives this process.

        settings  win over semap's own; they have no effect on a server that already runs
        raises    ServerMissing; ServerUnavailable with the end of the server's log
        """
        extra = dict(settings or {})
        user = self.prepare()
        if await_settled(self.data, START_LIMIT_S):
            return
        self.initialise(sync=extra.get("fsync") != "off")
        programs = self._programs()
        remove_remains(self.data, self.socket_folder)
        self._write_settings(extra, user)
        self._open_log(user)
        log_start = self.log_file.stat().st_size
        options = ["-D", str(self.data), "-l", str(self.log_file), "-w", "-t", str(START_LIMIT_S), "-s"]
        outcome = run_as(user, [programs.path("pg_ctl"), "start", *options])
        if outcome.returncode != 0:
            said = self._log_since(log_start) or outcome.stdout.strip()
            raise ServerUnavailable(
                f"The server in {self.home} did not start:\n{said}", f"The whole log is {self.log_file}."
            )
        log.info("started the server in %s", self.home)

    def stop(self) -> None:
        """End all sessions and stop; no committed data are lost either way it ends."""
        if not self.is_running():
            return
        user = self.prepare()
        pg_ctl = [
            self._programs().path("pg_ctl"),
            "stop",
            "-D",
            str(self.data),
            "-w",
            "-s",
            "-t",
            str(STOP_LIMIT_S),
        ]
        # A fast stop waits for consumers of replication to confirm, and a stuck one never does.
        for mode in ("fast", "immediate"):
            outcome = run_as(user, [*pg_ctl, "-m", mode])
            if outcome.returncode == 0 or not self.is_running():
                log.info("stopped the server in %s (%s)", self.home, mode)
                return
        raise ServerUnavailable(f"The server in {self.home} did not stop: {outcome.stdout.strip()}")

    def create_database(self, name: str, template: str | None = None) -> None:
        """raises DatabaseError if the name is taken or the template is in use."""
        # Copied as files, since a copy through the log would write all of the template there first.
        copied = SQL(" template {} strategy file_copy")
        source = copied.format(Identifier(template)) if template else SQL("")
        self._execute(SQL("create database {}{}").format(Identifier(name), source))

    def drop_database(self, name: str) -> None:
        """Drop it if it is there, with whatever sessions and replication slots it has."""
        with self._session() as session:
            # The force of `drop database` does not extend to a slot that is being read.
            session.execute(
                "select pg_terminate_backend(active_pid, 5000) from pg_replication_slots"
                " where database = %s and active",
                [name],
            )
        self._execute(SQL("drop database if exists {} with (force)").format(Identifier(name)))

    def has_database(self, name: str) -> bool:
        with self._session() as session:
            found = session.execute("select 1 from pg_database where datname = %s", [name]).fetchone()
        return found is not None

    def _programs(self) -> ServerPrograms:
        with explained_access(self.home):
            return find_programs(int((self.data / "PG_VERSION").read_text()))

    def _initdb(self, programs: ServerPrograms, folder: Path, user: OsUser | None, *, sync: bool) -> None:
        options = ["-D", str(folder), "-U", SUPERUSER, "-A", "trust", "-E", "UTF8", "--data-checksums"]
        if not sync:
            options.append("--no-sync")
        # C.UTF-8 knows upper and lower case beyond ASCII, but is not to be had everywhere.
        for locale in ("C.UTF-8", "C"):
            outcome = run_as(user, [programs.path("initdb"), *options, f"--locale={locale}"])
            if outcome.returncode == 0:
                return
        shutil.rmtree(folder)
        raise DatabaseError(
            f"The cluster in {self.home} could not be initialised:\n{outcome.stdout.strip()}",
            "See that the disk has room, or set SEMAP_HOME to another folder.",
        )

    def _write_settings(self, extra: Mapping[str, str], user: OsUser | None) -> None:
        replacement = self.data / "semap.conf.new"
        replacement.write_text(settings_file(self.socket_folder, extra))
        own(replacement, user)
        replacement.replace(self.data / "semap.conf")

    def _open_log(self, user: OsUser | None) -> None:
        """Made here since the server's user may have no right to make it; a long one is put aside."""
        if self.log_file.exists() and self.log_file.stat().st_size > LOG_LIMIT_BYTES:
            self.log_file.replace(self.log_file.with_suffix(".log.old"))
        self.log_file.touch(mode=0o600)
        own(self.log_file, user)

    def _log_since(self, position: int, lines: int = 20) -> str:
        with self.log_file.open("rb") as written:
            written.seek(position)
            return "\n".join(written.read().decode(errors="replace").splitlines()[-lines:])

    @contextmanager
    def _session(self) -> Iterator[psycopg.Connection]:
        try:
            with psycopg.connect(self.dsn("postgres"), autocommit=True) as session:
                yield session
        except psycopg.OperationalError as refusal:
            raise ServerUnavailable(
                f"The server in {self.home} does not answer: {refusal}", f"Its log is {self.log_file}."
            ) from refusal

    def _execute(self, statement: Composed) -> None:
        with self._session() as session:
            try:
                session.execute(statement)
            except (psycopg.ProgrammingError, psycopg.errors.ObjectInUse) as refusal:
                raise DatabaseError(str(refusal)) from refusal


def _sync_folder(folder: Path) -> None:
    """So that a rename in it outlives a crash of the machine."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
