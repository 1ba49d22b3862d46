"""The service as a process of its own, which can be killed, and what happens on its maps."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid4, uuid5

import httpx
import psycopg
from patience import PATIENCE_S, moment
from psycopg.types.json import Jsonb
from semap_service import demo

from semap.store.database.connection import connect

OFFICE = Path(demo.__file__).parent / "office.geojson"


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port: int = taken.getsockname()[1]
        return port


@dataclass
class Served:
    """`semap serve` over a database; `start` after `kill` serves at the same port again."""

    dsn: str
    options: Sequence[str] = ("--without-tokens",)
    port: int = field(default_factory=free_port)
    process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def start(self) -> Served:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "semap_service", "serve", "--port", str(self.port), *self.options],
            env={**os.environ, "SEMAP_DSN": self.dsn},
            stdout=subprocess.DEVNULL,
        )
        until_s = time.monotonic() + PATIENCE_S
        while True:
            assert self.process.poll() is None, "the service ended"
            assert time.monotonic() < until_s, "the service does not answer"
            try:
                if httpx.get(f"{self.url}/health", timeout=PATIENCE_S).is_success:
                    return self
            except httpx.TransportError:
                moment()

    def kill(self) -> None:
        assert self.process is not None
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            self.process.wait(PATIENCE_S)


@dataclass
class Office:
    """A map with the demo's office, and what is made to happen on it, by SQL as the workers write it."""

    url: str
    name: str
    plain: psycopg.Connection
    now: datetime = field(default_factory=lambda: datetime.now(UTC).replace(microsecond=0))

    @classmethod
    def bring_in(cls, url: str, dsn: str, name: str) -> Office:
        with OFFICE.open("rb") as file:
            made = httpx.post(f"{url}/maps/import", params={"name": name}, files={"file": file}, timeout=60)
        assert made.status_code == 201, made.text
        return cls(url, name, connect(dsn))

    @classmethod
    def at(cls, served: Served, name: str) -> Office:
        """A map that is there already."""
        return cls(served.url, name, connect(served.dsn))

    @property
    def page(self) -> str:
        return f"{self.url}/#map={self.name}"

    def get(self, path: str, **parameters: object) -> Any:
        found = httpx.get(self.url + path, params=parameters, timeout=PATIENCE_S)
        assert found.status_code == 200, found.text
        return found.json()

    def instance(self, name: str) -> dict[str, Any]:
        (found,) = self.get("/instances", map=self.name, name=name)["instances"]
        whole: dict[str, Any] = self.get(f"/instances/{found['id']}")
        return whole

    def names(self) -> set[str]:
        return {each["name"] for each in self.get("/instances", map=self.name)["instances"]}

    def track(self, name: str) -> int:
        self.plain.execute(
            "insert into semap.source (map_id, name) select map_id, 'lidar' from semap.map where name = %s"
            " on conflict do nothing",
            [self.name],
        )
        return self._one(
            "insert into semap.track (uid, source_id, map_id, name) select %s, source_id, map_id, %s"
            " from semap.source join semap.map m using (map_id) where m.name = %s returning track_id",
            uuid5(NAMESPACE_URL, f"{self.name}/{name}"),
            name,
            self.name,
        )

    def see(
        self, track_id: int, x_m: float, y_m: float, after_s: float, z_m: float | None = None
    ) -> datetime:
        """A track is somewhere, so long after the beginning."""
        stamp = self.now + timedelta(seconds=after_s)
        self.plain.execute(
            "insert into semap.track_state (track_id, stamp, x_m, y_m, z_m) values (%s, %s, %s, %s, %s)",
            [track_id, stamp, x_m, y_m, z_m],
        )
        return stamp

    def leave(self, track_id: int, x_m: float, y_m: float, after_s: float) -> None:
        """A track is seen for the last time."""
        self.plain.execute(
            "insert into semap.track_state (track_id, stamp, x_m, y_m, is_last) values (%s, %s, %s, %s, true)",
            [track_id, self.now + timedelta(seconds=after_s), x_m, y_m],
        )

    def happen(
        self,
        kind: str,
        track_id: int,
        room: str,
        after_s: float,
        key: dict[str, Any] | None = None,
        measures: dict[str, Any] | None = None,
    ) -> datetime:
        """An event, committed with its notification as the rule worker does."""
        stamp = self.now + timedelta(seconds=after_s)
        self._one(
            "with next as (select coalesce(max(seq), 0) + 1 as seq from semap.event),"
            " made as (insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, cause,"
            " track_id, track_name, instance_id, instance_name, since, key, measures)"
            " select seq, %s, m.map_id, 'room_visits', 1, %s, %s, 'moved', t.track_id, t.name, i.instance_id, i.name,"
            " %s, %s, %s from next, semap.map m join semap.track t using (map_id) join semap.instance i using (map_id)"
            " where m.name = %s and t.track_id = %s and i.name = %s returning seq)"
            " select pg_notify('semap_event', '')::text from made",
            uuid4(),
            kind,
            stamp,
            stamp,
            Jsonb(key or {}),
            Jsonb(measures or {}),
            self.name,
            track_id,
            room,
        )
        return stamp

    def close(self) -> None:
        self.plain.close()

    def _one(self, statement: str, *parameters: object) -> Any:
        row = self.plain.execute(statement, parameters).fetchone()
        assert row is not None
        return row[0]


def brought_in(served: Served, name: str, file: bytes) -> str:
    """The address of the page with a map of this GeoJSON."""
    made = httpx.post(
        f"{served.url}/maps/import", params={"name": name}, files={"file": ("a.geojson", file)}, timeout=60
    )
    assert made.status_code == 201, made.text
    return f"{served.url}/#map={name}"


def house(*storeys: tuple[str, float, tuple[tuple[str, float, float, float, float], ...]]) -> bytes:
    """GeoJSON of storeys: name, elevation [m], rooms as `building` takes them."""
    features = []
    for storey, elevation_m, rooms in storeys:
        made = json.loads(building(*rooms))["features"]
        for each in made:
            each["properties"] |= {"storey": storey, "elevation_m": elevation_m}
        features += made
    levels = {name: elevation_m for name, elevation_m, _ in storeys}
    return json.dumps({"type": "FeatureCollection", "features": features, "storeys": levels}).encode()


def building(*rooms: tuple[str, float, float, float, float]) -> bytes:
    """GeoJSON of rooms that are boxes: name, x, y from and to [m]."""
    features = [
        {
            "type": "Feature",
            "properties": {"name": name, "concept": "Room", "height_m": 2.5},
            "geometry": {"type": "Polygon", "coordinates": [[[x, y], [u, y], [u, v], [x, v], [x, y]]]},
        }
        for name, x, y, u, v in rooms
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()
