import os
import stat
import subprocess
from pathlib import Path

import psycopg
import pytest
from server import SETTINGS

from semap.cluster import Cluster
from semap.cluster.folders import SHORT_PARENT
from semap.cluster.postmaster import live_postmaster
from semap.cluster.programs import find_programs
from semap.errors import DatabaseError, ServerUnavailable

needs_root = pytest.mark.skipif(
    os.geteuid() != 0, reason="there is no root to hand the server to another user: sudo ./dev test"
)


def setting(cluster: Cluster, name: str) -> str:
    with psycopg.connect(cluster.dsn("postgres")) as session:
        row = session.execute("select current_setting(%s)", [name]).fetchone()
    assert row is not None
    return str(row[0])


def test_starts_and_stops(home: Path) -> None:
    cluster = Cluster(home)
    assert not cluster.is_running()
    cluster.start(SETTINGS)
    first = live_postmaster(cluster.data)
    cluster.start(SETTINGS)
    assert cluster.is_running()
    assert live_postmaster(cluster.data) == first
    cluster.stop()
    assert not cluster.is_running()
    cluster.stop()


def test_settings(home: Path) -> None:
    cluster = Cluster(home)
    cluster.start({**SETTINGS, "application_name": r"it's a \ test"})
    expected = {
        "listen_addresses": "",
        "wal_level": "logical",
        "jit": "off",
        "TimeZone": "UTC",
        "max_replication_slots": "32",
        "max_wal_senders": "32",
        "max_slot_wal_keep_size": "16GB",
        "data_checksums": "on",
        "server_encoding": "UTF8",
        "synchronous_commit": "on",
        "fsync": "off",
        "unix_socket_permissions": "0700",
    }
    assert {name: setting(cluster, name) for name in expected} == expected
    assert r"application_name = 'it''s a \\ test'" in (cluster.data / "semap.conf").read_text()


def test_settings_are_written_anew_at_each_start(home: Path) -> None:
    cluster = Cluster(home)
    cluster.start({**SETTINGS, "work_mem": "5MB"})
    assert setting(cluster, "work_mem") == "5MB"
    cluster.stop()
    cluster.start(SETTINGS)
    assert setting(cluster, "work_mem") == "4MB"


def test_libpq_environment_does_not_lead_elsewhere(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"PGHOSTADDR": "192.0.2.1", "PGPORT": "1", "PGDATA": "/", "PGUSER": "nobody"}.items():
        monkeypatch.setenv(name, value)
    cluster = Cluster(home)
    cluster.start(SETTINGS)
    assert setting(cluster, "data_directory") == str(cluster.data)


def test_databases(cluster: Cluster) -> None:
    name = 'odd "name'
    assert not cluster.has_database(name)
    cluster.create_database(name)
    assert cluster.has_database(name)
    with pytest.raises(DatabaseError, match="already exists"):
        cluster.create_database(name)
    with psycopg.connect(cluster.dsn(name), autocommit=True) as session:
        session.execute("create table thing as select 7 as id")
    cluster.create_database("copy of it", template=name)
    with psycopg.connect(cluster.dsn("copy of it")) as session:
        assert session.execute("select id from thing").fetchall() == [(7,)]
        cluster.drop_database("copy of it")
        with pytest.raises(psycopg.OperationalError):
            session.execute("select 1")
    cluster.drop_database(name)
    cluster.drop_database(name)
    assert not cluster.has_database(name)


def test_a_database_is_dropped_while_its_slot_is_read(cluster: Cluster) -> None:
    cluster.create_database("watched")
    with psycopg.connect(cluster.dsn("watched"), autocommit=True) as session:
        session.execute("select pg_create_logical_replication_slot('watcher', 'pgoutput')")
    command = [
        "pg_recvlogical",
        "-d",
        cluster.dsn("watched"),
        "-S",
        "watcher",
        "--start",
        "--no-loop",
        "-f",
        "-",
    ]
    options = ["-o", "proto_version=1", "-o", "publication_names=none", "-v"]
    programs = find_programs()
    with subprocess.Popen(
        [programs.path(command[0]), *command[1:], *options], stderr=subprocess.PIPE, text=True
    ) as reader:
        assert reader.stderr is not None
        while "streaming initiated" not in (said := reader.stderr.readline()):
            assert said
        cluster.drop_database("watched")
        reader.communicate()
    assert not cluster.has_database("watched")


