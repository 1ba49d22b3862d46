"""Bridges for tests: a map with a room, what is said to it, and bridges that run beside."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event as Signal
from threading import Thread

from semap_bridge.config import Entry, read_config
from semap_bridge.delivery import Past
from semap_bridge.running import run_bridge
from world import World

from semap.timeline.stamp import rfc3339, to_datetime

STORED = (
    "select t.name, (extract(epoch from s.stamp) * 1000000)::bigint, s.x_m, s.y_m"
    " from semap.stored_state s join semap.track t using (track_id) order by 2, 1"
)


def line(track: str, stamp_us: int, x_m: float, y_m: float = 0.0, **more: object) -> bytes:
    """A state as a line of JSON."""
    said = {"track": track, "stamp": rfc3339(to_datetime(stamp_us)), "x_m": x_m, "y_m": y_m, **more}
    return json.dumps(said).encode() + b"\n"


def config(folder: Path, text: str, map_name: str = "world") -> Path:
    """A config of bridges; `text` is the list of them."""
    path = folder / "bridges.yaml"
    path.write_text(f"map: {map_name}\nbridges:\n{text}")
    return path


def entry(folder: Path, **settings: object) -> Entry:
    """The one bridge of a config, `lines`, with these settings of the adapter."""
    written = "".join(f"    {name}: {json.dumps(value)}\n" for name, value in settings.items())
    return read_config(config(folder, f"  - name: lines\n    kind: ndjson\n{written}")).bridges[0]


def run_to_its_end(world: World, one: Entry) -> None:
    run_bridge(world.dsn, one, Signal())


@contextmanager
def running(world: World, one: Entry, past: Past | None = None) -> Iterator[Thread]:
    """The bridge runs in a thread as long as this lasts; what it raises is raised."""
    stop, raised = Signal(), []

    def run() -> None:
        try:
            run_bridge(world.dsn, one, stop, past)
        except BaseException as error:
            raised.append(error)

    thread = Thread(target=run)
    thread.start()
    try:
        yield thread
    finally:
        stop.set()
        thread.join()
    if raised:
        raise raised[0]


def stored(world: World) -> list[tuple]:
    return world.rows(STORED)


def report(world: World, name: str = "lines") -> dict[str, object]:
    """What a bridge said of itself; as one that has nothing to say before it has."""
    said = world.rows("select to_jsonb(b) from semap.bridge b where name = %s", name)
    counts = {"received": 0, "committed": 0, "dropped": 0}
    return {"state": "", "refusals": {}, "trouble": "", **counts, **(said[0][0] if said else {})}


def self_signed(folder: Path) -> Path:
    """A certificate of localhost, server.pem, with its key server.key in PKCS#8."""
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
         "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost",
         "-keyout", folder / "server.key", "-out", folder / "server.pem"],
        check=True, capture_output=True,
    )  # fmt: skip
    return folder / "server.pem"
