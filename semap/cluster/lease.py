"""Many processes share one cluster: the first starts its server, the last one to leave stops it.

Each holder has a shared flock on `lease.lock`. Who starts or stops the server holds an exclusive flock on
`start.lock` meanwhile, so that nobody joins a server that is being stopped. The kernel frees the locks of
a process that dies in whatever way; the server it leaves behind is stopped by the next one to leave.
"""

import fcntl
import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from semap.cluster.cluster import Cluster
from semap.cluster.folders import explained_access
from semap.cluster.os_user import OsUser, own

log = logging.getLogger(__name__)


@contextmanager
def lease(home: Path, settings: Mapping[str, str] | None = None) -> Iterator[Cluster]:
    """The running cluster of `home`, which keeps running for as long as this is open.

    settings  for the server if this is who starts it
    raises    ServerMissing, ServerUnavailable
    """
    cluster = Cluster(home)
    user = cluster.prepare()
    with _deciding(cluster, user):
        held = _open(cluster.home / "lease.lock", cluster, user)
        fcntl.flock(held, fcntl.LOCK_SH)
        try:
            cluster.start(settings)
        except BaseException:
            # Also after Ctrl-C, when the server may be about to answer.
            _leave(cluster, user, held)
            raise
    try:
        yield cluster
    finally:
        with _deciding(cluster, user):
            _leave(cluster, user, held)


def keep_running(home: Path, settings: Mapping[str, str] | None = None) -> Cluster:
    """Start the server and have it stay up after everybody left, until `stop_keeping`."""
    cluster = Cluster(home)
    user = cluster.prepare()
    with _deciding(cluster, user):
        cluster.start(settings)
        marker = _marker(cluster)
        marker.touch()
        own(marker, user)
    return cluster


def stop_keeping(home: Path, *, force: bool = False) -> bool:
    """Stop the server now if nobody holds a lease or if forced, else when the last one leaves.

    Returns whether it is stopped.
    """
    cluster = Cluster(home)
    if not cluster.home.exists():
        return True
    user = cluster.prepare()
    with _deciding(cluster, user):
        _marker(cluster).unlink(missing_ok=True)
        if force or not _has_holders(cluster, user):
            cluster.stop()
    return not cluster.is_running()


def _marker(cluster: Cluster) -> Path:
    return cluster.home / "keep_running"


@contextmanager
def _deciding(cluster: Cluster, user: OsUser | None) -> Iterator[None]:
    descriptor = _open(cluster.home / "start.lock", cluster, user)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _open(path: Path, cluster: Cluster, user: OsUser | None) -> int:
    with explained_access(cluster.home):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        own(path, user)
        return descriptor


def _leave(cluster: Cluster, user: OsUser | None, held: int) -> None:
    """Under `start.lock`."""
    # Closed, not unlocked: a child that was forked off still holds the lease by its copy.
    os.close(held)
    if not _marker(cluster).exists() and not _has_holders(cluster, user):
        cluster.stop()


def _has_holders(cluster: Cluster, user: OsUser | None) -> bool:
    descriptor = _open(cluster.home / "lease.lock", cluster, user)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False