def test_a_stopped_server_does_not_answer(home: Path) -> None:
    with pytest.raises(ServerUnavailable, match="does not answer"):
        Cluster(home).has_database("map")


def test_a_start_that_fails_shows_the_log(home: Path) -> None:
    cluster = Cluster(home)
    with pytest.raises(ServerUnavailable, match=r'(?s)did not start:.*"shared_buffers".*"plenty"') as refusal:
        cluster.start({"shared_buffers": "plenty"})
    assert str(cluster.log_file) in refusal.value.remedy
    cluster.start(SETTINGS)
    assert cluster.is_running()


def test_an_interrupted_initialise_leaves_nothing_half_done(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster = Cluster(home)
    real = Path.rename

    def interrupted(self: Path, target: Path) -> Path:
        if target == cluster.data:
            raise KeyboardInterrupt
        return real(self, target)

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cluster.initialise(sync=False)
    monkeypatch.undo()
    assert not cluster.data.exists()
    assert len(list(home.glob("data.partial-*"))) == 1
    cluster.start(SETTINGS)
    assert cluster.is_running()
    assert list(home.glob("data.partial-*")) == []


def test_a_long_path_gets_its_socket_elsewhere(home: Path) -> None:
    cluster = Cluster(home / ("long" * 25))
    assert cluster.socket_folder.parent == SHORT_PARENT
    try:
        cluster.start(SETTINGS)
        assert setting(cluster, "data_directory") == str(cluster.data)
        assert stat.S_IMODE(cluster.socket_folder.stat().st_mode) == 0o700
    finally:
        cluster.stop()
        cluster.socket_folder.rmdir()


def test_a_socket_folder_that_others_may_enter_is_refused(home: Path) -> None:
    cluster = Cluster(home / ("long" * 25))
    cluster.socket_folder.mkdir()
    cluster.socket_folder.chmod(0o755)
    try:
        with pytest.raises(ServerUnavailable, match="not a private folder"):
            cluster.start(SETTINGS)
    finally:
        cluster.socket_folder.rmdir()


def test_a_file_in_place_of_the_home(home: Path) -> None:
    home.touch()
    with pytest.raises(ServerUnavailable, match="cannot be a folder"):
        Cluster(home).start(SETTINGS)
    home.unlink()


def test_two_homes_do_not_touch_each_other(home: Path) -> None:
    one, two = Cluster(home / "one"), Cluster(home / "two")
    try:
        one.start(SETTINGS)
        process = live_postmaster(one.data)
        two.start(SETTINGS)
        one.create_database("only in one")
        assert not two.has_database("only in one")
        two.stop()
        assert live_postmaster(one.data) == process
        assert one.has_database("only in one")
    finally:
        one.stop()
        two.stop()


@needs_root
def test_root_hands_the_server_to_another_user(home: Path) -> None:
    cluster = Cluster(home)
    cluster.start(SETTINGS)
    process = Path("/proc", str(live_postmaster(cluster.data)))
    owner = cluster.data.stat()
    assert owner.st_uid != 0
    assert process.stat().st_uid == owner.st_uid
    assert stat.S_IMODE(owner.st_mode) == 0o700
    groups = next(
        line for line in process.joinpath("status").read_text().splitlines() if line.startswith("Groups")
    )
    assert "0" not in groups.split()


@needs_root
def test_the_user_is_chosen_by_name_and_then_kept(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cluster = Cluster(home)
    monkeypatch.setenv("SEMAP_OS_USER", "daemon")
    cluster.start(SETTINGS)
    cluster.stop()
    monkeypatch.delenv("SEMAP_OS_USER")
    cluster.start(SETTINGS)
    assert cluster.data.owner() == "daemon"


@needs_root
@pytest.mark.parametrize(
    ("name", "said"), [("nobody-has-this-name", "there is no user"), ("root", "names root")]
)
def test_a_user_that_cannot_be_dropped_to(
    name: str, said: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEMAP_OS_USER", name)
    with pytest.raises(ServerUnavailable, match=said) as refusal:
        Cluster(home).start(SETTINGS)
    assert "SEMAP_OS_USER" in refusal.value.remedy


@needs_root
def test_a_folder_that_the_user_cannot_reach(home: Path) -> None:
    home.mkdir(mode=0o700)
    with pytest.raises(ServerUnavailable, match="cannot reach") as refusal:
        Cluster(home / "inside").start(SETTINGS)
    assert "SEMAP_HOME" in refusal.value.remedy
    assert not (home / "inside" / "data").exists()
    home.chmod(0o755)
