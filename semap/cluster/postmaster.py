"""Whether a data folder's server is alive, told without asking it.

postmaster.pid alone does not tell: after a crash of the machine it stays behind, and its process id may
by then be another program's. A server is ours only if it is a postgres that works in our data folder.
"""

import contextlib
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from semap.errors import ServerUnavailable

PROC = Path("/proc")
SOCKET_NAME = ".s.PGSQL.5432"
PROGRAM_NAMES = frozenset({"postgres", "postmaster"})
STATUS_LINE = 7


def live_postmaster(data: Path) -> int | None:
    """The process id of the server that runs on this data folder."""
    process = _recorded_process(data)
    return process if process is not None and _serves(process, data) else None


def await_settled(data: Path, patience_s: float) -> bool:
    """Wait for a server that somebody else is starting or stopping; True if it is ready, False if none runs.

    raises  ServerUnavailable after `patience_s`
    """
    deadline = time.monotonic() + patience_s
    while live_postmaster(data) is not None:
        if _pid_file_line(data, STATUS_LINE) == "ready":
            return True
        if time.monotonic() > deadline:
            raise ServerUnavailable(f"The server of {data} neither got ready nor ended in {patience_s:g} s.")
        time.sleep(0.02)
    return False


def remove_remains(data: Path, socket_folder: Path, patience_s: float = 30.0) -> None:
    """Clear what a crash left, where the server itself would refuse to start because of it.

    Only to be called when the server is not alive. Backends that outlived their postmaster end at once, as
    the postmaster would have them do, because a new server must not run beside them.
    raises  ServerUnavailable if they do not end within `patience_s`, or if a server answers all the same
    """
    if not _sees_processes():
        return  # Nothing to tell an orphan from a stranger by: what is left is for the server to judge.
    if _answers(socket_folder / SOCKET_NAME):
        raise ServerUnavailable(
            f"A server already works on {data}, but not among the processes seen from here.",
            "Stop semap in the container that shares this folder, or set SEMAP_HOME to another one.",
        )
    deadline = time.monotonic() + patience_s
    while orphans := list(_backends(data)):
        if time.monotonic() > deadline:
            raise ServerUnavailable(
                f"Processes of a crashed server still use {data}: {orphans}.", "End these processes."
            )
        for process in orphans:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGQUIT)
        time.sleep(0.02)
    (data / "postmaster.pid").unlink(missing_ok=True)
    (socket_folder / f"{SOCKET_NAME}.lock").unlink(missing_ok=True)
    (socket_folder / SOCKET_NAME).unlink(missing_ok=True)


def _recorded_process(data: Path) -> int | None:
    first = _pid_file_line(data, 0)
    # Negative for a single-user backend, empty if the machine crashed while it was written.
    return abs(int(first)) if first.lstrip("-").isdigit() else None


def _pid_file_line(data: Path, number: int) -> str:
    try:
        lines = (data / "postmaster.pid").read_text(errors="replace").splitlines()
    except FileNotFoundError:
        return ""
    return lines[number].strip() if number < len(lines) else ""


def _serves(process: int, data: Path) -> bool:
    if not _sees_processes():
        return _serves_by_name(process)
    return _is_postgres(process) and _works_in(process, data)


def _sees_processes() -> bool:
    return (PROC / "self").exists()


def _answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        return probe.connect_ex(str(path)) == 0


def _backends(data: Path) -> Iterator[int]:
    for entry in PROC.glob("[0-9]*"):
        process = int(entry.name)
        if _works_in(process, data) and _is_postgres(process):
            yield process


def _works_in(process: int, folder: Path) -> bool:
    try:
        return (PROC / str(process) / "cwd").samefile(folder)
    except OSError:
        return False


def _is_postgres(process: int) -> bool:
    try:
        program = (PROC / str(process) / "exe").readlink().name
        # An upgrade of the package takes the running program's file away.
        return program.removesuffix(" (deleted)") in PROGRAM_NAMES
    except OSError:
        return False


def _serves_by_name(process: int) -> bool:
    """Without /proc, as on macOS: a program called postgres has that id."""
    command = ["ps", "-o", "comm=", "-p", str(process)]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    return Path(said.strip()).name in PROGRAM_NAMES
