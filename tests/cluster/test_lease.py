import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg
import pytest
from server import SETTINGS

from semap.cluster import Cluster, keep_running, lease, stop_keeping
from semap.cluster.postmaster import live_postmaster
from semap.errors import ServerUnavailable

HOLDER = """
import sys
from pathlib import Path
from semap.cluster import lease
from semap.cluster.postmaster import live_postmaster
with lease(Path(sys.argv[1]), {"fsync": "off", "shared_buffers": "64MB"}) as cluster:
    print(live_postmaster(cluster.data), flush=True)
    sys.stdin.read()
"""


@contextmanager
def holder(home: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that takes a lease, prints the server's process id, and leaves when its input ends."""
    command = [sys.executable, "-c", HOLDER, str(home)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process


def said(process: subprocess.Popen[str]) -> int:
    assert process.stdout is not None
    return int(process.stdout.readline())


def test_the_last_to_leave_stops_the_server(home: Path) -> None:
    with lease(home, SETTINGS) as cluster:
        server = live_postmaster(cluster.data)
        with lease(home) as same:
            assert live_postmaster(same.data) == server
        assert live_postmaster(cluster.data) == server
    assert not Cluster(home).is_running()


def test_processes_share_one_server(home: Path) -> None:
    with holder(home) as one, holder(home) as two, holder(home) as three:
        servers = {said(process) for process in (one, two, three)}
        assert servers == {live_postmaster(home / "data")}
        one.communicate()
        two.communicate()
        assert {live_postmaster(home / "data")} == servers
        three.communicate()
        assert live_postmaster(home / "data") is None
        assert (one.returncode, two.returncode, three.returncode) == (0, 0, 0)


def test_a_killed_holder_does_not_keep_the_server(home: Path) -> None:
    with holder(home) as killed:
        server = said(killed)
        with lease(home) as cluster:
            killed.send_signal(signal.SIGKILL)
            killed.wait()
            assert live_postmaster(cluster.data) == server
        assert not Cluster(home).is_running()


def test_a_server_left_by_a_killed_holder_serves_the_next(home: Path) -> None:
    with holder(home) as killed:
        server = said(killed)
        killed.send_signal(signal.SIGKILL)
        killed.wait()
    assert live_postmaster(home / "data") == server
    with lease(home) as cluster:
        assert live_postmaster(cluster.data) == server
    assert not Cluster(home).is_running()


def test_the_server_has_a_session_of_its_own(home: Path) -> None:
    with holder(home) as process:
        server = said(process)
        assert os.getsid(server) != os.getsid(0)
        assert os.getsid(server) != os.getsid(process.pid)


def test_an_error_inside_leaves_too(home: Path) -> None:
    with pytest.raises(ZeroDivisionError), lease(home, SETTINGS):
        raise ZeroDivisionError
    assert not Cluster(home).is_running()


def test_a_failed_start_leaves_no_lease(home: Path) -> None:
    with pytest.raises(ServerUnavailable), lease(home, {"shared_buffers": "plenty"}):
        pass
    with lease(home, SETTINGS) as cluster:
        assert cluster.is_running()
    assert not Cluster(home).is_running()


def test_kept_until_told_otherwise(home: Path) -> None:
    cluster = keep_running(home, SETTINGS)
    with lease(home):
        pass
    assert cluster.is_running()
    assert stop_keeping(home)
    assert not cluster.is_running()
    with lease(home, SETTINGS):
        assert cluster.is_running()
    assert not cluster.is_running()


def test_told_to_stop_while_somebody_holds_a_lease(home: Path) -> None:
    keep_running(home, SETTINGS)
    with lease(home) as cluster:
        assert not stop_keeping(home)
        assert cluster.is_running()
    assert not cluster.is_running()


def test_forced_to_stop(home: Path) -> None:
    with lease(home, SETTINGS) as cluster:
        assert stop_keeping(home, force=True)
        assert not cluster.is_running()


def test_nothing_to_stop(home: Path) -> None:
    assert stop_keeping(home)
    assert not home.exists()


def test_data_outlive_the_lease(home: Path) -> None:
    with lease(home, SETTINGS) as cluster:
        cluster.create_database("map")
        with psycopg.connect(cluster.dsn("map")) as session:
            session.execute("create table room as select 'Room07' as name")
    with lease(home, SETTINGS) as cluster, psycopg.connect(cluster.dsn("map")) as session:
        assert session.execute("select name from room").fetchall() == [("Room07",)]


@pytest.mark.skipif(os.geteuid() != 0, reason="there is no second user: sudo ./dev test")
def test_another_user_gets_told(home: Path) -> None:
    with lease(home, SETTINGS) as cluster:
        script = (
            "import os, sys; from pathlib import Path; from semap.cluster import lease; "
            "from semap.errors import ServerUnavailable; import psycopg\n"
            "os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
            "try:\n"
            "    with lease(Path(sys.argv[1])): pass\n"
            "except ServerUnavailable as refusal: print(refusal, refusal.remedy, sep='|')\n"
        )
        outcome = subprocess.run(
            [sys.executable, "-c", script, str(home)], capture_output=True, text=True, check=True
        )
        assert str(home) in outcome.stdout.split("|")[0]
        assert "SEMAP_HOME" in outcome.stdout.split("|")[1]
        assert cluster.is_running()
