"""`semap up --shards 2`: two databases on one machine, each with its worker, behind one service and one feed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli.test_up import environment, events, healthy, semap, until
from semap_service.processes.port import free_port
from server import reachable_folder
from shard.test_shard_commands import FLAT

from semap.cluster import Cluster

EVENTS = 4
STROLL = "track,stamp,x,y\ncat,2026-01-31T12:00:00Z,1.0,1.5\ncat,2026-01-31T12:00:02Z,9.0,1.5\n"


@pytest.fixture
def home() -> Iterator[Path]:
    with reachable_folder() as folder:
        yield folder
        Cluster(folder).stop()


def up(home: Path, port: int, *options: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "semap_service", "up", "--without-tokens", "--port", str(port), *options]
    return subprocess.Popen(command, env=environment(home), stdout=subprocess.DEVNULL, start_new_session=True)


def test_two_shards_on_one_machine_make_one_feed(home: Path, tmp_path: Path) -> None:
    port = free_port()
    for name in ("flat", "house"):
        (tmp_path / f"{name}.geojson").write_text(json.dumps(FLAT))
    (tmp_path / "stroll.csv").write_text(STROLL)
    for options in (("--shards", "2"), ()):  # begun again, the shard is still there
        running = up(home, port, *options)
        try:
            until(lambda: healthy(port))
            if options:
                semap(home, "map", "place", "flat", "--shard", "shard-2")
                for name in ("flat", "house"):
                    semap(home, "map", "import", str(tmp_path / f"{name}.geojson"))
                    semap(home, "ingest", "tracks", str(tmp_path / "stroll.csv"), "--map", name)
            until(lambda: events(port) == EVENTS)
            listed = json.loads(semap(home, "map", "list", "--json"))
            assert [(row["name"], row["shard"]) for row in listed] == [("flat", "shard-2"), ("house", "main")]
        finally:
            os.kill(running.pid, signal.SIGTERM)
            assert running.wait(60) == 0
