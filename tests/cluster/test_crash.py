import os
import select
import signal
import subprocess
from pathlib import Path

import psycopg
from server import SETTINGS

from semap.cluster import Cluster
from semap.cluster.postmaster import live_postmaster


def kill(process: int) -> None:
    """Returns when it is dead."""
    descriptor = os.pidfd_open(process)
    try:
        os.kill(process, signal.SIGKILL)
        select.select([descriptor], [], [])
    finally:
        os.close(descriptor)


def postmaster(cluster: Cluster) -> int:
    process = live_postmaster(cluster.data)
    assert process is not None
    return process


def test_committed_data_outlive_a_killed_server(home: Path) -> None:
    cluster = Cluster(home)
    cluster.start(SETTINGS)
    first = postmaster(cluster)
    # The session's backend outlives the postmaster, in the way of a new one until it ends.
    with psycopg.connect(cluster.dsn("postgres"), autocommit=True) as session:
        session.execute("create table kept as select generate_series(1, 1000) as id")
        kill(first)
        assert not cluster.is_running()
        cluster.start(SETTINGS)
        assert postmaster(cluster) != first
    with psycopg.connect(cluster.dsn("postgres")) as session:
        assert session.execute("select count(*), sum(id) from kept").fetchall() == [(1000, 500500)]


def test_a_stale_process_id_that_is_another_programs(home: Path) -> None:
    cluster = Cluster(home)
    cluster.start(SETTINGS)
    files = [cluster.data / "postmaster.pid", cluster.socket_folder / ".s.PGSQL.5432.lock"]
    remains = {file: file.read_text().splitlines()[1:] for file in files}
    cluster.stop()
    owner = cluster.data.stat()
    # Of the server's own user: the server itself would take it for a server and refuse to start.
    with subprocess.Popen(
        ["cat"],
        stdin=subprocess.PIPE,
        cwd="/",
        user=owner.st_uid if os.geteuid() == 0 else None,
        group=owner.st_gid if os.geteuid() == 0 else None,
    ) as stranger:
        for file, lines in remains.items():
            file.write_text("\n".join([str(stranger.pid), *lines, ""]))
            os.chown(file, owner.st_uid, owner.st_gid)
        assert not cluster.is_running()
        cluster.stop()
        cluster.start(SETTINGS)
        assert cluster.is_running()
        assert postmaster(cluster) != stranger.pid
        assert stranger.poll() is None
        stranger.communicate()
    assert stranger.returncode == 0


def test_another_clusters_server_is_a_stranger_too(home: Path) -> None:
    ours, theirs = Cluster(home / "ours"), Cluster(home / "theirs")
    try:
        theirs.start(SETTINGS)
        ours.start(SETTINGS)
        ours.stop()
        (ours.data / "postmaster.pid").write_text((theirs.data / "postmaster.pid").read_text())
        assert not ours.is_running()
        ours.stop()
        ours.start(SETTINGS)
        assert ours.is_running()
        assert postmaster(ours) != postmaster(theirs)
    finally:
        ours.stop()
        theirs.stop()


def test_an_empty_pid_file(home: Path) -> None:
    cluster = Cluster(home)
    cluster.start(SETTINGS)
    cluster.stop()
    (cluster.data / "postmaster.pid").touch()
    cluster.start(SETTINGS)
    assert cluster.is_running()
