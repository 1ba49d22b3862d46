"""The databases behind one service: which of them a request is about, and connections to it.

Without shards there is the one database, and nothing is asked. With them, that of a map is looked up in the
directory for each request; what is named by its number is where its range of numbers is.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable

from sqlalchemy import Engine
from starlette.requests import HTTPConnection

from semap.store.database.connection import translated
from semap.store.database.role import enter
from semap.store.map.places import Shard, list_shards, shard_of
from semap.store.operate.shards import forget_map, place_new_map

LOOK_S = 1.0
"""So long after it was added a shard may be unknown."""
ADMIN = "semap_admin"
SMALL, LARGE = 1 << 25, 1 << 47
"""How many ids a shard has, by whether they are integers (sql/015)."""
WIDTHS = {
    "queries": SMALL,
    "rules": SMALL,
    "sources": SMALL,
    "instances": LARGE,
    "rooms": LARGE,
    "tracks": LARGE,
    "descriptions": LARGE,
    "frames": LARGE,
    "changes": LARGE,
}
DIRECTORY = ("events", "tokens", "webhooks", "jobs")
"""What is kept for all maps together; what is neither here nor of a map is asked there, too."""
STEP = re.compile(r"^/([^/]+)(?:/([^/]+))?")

Open = Callable[[str], Engine]


class Shards:
    """Mutable, for all threads: connections to shards, opened when they are needed.

    open_engine  the connections of requests, by DSN; open_states: those by which states are written
    """

    def __init__(self, dsn: str, engine: Engine, open_engine: Open, open_states: Open) -> None:
        self._dsn = dsn
        self._engine = engine
        self._states = open_states(dsn)
        self._open = {"requests": open_engine, "states": open_states}
        self._opened: dict[tuple[str, str], Engine] = {}
        self._lock = threading.Lock()
        self._known: tuple[float, tuple[Shard, ...]] = (-LOOK_S, ())

    def dispose(self) -> None:
        for each in (self._states, *self._opened.values()):
            each.dispose()

    def all(self) -> tuple[Shard, ...]:
        """The directory first; raises ServerUnavailable."""
        looked_s, known = self._known
        now_s = time.monotonic()
        if now_s - looked_s >= LOOK_S:
            with translated(), self._engine.begin() as connection:
                enter(connection, ADMIN)
                known = list_shards(connection)
            self._known = (now_s, known)
        return known

    def engine(self, shard: Shard) -> Engine:
        return self._engine if shard.dsn is None else self._of(shard.dsn, "requests")

    def of_map(self, map_name: str) -> Engine:
        """Where a map is; the directory where there is none of that name."""
        shard = self._shard_of(map_name)
        return self._engine if shard is None else self.engine(shard)

    def states_of(self, map_name: str) -> Engine:
        """The same, to write states."""
        shard = self._shard_of(map_name)
        if shard is None or shard.dsn is None:
            return self._states
        return self._of(shard.dsn, "states")

    def of_new_map(self, map_name: str) -> Engine:
        """Where a map is, or is to be made; raises Conflict where every shard is drained."""
        if len(self.all()) == 1:
            return self._engine
        shard = place_new_map(self._dsn, map_name)
        return self._engine if shard is None else self.engine(shard)

    def of_request(self, connection: HTTPConnection) -> Engine:
        """What the path and the query of a request are about."""
        if len(self.all()) == 1:
            return self._engine
        found = STEP.match(connection.scope["route"].path)
        kind = "" if found is None else found[1]
        given = connection.path_params
        if kind == "maps" and "name" in given:
            return self.of_map(given["name"])
        if kind == "collections" and "collectionId" in given:
            return self._of_collection(given["collectionId"])
        if kind in WIDTHS and "id" in given:
            return self._of_id(int(given["id"]) // WIDTHS[kind])
        map_name = None if kind in DIRECTORY else connection.query_params.get("map")
        return self._engine if map_name is None else self.of_map(map_name)

    def dsn_of(self, engine: Engine) -> str | None:
        """Of connections to a shard; None of those to the directory."""
        return next((dsn for (dsn, _), opened in self._opened.items() if opened is engine), None)

    def forget(self, map_name: str) -> None:
        """After a map was deleted on its shard, let its place go with it."""
        if len(self.all()) > 1:
            forget_map(self._dsn, map_name)

    def _shard_of(self, map_name: str) -> Shard | None:
        if len(self.all()) == 1:
            return None
        with translated(), self._engine.begin() as connection:
            enter(connection, ADMIN)
            return shard_of(connection, map_name)

    def _of_collection(self, collection: str) -> Engine:
        """Of the longest name of a map that it begins with; both may have dots."""
        for place in range(len(collection) - 1, 0, -1):
            if collection[place] == "." and (shard := self._shard_of(collection[:place])) is not None:
                return self.engine(shard)
        return self._engine

    def _of_id(self, shard_id: int) -> Engine:
        shard = next((each for each in self.all() if each.shard_id == shard_id), None)
        return self._engine if shard is None else self.engine(shard)

    def _of(self, dsn: str, use: str) -> Engine:
        with self._lock:
            if (dsn, use) not in self._opened:
                self._opened[dsn, use] = self._open[use](dsn)
            return self._opened[dsn, use]
