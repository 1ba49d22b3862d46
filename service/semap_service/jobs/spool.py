"""Where files wait for their job: folders, each locked as long as somebody needs it.

The lock (flock) belongs to the open file and so to the job's process too, which inherits it: a folder that
nobody has locked is left over from a process that was killed, and is removed by the next that starts.
"""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from semap.errors import ServerUnavailable

LOCK = "lock"
PREFIX = "job-"
PIECE_BYTES = 1024**2


@dataclass(frozen=True)
class Spooled:
    """A file that waits. `lock` is the descriptor that holds its folder."""

    path: Path
    lock: int

    def remove(self) -> None:
        shutil.rmtree(self.path.parent, ignore_errors=True)
        os.close(self.lock)


class Spool:
    """The folder of all of them."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder or Path(tempfile.gettempdir()) / f"semap-spool-{os.getuid()}"

    def sweep(self) -> None:
        """Remove what nobody has locked."""
        for left in self.folder.glob(f"{PREFIX}*"):
            try:
                lock = os.open(left / LOCK, os.O_RDWR)
            except FileNotFoundError:
                _remove_if_empty(left)
                continue
            except OSError:
                continue
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(left, ignore_errors=True)
            except OSError:
                pass
            finally:
                os.close(lock)

    def take(self, file: BinaryIO, suffix: str) -> Spooled:
        """Copy a file in.

        suffix  with a dot, or empty
        raises  ServerUnavailable where there is no room
        """
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=self.folder))
            lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise _unusable(error) from error
        fcntl.flock(lock, fcntl.LOCK_EX)
        spooled = Spooled(folder / f"upload{suffix}", lock)
        try:
            with spooled.path.open("xb") as copy:
                shutil.copyfileobj(file, copy, PIECE_BYTES)
        except OSError as error:
            spooled.remove()
            raise _unusable(error) from error
        except BaseException:
            spooled.remove()
            raise
        return spooled


def _remove_if_empty(folder: Path) -> None:
    """A folder without a lock is being made, unless its maker was killed: then it is empty."""
    try:
        folder.rmdir()
    except OSError:
        return


def _unusable(error: OSError) -> ServerUnavailable:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return ServerUnavailable(
            "There is no room for the file on the service's disk.",
            "Free some, or give another --spool folder.",
        )
    return ServerUnavailable(
        f"The file cannot be kept: {error.strerror}.", "Give a folder that can be written to by --spool."
    )
