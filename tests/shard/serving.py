"""A service over a directory and a shard, each with two maps, and its tokens."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from access.guarded import Guarded, furnish, guarded

from semap.store.database.connection import connect
from semap.store.operate.shards import place_map

HERE, THERE = ("annex", "office"), ("barn", "wing")
MAPS = (*HERE, *THERE)
FLAT = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"name": "kitchen", "height_m": 2.5},
            "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]},
        }
    ],
}


@dataclass
class Campus:
    """`ids` of what is on `office`, which the directory has, and on `wing`, which the shard has."""

    service: Guarded
    directory: str
    north: str
    ids: dict[str, dict[str, int]]


@contextmanager
def campus(directory: str, north: str) -> Iterator[Campus]:
    for name in THERE:
        place_map(directory, name, "north")
    ids = {"office": furnish(directory, *HERE), "wing": furnish(north, *THERE)}
    with connect(directory) as owner:  # as whoever writes events would
        owner.execute("update semap.progress set event_seq = (select max(seq) from semap.event)")
    with guarded(directory) as service:
        for kind in ("read", "write", "ingest", "admin"):
            service.add_token(kind, kind)
        service.add_token("wing", "write", "ingest", maps=["wing"])
        yield Campus(service, directory, north, ids)
