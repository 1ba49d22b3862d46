"""The folders of a cluster: who owns them, and where its socket fits."""

import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from semap.cluster.os_user import OsUser, own
from semap.cluster.postmaster import SOCKET_NAME
from semap.errors import ServerUnavailable

LONGEST_SOCKET_PATH = 107
"""In bytes: sun_path of Linux holds 108 with the final zero."""

# Not tempfile.gettempdir(): every process has to find the same folder, whatever its TMPDIR.
SHORT_PARENT = Path("/tmp")  # noqa: S108  (the folder below it is claimed with its owner and mode checked)


def socket_folder(home: Path) -> Path:
    """In the home where the path to a socket is short enough, else a folder named after the home."""
    inside = home / "socket"
    if len(os.fsencode(inside / SOCKET_NAME)) <= LONGEST_SOCKET_PATH:
        return inside
    digest = hashlib.sha256(os.fsencode(home)).hexdigest()[:16]
    return SHORT_PARENT / f"semap-{digest}"


def claim_folder(folder: Path, user: OsUser | None) -> None:
    """Make a folder that is private to the server's user, or take the one that is.

    raises  ServerUnavailable if somebody else owns it or may enter it, or if it is not a folder
    """
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        _require_private(folder, user)
    own(folder, user)


def _require_private(folder: Path, user: OsUser | None) -> None:
    found = folder.lstat()
    # One that belongs to this process's own user was left between being made and being handed over.
    owners = {os.geteuid(), user.uid if user else os.geteuid()}
    if stat.S_ISDIR(found.st_mode) and found.st_uid in owners and not found.st_mode & 0o077:
        return
    raise ServerUnavailable(
        f"{folder} is not a private folder of the server's user.", f"Remove {folder}, or set SEMAP_HOME."
    )


@contextmanager
def explained_access(home: Path) -> Iterator[None]:
    """Turn what the operating system refuses on the way into an error that names the home."""
    try:
        yield
    except PermissionError as refusal:
        raise ServerUnavailable(
            f"This user may not use {home}: {refusal.strerror} ({refusal.filename}).",
            "Run semap as the folder's owner or as root, or set SEMAP_HOME to a folder of your own.",
        ) from refusal
    except (FileExistsError, NotADirectoryError) as obstacle:
        raise ServerUnavailable(
            f"{home} cannot be a folder: {obstacle.filename} is something else.",
            "Set SEMAP_HOME to a folder.",
        ) from obstacle
