"""The server's programs: initdb, pg_ctl and postgres of one PostgreSQL that has PostGIS."""

import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from semap.errors import ServerMissing

OLDEST_MAJOR = 15

USUAL_FOLDERS = (
    "usr/lib/postgresql/*/bin",  # Debian, Ubuntu
    "usr/pgsql-*/bin",  # PGDG on Red Hat and SUSE
    "usr/lib/postgresql*/bin",  # SUSE, Alpine
    "usr/libexec/postgresql*",  # Alpine
    "usr/local/pgsql/bin",  # built from source
    "opt/homebrew/opt/postgresql@*/bin",
    "usr/local/opt/postgresql@*/bin",
    "home/linuxbrew/.linuxbrew/opt/postgresql@*/bin",
    "Applications/Postgres.app/Contents/Versions/*/bin",
)

REMEDY = (
    f"Install PostgreSQL {OLDEST_MAJOR} or newer with PostGIS (Debian: apt-get install postgresql-postgis), "
    "name its folder of programs in SEMAP_PG_BIN, or name a server of your own in SEMAP_DSN."
)


@dataclass(frozen=True)
class ServerPrograms:
    """One installation that fits: `folder` holds postgres, initdb and pg_ctl."""

    folder: Path
    major: int

    def path(self, program: str) -> str:
        return str(self.folder / program)


def find_programs(major: int | None = None, folders: Sequence[Path] | None = None) -> ServerPrograms:
    """The highest version that has PostGIS, or just `major`, the only one that can read existing data.

    folders  where to look instead of SEMAP_PG_BIN, else the usual places and PATH
    raises   ServerMissing, which says what was found and why none of it fits
    """
    fitting = []
    rejected = []
    for folder in _candidate_folders() if folders is None else folders:
        found = _major_version(folder)
        if found is None:
            continue
        reason = _unfit(folder, found, major)
        if reason:
            rejected.append(f"PostgreSQL {found} in {folder} {reason}")
        else:
            fitting.append(ServerPrograms(folder, found))
    if fitting:
        return max(fitting, key=lambda programs: programs.major)
    wanted = f"PostgreSQL {major}" if major else f"PostgreSQL {OLDEST_MAJOR} or newer"
    raise ServerMissing(f"{wanted} with PostGIS was not found" + _reasons(rejected), REMEDY)


def _candidate_folders() -> list[Path]:
    """Without duplicates: PATH often leads to a folder that is also a usual one."""
    chosen = os.environ.get("SEMAP_PG_BIN")
    if chosen:
        return [Path(chosen).expanduser().absolute()]
    root = Path("/")
    usual = [folder for pattern in USUAL_FOLDERS for folder in sorted(root.glob(pattern))]
    on_path = [Path(entry) for entry in os.get_exec_path() if entry]
    return list(dict.fromkeys(_real_folder(folder) for folder in [*usual, *on_path]))


def _real_folder(folder: Path) -> Path:
    """/usr/bin/postgres may be a link into the folder that has the other programs too."""
    postgres = shutil.which("postgres", path=str(folder))
    return Path(postgres).resolve().parent if postgres else folder


def _major_version(folder: Path) -> int | None:
    """None where there is no server, as with PostgreSQL's client alone."""
    if not all(os.access(folder / program, os.X_OK) for program in ("postgres", "initdb", "pg_ctl")):
        return None
    match = re.search(r"\(PostgreSQL\) (\d+)", _output(folder / "postgres", "--version"))
    return int(match.group(1)) if match else None


def _unfit(folder: Path, found: int, major: int | None) -> str | None:
    if major is not None and found != major:
        return f"cannot read the data of PostgreSQL {major}"
    if found < OLDEST_MAJOR:
        return f"is older than {OLDEST_MAJOR}"
    if not any(
        (shared / "extension" / "postgis.control").is_file() for shared in _shared_folders(folder, found)
    ):
        return "has no PostGIS"
    return None


def _shared_folders(folder: Path, major: int) -> Iterator[Path]:
    """Where this installation keeps its extensions; pg_config knows, but may be a package of its own."""
    said = _output(folder / "pg_config", "--sharedir").strip()
    if said:
        yield Path(said)
        return
    for ancestor in folder.parents[:-1]:
        share = ancestor / "share"
        yield from (share, share / "pgsql", share / "postgresql", share / "postgresql" / str(major))
        yield from (share / f"postgresql{major}", share / f"postgresql@{major}")


def _output(*command: Path | str) -> str:
    """Empty if the program is missing, broken or hangs: such a folder is just not a candidate."""
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=20, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""


def _reasons(rejected: Sequence[str]) -> str:
    return ": " + "; ".join(rejected) + "." if rejected else "."
