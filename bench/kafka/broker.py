"""One broker of Kafka in KRaft mode, which is its own controller, in a folder of its own."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from semap_service.processes.port import free_port

HOME = Path(os.environ.get("SEMAP_KAFKA", Path(__file__).parents[2] / ".kafka"))
CLUSTER_ID = "c2VtYXAtc2VtYXAtc2VtYQ"
JVM = ("-Xmx256m", "-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1", "-Dlog4j2.level=ERROR")
PROPERTIES = {
    "process.roles": "broker,controller",
    "node.id": "1",
    "controller.listener.names": "CONTROLLER",
    "inter.broker.listener.name": "PLAINTEXT",
    "offsets.topic.replication.factor": "1",
    "offsets.topic.num.partitions": "1",
    "transaction.state.log.replication.factor": "1",
    "transaction.state.log.min.isr": "1",
    "transaction.state.log.num.partitions": "1",
    "log.cleaner.dedupe.buffer.size": "2097152",
    "log.index.size.max.bytes": "65536",
    "auto.create.topics.enable": "false",
    # so that one that was killed is soon forgotten, and may come again
    "broker.session.timeout.ms": "2000",
    "broker.heartbeat.interval.ms": "500",
}


class KafkaMissing(Exception):
    """Java or Kafka is not there; the message says what to do."""


class Broker:
    """Mutable: its process. What it stores outlives it.

    more       properties beside PROPERTIES
    listeners  addresses beside PLAINTEXT, by the names of their protocols, as ports of 127.0.0.1
    """

    def __init__(
        self,
        folder: Path,
        more: Mapping[str, str] | None = None,
        listeners: Mapping[str, int] | None = None,
    ) -> None:
        self._java, self._folder = _java(), folder
        self.port = free_port()
        self.log_file = folder / "broker.log"
        self.data = folder / "data"
        self._process: subprocess.Popen[bytes] | None = None
        ports = {"PLAINTEXT": self.port, "CONTROLLER": free_port(), **(listeners or {})}
        addresses = {name: f"{name}://127.0.0.1:{port}" for name, port in ports.items()}
        protocols = {name: "PLAINTEXT" if name == "CONTROLLER" else name for name in ports}
        properties = PROPERTIES | {
            "log.dirs": str(self.data),
            "listeners": ",".join(addresses.values()),
            "advertised.listeners": ",".join(at for name, at in addresses.items() if name != "CONTROLLER"),
            "listener.security.protocol.map": ",".join(f"{name}:{of}" for name, of in protocols.items()),
            "controller.quorum.voters": f"1@127.0.0.1:{ports['CONTROLLER']}",
            **(more or {}),
        }
        self._file = folder / "server.properties"
        self._file.write_text("".join(f"{name}={value}\n" for name, value in properties.items()))
        self._run("kafka.tools.StorageTool", "format", "-t", CLUSTER_ID, "-c", str(self._file)).wait()

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self.port}"

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def start(self) -> None:
        """Start it; it is some seconds before it answers."""
        self._process = self._run("kafka.Kafka", str(self._file))

    def is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def answers(self) -> bool:
        """Whether it listens; raises RuntimeError where it ended."""
        if not self.is_running():
            raise RuntimeError(f"The broker ended:\n{self.log_file.read_text()[-2000:]}")
        with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1):
            return True
        return False

    def kill(self) -> None:
        self._end(signal.SIGKILL)

    def stop(self) -> None:
        self._end(signal.SIGTERM)

    def _end(self, with_signal: signal.Signals) -> None:
        if self._process is not None:
            self._process.send_signal(with_signal)
            try:
                self._process.wait(60)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None

    def _run(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [self._java, *JVM, "-cp", f"{HOME}/lib/*", program, *arguments]
        with self.log_file.open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, cwd=self._folder)


@contextmanager
def running_broker(
    folder: Path,
    until: Callable[[Callable[[], object]], None],
    more: Mapping[str, str] | None = None,
    listeners: Mapping[str, int] | None = None,
) -> Iterator[Broker]:
    """A broker that answers; `until` waits for it."""
    broker = Broker(folder, more, listeners)
    broker.start()
    try:
        until(broker.answers)
        yield broker
    finally:
        broker.kill()


def _java() -> str:
    java = shutil.which("java")
    if java is None:
        raise KafkaMissing("there is no Java for Kafka: apt-get install openjdk-17-jdk-headless")
    if not any((HOME / "lib").glob("kafka_*.jar")):
        raise KafkaMissing("there is no Kafka: ./dev kafka")
    return java
