"""`semap up` and `semap demo`: everything by one command, on a server of semap's own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest
from patience import moment
from semap_service import demo
from semap_service.processes.port import free_port
from server import reachable_folder

from semap.cluster import Cluster

FOLDER = Path(demo.__file__).parent
DEMO_S = 600.0
"""It simulates a recording, where none is in the cache, and looks at each of its images."""
PATIENCE_S = 60.0


def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        moment()


def get(port: int, path: str) -> httpx.Response | None:
    try:
        return httpx.get(f"http://127.0.0.1:{port}{path}", timeout=PATIENCE_S)
    except httpx.TransportError:
        return None


def healthy(port: int) -> bool:
    answer = get(port, "/health")
    return answer is not None and answer.status_code == 200


@pytest.fixture
def home() -> Iterator[Path]:
    with reachable_folder() as folder:
        yield folder
        Cluster(folder).stop()


def environment(home: Path) -> dict[str, str]:
    return {**{k: v for k, v in os.environ.items() if k != "SEMAP_DSN"}, "SEMAP_HOME": str(home)}


def semap(home: Path, *arguments: str, patience_s: float = PATIENCE_S) -> str:
    ran = subprocess.run([sys.executable, "-m", "semap_service", *arguments], env=environment(home), text=True,
                         capture_output=True, timeout=patience_s, check=False)  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def events(port: int) -> int:
    answer = get(port, "/events?limit=1000")
    return -1 if answer is None or answer.status_code != 200 else len(answer.json()["events"])


def children(pid: int) -> dict[str, int]:
    """Process ids of the supervised processes, by command."""
    found = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(entry.read_text().rpartition(")")[2].split()[1]) == pid:
                command = (entry.parent / "cmdline").read_bytes().split(b"\0")
                found[command[3].decode()] = int(entry.parent.name)
        except (OSError, IndexError):
            continue
    return found


def test_up_brings_all_up_keeps_it_up_and_takes_it_down(home: Path) -> None:
    port = free_port()
    up = subprocess.Popen([sys.executable, "-m", "semap_service", "up", "--port", str(port), "--without-tokens"],
                          env=environment(home), text=True, stdout=subprocess.PIPE)  # fmt: skip
    try:
        assert next(line for line in up.stdout if line.startswith("semap is up"))
        assert healthy(port)
        semap(home, "map", "import", str(FOLDER / "office.geojson"))
        semap(home, "ingest", "tracks", str(FOLDER / "walk.csv"), "--map", "office")
        until(lambda: events(port) == 36)
        os.kill(children(up.pid)["work"], signal.SIGKILL)
        os.kill(children(up.pid)["serve"], signal.SIGKILL)
        os.kill(int((home / "data" / "postmaster.pid").read_text().split()[0]), signal.SIGKILL)
        semap(home, "ingest", "tracks", str(FOLDER / "walk.csv"), "--map", "office", "--source", "again")
        until(lambda: events(port) == 72)
    finally:
        up.send_signal(signal.SIGINT)
        assert up.wait(PATIENCE_S) == 0
        up.stdout.close()
    assert not Cluster(home).is_running()
    assert not healthy(port)


def test_a_port_that_is_taken_is_told(home: Path) -> None:
    import socket  # noqa: PLC0415

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        ran = subprocess.run([sys.executable, "-m", "semap_service", "up", "--port", str(port)],
                             env=environment(home), text=True, capture_output=True, check=False)  # fmt: skip
    assert ran.returncode == 2
    assert "--port" in ran.stderr
    assert not (home / "data").exists()


def test_the_demo_ends_by_itself_and_leaves_nothing(home: Path) -> None:
    said = semap(home, "demo", "--fast", patience_s=DEMO_S)
    assert "All 52 that happened were found within half a second, and nothing else was." in said
    assert "opened_then_entered: 15" in said
    assert "ann left office_1 (last seen there)" in said
    assert list(home.iterdir()) == []
