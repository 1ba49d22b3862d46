"""Kill -9 of the process that brings a recording in, and of PostgreSQL: nothing lost, nothing twice."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time

import pytest
from patience import any_moment, moment, until
from semap_service.exchange.map_file import bring_in, read_file
from server import SETTINGS, reachable_folder
from sqlalchemy import text
from stored_results import stored

from semap.cluster import Cluster
from semap.store.database.connection import one_transaction
from semap.store.operate.schema import migrate

PATIENCE_S = 300.0
PACE = "0.15"
CONNECTED = text("""
    select exists (select from pg_stat_activity
                   where application_name = 'semap ingest' and datname = current_database())
""")


def begun(dsn: str, recording: str, pace: str | None) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "semap_service", "ingest", "recording", recording, "--map", "office",
         *([] if pace is None else ["--realtime", pace])],
        env={**os.environ, "SEMAP_DSN": dsn, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def is_done(process: subprocess.Popen) -> bool:
    process.communicate(timeout=PATIENCE_S)
    return process.returncode == 0


def is_connected(dsn: str) -> bool:
    with one_transaction(dsn) as connection:
        return bool(connection.scalar(CONNECTED))


def end(process: subprocess.Popen) -> None:
    process.kill()
    process.communicate()


def kill_server(cluster: Cluster) -> None:
    postmaster = int((cluster.data / "postmaster.pid").read_text().split()[0])
    os.kill(postmaster, signal.SIGKILL)
    until(lambda: not cluster.is_running())
    cluster.start(SETTINGS)


def with_map(cluster: Cluster, name: str, office) -> str:
    cluster.create_database(name)
    migrate(cluster.dsn(name))
    with one_transaction(cluster.dsn(name), "semap_api") as connection:
        bring_in(connection, read_file(office.map), "office", "office")
    return cluster.dsn(name)


@pytest.mark.slow
def test_kills_at_random_moments_change_nothing(office):
    dice = random.Random(20_260_105)
    recording = str(office.recording)
    kills = {"process": 0, "postgres": 0}
    with reachable_folder() as folder:
        cluster = Cluster(folder)
        cluster.start(SETTINGS)
        process = None
        try:
            dsn = with_map(cluster, "calm", office)
            assert is_done(begun(dsn, recording, None))
            undisturbed = stored(dsn)
            dsn = with_map(cluster, "killed", office)
            process = begun(dsn, recording, PACE)
            while sum(kills.values()) < 8:
                # one that begins while the server does ends, and says so
                until(lambda process=process: process.poll() is not None or is_connected(dsn))
                any_moment(dice, 0.5, 4.0)
                assert process.poll() is None, f"{process.stderr.read()} after {kills}"
                victim = min(kills, key=lambda name: kills[name] + 2 * dice.random())
                kills[victim] += 1
                if victim == "postgres":
                    kill_server(cluster)
                else:
                    end(process)
                    process = begun(dsn, recording, PACE)
            assert is_done(process)
            disturbed = stored(dsn)
        finally:
            if process is not None:
                end(process)
            cluster.stop()
    assert min(kills.values()) >= 2
    assert disturbed == undisturbed


@pytest.mark.slow
def test_ctrl_c_says_how_to_go_on(office_map, office):
    migrate(office_map)
    process = begun(office_map, str(office.recording), PACE)
    deadline_s = time.monotonic() + PATIENCE_S
    while not stored(office_map)["lines"]:
        assert time.monotonic() < deadline_s
        assert process.poll() is None, process.stderr.read()
        moment()
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Run the same command again" in told
    assert is_done(begun(office_map, str(office.recording), None))
    assert all("True, 0)" in row for row in stored(office_map)["sources"])
