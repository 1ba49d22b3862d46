"""The operating system's user that the server runs as: PostgreSQL refuses to run as root."""

from __future__ import annotations

import os
import pwd
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from semap.errors import ServerUnavailable


@dataclass(frozen=True)
class OsUser:
    name: str
    uid: int
    gid: int


def server_user(data: Path) -> OsUser | None:
    """None: this process's own user, which is not root.

    For root the owner of an existing data folder decides, else SEMAP_OS_USER, else postgres.
    raises  ServerUnavailable if that user does not exist, is root, or if the data belong to somebody else
    """
    owner = data.stat().st_uid if data.exists() else None
    if os.geteuid() != 0:
        if owner not in {None, os.geteuid()}:
            raise ServerUnavailable(
                f"{data} belongs to the user {_name(owner)}.",
                f"Run semap as {_name(owner)} or as root, or set SEMAP_HOME to a folder of your own.",
            )
        return None
    if owner:
        return _from_entry(_entry(_name(owner)))
    return _from_entry(_entry(os.environ.get("SEMAP_OS_USER") or "postgres"))


def own(path: Path, user: OsUser | None) -> None:
    """Hand a file or folder that semap made to the server's user."""
    if user is not None:
        os.chown(path, user.uid, user.gid, follow_symlinks=False)


def run_as(user: OsUser | None, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run a program of the server to its end; its output comes back as one text in `stdout`.

    The program gets a session of its own, so that the terminal's Ctrl-C reaches neither it nor the server
    that it starts; the root folder as its own, since the user may have no right to the caller's; and none
    of libpq's environment variables, which could point it at another server.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PG")}
    return subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
        cwd="/",
        env=environment | {"LC_ALL": "C"},
        start_new_session=True,
        user=user.uid if user else None,
        group=user.gid if user else None,
        extra_groups=[] if user else None,
    )


def require_reach(user: OsUser | None, folder: Path) -> None:
    """raises ServerUnavailable if the server's user cannot get to the folder, as below /root."""
    if user is None or run_as(user, ["/bin/sh", "-c", 'cd -- "$1"', "sh", str(folder)]).returncode == 0:
        return
    raise ServerUnavailable(
        f"The server runs as the user {user.name}, who cannot reach {folder}.",
        "Set SEMAP_HOME to a folder whose parents everybody may pass (such as /var/lib/semap), "
        "or SEMAP_OS_USER to a user who may reach it.",
    )


def _name(uid: int | None) -> str:
    try:
        return pwd.getpwuid(uid or 0).pw_name
    except KeyError:
        return str(uid)


def _entry(name: str) -> pwd.struct_passwd:
    try:
        return pwd.getpwnam(name)
    except KeyError:
        raise ServerUnavailable(
            f"PostgreSQL does not run as root, and there is no user {name} to run it as.",
            "Set SEMAP_OS_USER to a user of this machine, or run semap as a user other than root.",
        ) from None


def _from_entry(entry: pwd.struct_passwd) -> OsUser:
    if entry.pw_uid == 0:
        raise ServerUnavailable(
            "PostgreSQL does not run as root, and SEMAP_OS_USER names root.",
            "Set SEMAP_OS_USER to another user, such as postgres.",
        )
    return OsUser(entry.pw_name, entry.pw_uid, entry.pw_gid)
