"""Kill -9 of bridges, of the broker and of PostgreSQL, both ways: nothing lost, nothing twice, all in order."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from signal import SIGKILL
from threading import Event as Signal
from threading import Thread

import psycopg
import pytest
import yaml
from bridging import STORED, config
from patience import any_moment, moment, until
from server import SETTINGS, reachable_folder
from topics import Topics
from world import SECOND_US, World

from bench.kafka.broker import Broker, KafkaMissing
from semap.cluster import Cluster
from semap.errors import SemapError
from semap.store.database.connection import connect
from semap.store.operate.schema import migrate

FIRST_US = 1_700_000_000 * SECOND_US
VICTIMS = ("bridge", "broker", "postgres")
TELL = (
    "insert into semap.event (seq, event_id, map_id, type, stamp, rule_version, rule_name, since)"
    " select coalesce((select max(seq) from semap.event), 0) + 1, gen_random_uuid(), %s, 'told', now(), 1,"
    " 'room_visits', now()"
)


@dataclass
class Scene:
    """Mutable: a server, a broker, and a bridge both ways as a process, between a feed and its readers.

    states  those that were given to the topic, which keeps them in this order
    """

    cluster: Cluster
    broker: Broker
    topics: Topics
    folder: Path
    dsn: str
    map_id: int
    bridge: subprocess.Popen | None = None
    states: list[tuple] = field(default_factory=list)
    over: Signal = field(default_factory=Signal)

    @property
    def inward(self) -> str:
        return self.topics.name("states")

    @property
    def outward(self) -> str:
        return self.topics.name("events")

    def give_states(self) -> None:
        """Every moment some, each once: the producer is idempotent, and tries until the broker is back."""
        producer = self.topics.producer()
        while not self.over.is_set():
            for _ in range(2):
                number = len(self.states)
                name, stamp_us, x_m = f"t{number % 3}", FIRST_US + number // 3 * SECOND_US, number * 0.1
                producer.produce(self.inward, json.dumps({"stamp_us": stamp_us, "x_m": x_m, "y_m": 0}), name)
                self.states.append((name, stamp_us, x_m, 0.0))
            producer.poll(0)
            moment()
            moment()
        assert producer.flush(120) == 0
        producer.close()

    def give_events(self) -> None:
        """Every moment one, while the server is there; which there are the server knows."""
        while not self.over.is_set():
            with suppress(psycopg.Error, SemapError), connect(self.dsn) as connection:
                while not self.over.is_set():
                    connection.execute(TELL, [self.map_id])
                    moment()
                    moment()
            moment()

    def start_bridge(self) -> None:
        command = [sys.executable, "-m", "semap_service", "bridge", self.folder / "bridges.yaml"]
        with (self.folder / "bridge.log").open("ab") as log:
            self.bridge = subprocess.Popen(
                command, env={**os.environ, "SEMAP_DSN": self.dsn}, stdout=log, stderr=log
            )

    def kill(self, victim: str) -> None:
        if victim == "bridge":
            self.end_bridge()
            self.start_bridge()
        elif victim == "broker":
            self.broker.kill()
            self.broker.start()
            until(self.broker.answers)
        else:
            os.kill(int((self.cluster.data / "postmaster.pid").read_text().split()[0]), SIGKILL)
            until(lambda: not self.cluster.is_running())
            self.cluster.start(SETTINGS)

    def end_bridge(self) -> None:
        assert self.bridge is not None
        assert self.bridge.poll() is None, self.log()
        self.bridge.kill()
        self.bridge.wait()

    def await_progress(self) -> None:
        """Until more went both ways than before, so that what is killed next is at work."""
        came, went = self._came(), self.topics.end(self.outward)
        until(lambda: self._came() > came, self.log)
        until(lambda: self.topics.end(self.outward) > went, self.log)

    def _came(self) -> int:
        """Up to which offset records are in."""
        found = self.rows(
            "select (position -> 'offsets' ->> '0')::bigint from semap.bridge_position"
            " where way = 'in' and position is not null"
        )
        return int(found[0][0]) if found else 0

    def rows(self, statement: str) -> list[tuple]:
        with connect(self.dsn) as connection:
            return connection.execute(statement).fetchall()

    def log(self) -> str:
        assert self.bridge is not None
        said = (self.folder / "bridge.log").read_text()[-3000:]
        assert self.bridge.poll() is None, said
        return said


@contextmanager
def scene(folder: Path) -> Iterator[Scene]:
    with reachable_folder() as home:
        cluster = Cluster(home)
        cluster.start(SETTINGS)
        broker = Broker(folder)
        try:
            cluster.create_database("killed")
            migrate(cluster.dsn("killed"))
            broker.start()
            until(broker.answers)
            world = World(cluster.dsn("killed"))
            made = Scene(cluster, broker, Topics(broker), folder, cluster.dsn("killed"), world.map_id)
            world.close()
            made.topics.make("states")
            made.topics.make("events")
            said = {
                "name": "lines", "kind": "kafka", "servers": broker.address, "from_start": True,
                "states": made.inward, "events": made.outward,
            }  # fmt: skip
            config(folder, yaml.safe_dump([said]))
            made.start_bridge()
            try:
                yield made
            finally:
                made.over.set()
                made.end_bridge()
        finally:
            broker.kill()
            cluster.stop()


@pytest.mark.parametrize("wanted", [3, pytest.param(90, marks=pytest.mark.slow)])
def test_kills_lose_and_double_nothing_either_way(tmp_path: Path, wanted: int) -> None:
    dice = random.Random(20_260_131)
    try:
        with scene(tmp_path) as run:
            feeds = [Thread(target=run.give_states), Thread(target=run.give_events)]
            for each in feeds:
                each.start()
            try:
                for number in range(wanted):
                    run.await_progress()
                    any_moment(dice, 0.0, 0.3)
                    run.kill(VICTIMS[number % len(VICTIMS)])
                run.await_progress()
            finally:
                run.over.set()
                for each in feeds:
                    each.join()
            made = [
                str(event_id) for (event_id,) in run.rows("select event_id from semap.event order by seq")
            ]
            until(lambda: len(run.rows("select from semap.stored_state")) >= len(run.states), run.log)
            until(lambda: run.topics.count(run.outward) >= len(made), run.log)
            assert [json.loads(each.value())["stamp_us"] for each in run.topics.read(run.inward)] == [
                stamp_us for _, stamp_us, *_ in run.states
            ]
            assert run.rows(STORED) == run.states
            assert [each["id"] for each in run.topics.events(run.outward)] == made
            assert run.rows("select refused from semap.bridge") == [(0,)]
    except KafkaMissing as missing:
        pytest.skip(str(missing))
