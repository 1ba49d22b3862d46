"""A disk that is full: who waits says so in the server's own words, and goes on when there is room."""

from __future__ import annotations

import logging
import os
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event as Signal
from threading import Thread

import numpy as np
import pytest
import shapely
from patience import PATIENCE_S, until
from rule_work import running_worker
from semap_ingest.replay import Plan, replay
from semap_ingest.track_file import Tracks
from server import reachable_folder
from sqlalchemy import Engine
from world import SECOND_US, World

from semap.cluster import Cluster
from semap.store.database.connection import connect, open_engine
from semap.store.operate.readiness import lacks
from semap.store.operate.schema import migrate

ROOM_MB = 96
NO_ROOM = "No space left on device"
NO_CONNECTION = "could not write init file"
"""What the server says to who comes new, where its cache of the catalogue was out of date when the disk was full."""


@dataclass
class SmallDisk:
    """A database on a file system of its own, which can be filled up."""

    dsn: str
    folder: Path

    def fill(self) -> None:
        with (self.folder / "filler").open("wb", buffering=0) as filler, suppress(OSError):
            while filler.write(bytes(4096)):
                pass

    def make_room(self) -> None:
        (self.folder / "filler").unlink()


@pytest.fixture
def small_disk(cluster: Cluster) -> Iterator[SmallDisk]:
    if os.geteuid() != 0:
        pytest.skip("only root may mount a file system")
    with reachable_folder() as folder:
        mount = ["mount", "-t", "tmpfs", "-o", f"size={ROOM_MB}m,mode=0777", "tmpfs", str(folder)]
        if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
            pytest.skip("no file system may be mounted here")
        try:
            space = folder / "space"
            space.mkdir()
            with connect(cluster.dsn("postgres")) as connection:
                owner = (cluster.home / "data").stat()
                os.chown(space, owner.st_uid, owner.st_gid)
                connection.execute(f"create tablespace small location '{space}'")
                connection.execute("create database small tablespace small")
            dsn = cluster.dsn("small")
            migrate(dsn)
            yield SmallDisk(dsn, folder)
            cluster.drop_database("small")
            with connect(cluster.dsn("postgres")) as connection:
                connection.execute("drop tablespace small")
        finally:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def walk(states: int) -> Tracks:
    rows, nan = np.arange(states), np.full(states, np.nan)
    return Tracks(("ann",), rows * 0, rows * SECOND_US, rows % 9 * 1.0, rows * 0.0 + 1, nan, nan, nan, nan)


def said(caplog: pytest.LogCaptureFixture, logger: str) -> list[str]:
    told = [each.getMessage() for each in caplog.records if each.name == logger]
    return [each for each in told if NO_ROOM in each or NO_CONNECTION in each]


def lacking(service: Engine) -> dict[str, str]:
    """What the service lacks, asked over a connection that it has."""
    with service.begin() as connection:
        return dict(lacks(connection, feed_connected=True))


def test_a_full_disk_is_told_and_waited_for(small_disk: SmallDisk, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    world = World(small_disk.dsn)
    service = open_engine(small_disk.dsn, "semap_read", size=1)
    lacking(service)
    world.add_room("room", shapely.box(-1, -1, 4.5, 4))
    plan = Plan("world", "walk", "walk.csv", "f1", batch_size=2000)
    tracks = walk(60_000)
    stop = Signal()
    written: list[int] = []

    def advance(done: int, total: int) -> None:
        written.append(done)
        if len(written) == 2:
            small_disk.fill()

    writer = Thread(target=replay, args=(small_disk.dsn, plan, tracks, advance, stop), daemon=True)
    writer.start()
    until(lambda: bool(said(caplog, "semap_ingest.replay")))
    told = said(caplog, "semap_ingest.replay")[0]
    assert told.startswith("states wait: could not extend file")
    assert told.endswith("(Check free disk space.)")
    with running_worker(small_disk.dsn):
        until(lambda: bool(said(caplog, "semap.worker.rule_worker")))
        assert said(caplog, "semap.worker.rule_worker")[0].startswith("Changes wait to become events: ")
        lack = lacking(service)
        small_disk.make_room()
        assert NO_ROOM in lack["database"]
        assert "worker" in lack
        writer.join(PATIENCE_S * 3)
        assert not writer.is_alive()
        assert world.one("select states_done from semap.recording") == len(tracks)
        until(
            lambda: (
                world.one("select count(*) from semap.event")
                == world.one("select count(*) from semap.relation_change")
            )
        )
    service.dispose()
    world.connection.close()
