"""Rules on Flink: the same events as of one worker, row for row, also of a job that was killed amid them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from door_scene import DoorScene
from patience import until
from relaying import begin, counted, go_on, publishing, rows
from relaying import running as running_thread
from rule_work import await_progress, running_worker
from semap_bridge.relay.collecting import Check, check, collecting
from semap_bridge.relay.flink import Job, running
from semap_bridge.relay.topics import Topics as RelayTopics
from topics import Topics
from world import World

from bench.flink.environment import HOME, FlinkMissing, find
from bench.flink.python_environment import find_python
from bench.kafka.broker import Broker
from semap.errors import InvalidInput

PATIENCE_S = 900.0


@pytest.fixture
def job(relay: RelayTopics, broker: Broker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Job:
    try:
        find()
        python = find_python()
    except FlinkMissing as missing:
        pytest.skip(str(missing))
    connector = next((HOME / "connector" / "lib").glob("flink-sql-connector-kafka-*.jar"), None)
    if connector is None:
        pytest.skip("there is no connector of Flink to Kafka: ./dev flink")
    monkeypatch.setenv("FLINK_HOME", str(python.flink))
    prefix = relay.due.removesuffix(".due")
    return Job(broker.address, prefix, python.executable, connector, tmp_path / "checkpoints")


def below(pid: int) -> list[int]:
    """The processes that a process has begun, and those have."""
    said = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False
    )
    found = [int(each) for each in said.stdout.split()]
    return [*found, *(other for each in found for other in below(each))]


def kill(process: subprocess.Popen[bytes]) -> None:
    for pid in (process.pid, *below(process.pid)):
        os.kill(pid, signal.SIGKILL)
    process.wait()


@pytest.mark.flink
def test_a_job_that_is_killed_goes_on_with_what_it_had_under_way(
    database: str,
    other_database: str,
    relay: RelayTopics,
    broker: Broker,
    job: Job,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # the job takes long to begin, and a source that is silent meanwhile would be waited for no more
    monkeypatch.setattr("semap.intake.stretch.IDLE_AFTER_S", 1e9)
    here, there = (DoorScene(World(dsn)) for dsn in (database, other_database))
    with running_worker(database):
        begin(here)
        await_progress(database)
        before = counted(database)
        go_on(here)
        await_progress(database)
    expected = rows(database)
    assert 0 < before < len(expected)

    def collect(stop) -> None:
        collecting(other_database, relay, "main", stop)

    def publish(stop) -> None:
        publishing(other_database, relay, "main", stop)

    with running_thread(publish), running_thread(collect):
        with running(job) as process:
            begin(there)
            until(lambda: counted(other_database) == before, patience_s=PATIENCE_S)
            known = job.newest()
            # of two that follow, the second was begun after all that was collected
            until(lambda: job.newest() not in (None, known), patience_s=PATIENCE_S)
            known = job.newest()
            until(lambda: job.newest() != known, patience_s=PATIENCE_S)
            kill(process)
        go_on(there)
        with running(job) as process:
            until(
                lambda: counted(other_database) >= len(expected) or process.poll() is not None,
                patience_s=PATIENCE_S,
            )
            await_progress(other_database)
            uid = str(there.world.one("select uid from semap.map"))
            assert check(relay, uid) == Check(len(expected), [], [], [])
    assert rows(other_database) == expected
    # begun anew without its checkpoint, it would have made all of the first events again
    said = [json.loads(each.value()) for each in Topics(broker).read(relay.events)]
    assert set(Counter(each["event"]["event_id"] for each in said).values()) == {1}
    for scene in (here, there):
        scene.world.close()


def test_what_a_job_lacks_is_said(relay: RelayTopics, tmp_path: Path) -> None:
    for python, connector, said in (
        (tmp_path / "python", tmp_path, "cannot be run"),
        (Path(sys.executable), tmp_path, "lacks what the job needs"),
    ):
        job = Job("localhost:1", "x", python, connector, tmp_path / "checkpoints")
        with pytest.raises(InvalidInput, match=said), running(job):
            pass
